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
from jcontour.geometry.contours import circle, ellipse, line, polygon
from jcontour.motion.references import along
from jcontour.plants.actuation import Delayed
from jcontour.plants.encoders import Encoders, FineEncoders
from jcontour.plants.flexible_axis.axis import SmoothFlexibleAxis, thesis_axis, zoh_model
from jcontour.sensors import motors
from jcontour.simulation.closed_loop import prepared
from jcontour.simulation.evaluation import stack_plants, stack_references
from tests.jcontour.analysis.given_loops import (
    Law,
    loop_peaks,
    plant_of,
    samples_of,
    straight_window,
)


@pytest.fixture(scope="module")
def bent():
    return along(circle(1e-3), 3e-4 * np.arange(9), 1e-3, 3, at_rest=False)


@pytest.fixture(scope="module")
def law(two_axes):
    return ContouringLQ(two_axes, LQWeights(3.0, 5.0, 1e-6), 3)


def test_an_unstable_loop_has_infinite_peaks_and_a_radius():
    integrators = plant_of(np.eye(2), np.eye(2), np.eye(2))
    windows, family = straight_window(2), stack_plants([Encoders(integrators)])
    encoding = encoding_of(family, windows)

    def measures(gain):
        law = Law.static(np.diag([-gain, -0.5]))
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
def test_radii_are_those_of_the_frozen_loops_of_a_run(two_axes, law, bent):
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
def test_a_state_that_is_measured_counts_at_the_input_alone(two_axes, law, bent):
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


def square(side):
    """Square from the origin [m]."""
    return polygon(side * np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]))


@pytest.fixture
def probed():
    """(references, count) -> samples of the probes, contour by contour."""

    def of(references, count):
        windows = jax.device_get(probe_windows(stack_references(references), count))
        kept = np.split(np.arange(len(windows.arc)), len(references))
        every = [jax.tree.map(lambda leaf, rows=rows: leaf[rows], windows) for rows in kept]
        return [samples_of(one, run) for one, run in zip(every, references, strict=True)]

    return of


def test_probes_are_ends_corners_and_all_directions(probed):
    """The third sample of every side is its first behind a corner."""
    run = along(square(1e-3), 1e-4 * np.arange(38), 1e-3, 3, at_rest=False)
    (samples,) = probed([run], 8)
    assert np.unique(samples).size == 8 and {0, 37} <= set(samples)
    corners = [k for k in samples if min((k + 1) % 10, (k - 1) % 10, k % 10) == 0]
    assert corners
    tangents = np.asarray(run.tangent)[samples]
    assert (np.abs(tangents) > 0.99).any(axis=0).all()  # along both axes


def test_probes_of_a_circle_look_everywhere(probed):
    run = along(circle(1e-3), 2e-5 * np.arange(314), 1e-3, 5, at_rest=False)
    (samples,) = probed([run], 8)
    gaps = np.diff(np.append(samples, samples[0] + 314))
    assert gaps.max() < 2.5 * 314 / 8


def test_the_sharpest_bend_is_probed(probed):
    """The ends of the long axis of a slim ellipse."""
    run = along(ellipse(5e-3, 5e-4), 1e-5 * np.arange(2000), 1e-3, 5, at_rest=False)
    (samples,) = probed([run], 1)
    assert np.abs(np.asarray(run.position)[samples, 1]).max() < 1e-5


def test_windows_start_in_the_motion_of_their_sample_and_see_its_future(probed):
    runs = [
        along(square(1e-3), 1e-4 * np.arange(38), 1e-3, 3, at_rest=True),
        along(circle(1e-3), 3e-4 * np.arange(9), 1e-3, 3, at_rest=False),
    ]
    windows = jax.device_get(probe_windows(stack_references(runs), 4))
    assert windows.steps == 1 and windows.preview == 3 and windows.position.shape == (8, 4, 2)
    assert np.asarray(windows.mask).tolist() == [[True, False, False, False]] * 8
    lengths = np.asarray(windows.contour.length)
    for k, samples in enumerate(probed(runs, 4)):
        position, tangent = np.asarray(runs[k].position), np.asarray(runs[k].tangent)
        for row, sample in zip(range(4 * k, 4 * k + 4), samples, strict=True):
            future = slice(sample, sample + 4)
            np.testing.assert_allclose(windows.position[row], position[future])
            np.testing.assert_allclose(windows.tangent[row], tangent[future])
            before = position[sample] - position[sample - 1]
            entered = before if sample else np.asarray(runs[k].start_increment)
            np.testing.assert_allclose(windows.start_increment[row], entered)
            length = lengths[row]
            assert length == pytest.approx(float(runs[k].contour.length))


def test_what_is_not_scored_is_not_probed_and_few_samples_repeat(probed):
    scored = (np.arange(38) == 7) | (np.arange(38) == 20)
    run = along(square(1e-3), 1e-4 * np.arange(38), 1e-3, 3, at_rest=False, scored=scored)
    (samples,) = probed([run], 5)
    assert samples.size == 5 and set(samples) == {7, 20}


def test_bad_input_is_refused():
    bent = along(circle(1e-3), 3e-4 * np.arange(9), 1e-3, 3, at_rest=False)
    with pytest.raises(ValueError, match="count"):
        probe_windows(stack_references([bent]), 0)
    nothing = eqx.tree_at(lambda r: r.mask, bent, np.zeros_like(bent.mask))
    with pytest.raises(ValueError, match="number 1: .*no scored sample"):
        probe_windows(stack_references([bent, nothing]), 2)
