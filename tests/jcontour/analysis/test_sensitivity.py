import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.analysis.peak_search import loop_measures
from jcontour.analysis.sensitivity import (
    encoding_of,
    frozen_family,
    probe_windows,
    sensitivity_curves,
)
from jcontour.analysis.stability import frozen_spectral_radii, late_measures
from jcontour.controllers.feedback.cascade import Cascade, CascadeGains
from jcontour.controllers.lq.contouring_lq import ContouringLQ, LQWeights
from jcontour.controllers.observers.kalman import (
    FilterObserver,
    kalman_gain,
)
from jcontour.geometry.contours import circle, line
from jcontour.motion.references import along
from jcontour.plants.delays import Delayed
from jcontour.plants.encoders import Encoders, FineEncoders
from jcontour.plants.flexible_axis.axis import SmoothFlexibleAxis, thesis_axis, zoh_model
from jcontour.sensors import motors
from jcontour.simulation.closed_loop import prepared
from jcontour.simulation.evaluation import stack_plants, stack_references


@pytest.fixture(scope="module")
def bent():
    return along(circle(1e-3), 3e-4 * np.arange(9), 1e-3, 3, at_rest=False)


@pytest.fixture(scope="module")
def law(two_axes):
    return ContouringLQ(two_axes, LQWeights(3.0, 5.0, 1e-6), 3)


def test_an_unstable_loop_has_infinite_peaks_and_a_radius(
    linear_machine, given_law, straight_window
):
    integrators = linear_machine(np.eye(2), np.eye(2), np.eye(2))
    windows, family = straight_window(2), stack_plants([Encoders(integrators)])
    encoding = encoding_of(family, windows)

    def measures(gain):
        law = given_law.static(np.diag([-gain, -0.5]))
        loops = jax.device_get(frozen_family(family, law, windows))
        return jax.tree.map(lambda one: one[0, 0], loop_measures(loops, encoding))

    values, slopes = measures(2.5)
    assert np.isinf(values[:2]).all() and values[2] == pytest.approx(1.5)
    assert slopes.law.D[2, 0, 0] == pytest.approx(-1.0)  # the radius is |1 + D|
    assert not any(np.any(leaf[:2]) for leaf in jax.tree.leaves(slopes))
    broken, slopes = measures(np.nan)
    assert np.isinf(broken[:3]).all()
    assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(slopes))


@pytest.mark.slow
def test_radii_are_those_of_the_frozen_loops_of_a_run(two_axes, law, bent, samples_of, loop_peaks):
    observer = FilterObserver(law, two_axes, kalman_gain(two_axes, 0.01, 1e-6))
    windows = probe_windows(stack_references([bent]), 4)
    samples = samples_of(windows, bent)
    late, later = (Delayed(Encoders(two_axes), jnp.asarray(delay), 2, 2) for delay in (1, 2))
    wanted = [frozen_spectral_radii(plant, observer, bent)[samples] for plant in (late, later)]
    family = stack_plants([late])
    actual = loop_peaks(family, observer, windows).spectral_radius[:, 0]
    np.testing.assert_allclose(actual, wanted[0], rtol=1e-9)
    loops = jax.device_get(frozen_family(family, observer, windows))
    actual, _ = late_measures(loops, 1)
    np.testing.assert_allclose(actual[:, 0], wanted[1], rtol=1e-8)


@pytest.mark.slow
def test_a_state_that_is_measured_counts_at_the_input_alone(
    two_axes, law, bent, samples_of, loop_peaks
):
    """I - F (zI - A + B F)^-1 B, by NumPy."""
    windows, family = probe_windows(stack_references([bent]), 1), stack_plants([two_axes])
    F = np.asarray(prepared(law, bent).F)[samples_of(windows, bent)[0]]
    A, B = np.asarray(two_axes.A), np.asarray(two_axes.B)
    w = np.linspace(1e-4, np.pi, 40001)
    shifted = np.exp(1j * w)[:, None, None] * np.eye(4) - (A - B @ F)
    S = np.eye(2) - F @ np.linalg.solve(shifted, np.broadcast_to(B + 0j, (w.size, 4, 2)))
    wanted = np.linalg.svd(S, compute_uv=False)[:, 0]
    actual = loop_peaks(family, law, windows).sensitivity[0, 0]
    assert actual == pytest.approx(wanted.max(), rel=1e-6)
    curves = sensitivity_curves(family, law, windows, w[::4000])
    np.testing.assert_allclose(curves, wanted[None, None, ::4000], rtol=1e-9)


@pytest.mark.slow
def test_dry_friction_is_left_out():
    """The loops are those of eqs. 3.1 and 3.2 without it, held exactly, at whatever speed."""
    dt, axis = 1e-3, thesis_axis()
    axis = eqx.tree_at(
        lambda one: (one.cogging_sine, one.cogging_cosine), axis, replace_fn=jnp.zeros_like
    )
    slow, fast = (  # [m per sample]
        along(line([0.0], [0.1]), step * np.arange(30), dt, 1, at_rest=False)
        for step in (1e-4, 2e-3)
    )
    windows = probe_windows(stack_references([slow, fast]), 1)
    cascade = Cascade(CascadeGains(30.0, 55.0, 0.04), motors(1), dt, limit=10.0)
    actual, expected = (
        sensitivity_curves(
            stack_plants([FineEncoders(machine, motors(1))]),
            cascade,
            windows,
            np.geomspace(1e-3, np.pi, 50),
        )
        for machine in (SmoothFlexibleAxis(axis, dt, substeps=8), zoh_model(axis, dt))
    )
    assert expected.max() > 1.05
    np.testing.assert_allclose(actual, expected, rtol=1e-5)


def test_too_short_a_preview_is_refused(two_axes, law):
    short = along(circle(1e-3), 3e-4 * np.arange(9), 1e-3, 1, at_rest=False)
    windows, family = probe_windows(stack_references([short]), 2), stack_plants([two_axes])
    with pytest.raises(ValueError, match="preview"):
        frozen_family(family, law, windows)
