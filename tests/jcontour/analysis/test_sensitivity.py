import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.analysis.probes import probe_windows
from jcontour.analysis.sensitivity import (
    late_radius,
    loop_peaks,
    sensitivity_curves,
)
from jcontour.analysis.stability import frozen_spectral_radii
from jcontour.controllers.feedback.cascade import Cascade, CascadeGains
from jcontour.controllers.lq.contouring_lq import ContouringLQ, LQWeights
from jcontour.controllers.observers.kalman import (
    FilterObserver,
    OffsetFreeObserver,
    kalman_gain,
    offset_free_gain,
)
from jcontour.geometry.contours import circle, line, polygon
from jcontour.linear.transformations import with_input_delay
from jcontour.motion.references import along
from jcontour.plants.delays import Delayed
from jcontour.plants.encoders import Encoders, FineEncoders
from jcontour.plants.flexible_axis.axis import SmoothFlexibleAxis, thesis_axis, zoh_model
from jcontour.plants.linear_machines import bridgeport
from jcontour.sensors import motors
from jcontour.simulation.closed_loop import prepared
from jcontour.simulation.evaluation import stack_plants, stack_references


def square(side):
    """Square from the origin [m]."""
    return polygon(side * np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]))


@pytest.fixture(scope="module")
def bent():
    return along(circle(1e-3), 3e-4 * np.arange(9), 1e-3, 3, at_rest=False)


@pytest.fixture(scope="module")
def law(two_axes):
    return ContouringLQ(two_axes, LQWeights(3.0, 5.0, 1e-6), 3)


@pytest.fixture(scope="module")
def integrators(linear_machine):
    return linear_machine(np.eye(2), np.eye(2), np.eye(2))


def test_an_unstable_loop_has_infinite_peaks_and_a_radius(integrators, given_law, straight_window):
    windows, family = straight_window(2), stack_plants([Encoders(integrators)])

    @jax.jit
    def peaks(gain):
        law = given_law.static(jnp.diag(jnp.stack([-gain, jnp.full_like(gain, -0.5)])))
        return jax.tree.map(lambda peak: peak[0, 0], loop_peaks(family, law, windows))

    found = peaks(2.5)
    assert np.isinf(found.sensitivity) and np.isinf(found.complementary)
    assert found.spectral_radius == pytest.approx(1.5)
    slopes = jax.jacrev(peaks)(2.5)
    assert slopes.spectral_radius == pytest.approx(1.0)
    assert (slopes.sensitivity, slopes.complementary) == (0.0, 0.0)
    broken = peaks(jnp.nan)
    assert np.isinf(broken.spectral_radius) and np.isinf(broken.sensitivity)


@pytest.mark.slow
def test_radii_are_those_of_the_frozen_loops_of_a_run(two_axes, law, bent, samples_of):
    observer = FilterObserver(law, two_axes, kalman_gain(two_axes, 0.01, 1e-6))
    windows = probe_windows(stack_references([bent]), 4)
    samples = samples_of(windows, bent)
    late, later = (Delayed(Encoders(two_axes), jnp.asarray(delay), 2, 2) for delay in (1, 2))
    wanted = [frozen_spectral_radii(plant, observer, bent)[samples] for plant in (late, later)]
    family = stack_plants([late])
    found = loop_peaks(family, observer, windows).spectral_radius[:, 0]
    np.testing.assert_allclose(found, wanted[0], rtol=1e-9)
    for more in (0, 1):
        found = late_radius(family, observer, windows, more)[:, 0]
        np.testing.assert_allclose(found, wanted[more], rtol=1e-8)


@pytest.mark.slow
def test_a_state_that_is_measured_counts_at_the_input_alone(two_axes, law, bent, samples_of):
    """I - F (zI - A + B F)^-1 B, by NumPy."""
    windows, family = probe_windows(stack_references([bent]), 1), stack_plants([two_axes])
    F = np.asarray(prepared(law, bent).F)[samples_of(windows, bent)[0]]
    A, B = np.asarray(two_axes.A), np.asarray(two_axes.B)
    w = np.linspace(1e-4, np.pi, 40001)
    shifted = np.exp(1j * w)[:, None, None] * np.eye(4) - (A - B @ F)
    S = np.eye(2) - F @ np.linalg.solve(shifted, np.broadcast_to(B + 0j, (w.size, 4, 2)))
    wanted = np.linalg.svd(S, compute_uv=False)[:, 0]
    found = loop_peaks(family, law, windows).sensitivity[0, 0]
    assert found == pytest.approx(wanted.max(), rel=1e-6)
    curves = sensitivity_curves(family, law, windows, w[::4000])
    np.testing.assert_allclose(curves, wanted[None, None, ::4000], rtol=1e-9)


def central_differences(function, point, step=3e-3):
    """Slopes of fourth order, (outputs, inputs)."""
    columns = []
    for direction in step * np.eye(point.size):
        near, far = (
            (function(point + k * direction) - function(point - k * direction)) / (2 * k * step)
            for k in (1, 2)
        )
        columns.append((4 * near - far) / 3)
    return np.stack(columns, axis=1)


def check_slopes(build, start, family, windows, jacobian=jax.jacrev):
    """Sums of all peaks and radii, so that every loop counts, against central differences."""

    def sums(numbers):
        controller = build(numbers)
        late = late_radius(family, controller, windows, 1)
        peaks = loop_peaks(family, controller, windows)[:3]  # nothing is doubted
        return jnp.stack([jnp.sum(one) for one in (*peaks, late)])

    values = jax.jit(sums)
    assert np.isfinite(values(start)).all()
    found = jax.jit(jacobian(sums))(jnp.asarray(start))
    wanted = central_differences(lambda numbers: np.asarray(values(numbers)), start)
    largest = np.abs(wanted).max(axis=1, keepdims=True)
    np.testing.assert_allclose(found / largest, wanted / largest, rtol=1e-5, atol=1e-6)


def late_table():
    """Table with and without two samples of delay, probed around a square."""
    machine = bridgeport()
    family = [Delayed(Encoders(machine), jnp.asarray(late), 2, 2) for late in (0, 2)]
    run = along(square(1e-3), 5e-5 * np.arange(60), machine.dt, 10, at_rest=False)
    return machine, stack_plants(family), probe_windows(stack_references([run]), 3)


def behind_filter(machine):
    def build(numbers):
        alpha, beta, noise = jnp.exp(numbers)
        inner = ContouringLQ(machine, LQWeights(alpha, beta, 2e-9), 10)
        return FilterObserver(inner, machine, kalman_gain(machine, noise, 3e-7))

    return build, np.log([0.03, 0.1, 0.1])


def behind_offset_free(machine):
    model = with_input_delay(machine, 1)

    def build(numbers):
        alpha, beta, noise, drift = jnp.exp(numbers)
        gain = offset_free_gain(model, model.C, noise, drift, 3e-7)
        inner = ContouringLQ(model, LQWeights(alpha, beta, 2e-9), 10)
        return OffsetFreeObserver(inner, model, gain, model.C, 10.0)

    return build, np.log([1.0, 3.0, 0.1, 1e-3])


@pytest.mark.slow
@pytest.mark.parametrize("behind", [behind_filter, behind_offset_free])
def test_slopes_on_the_table_with_delay(behind):
    machine, family, windows = late_table()
    check_slopes(*behind(machine), family, windows)


@pytest.mark.slow
def test_slopes_of_a_cascade_on_the_flexible_axis():
    dt = 1e-3
    axis = SmoothFlexibleAxis(thesis_axis(), dt, substeps=4)
    late = [Delayed(axis, jnp.asarray(late), 1, 1) for late in (0, 1)]
    family = stack_plants([FineEncoders(plant, motors(1)) for plant in late])
    run = along(line([0.0], [1e-2]), 1e-4 * np.arange(30), dt, 1, at_rest=False)
    windows = probe_windows(stack_references([run]), 2)

    def build(numbers):
        return Cascade(CascadeGains(*jnp.exp(numbers)), motors(1), dt, limit=10.0)

    # the mode of the tuner, and the one that takes less time to compile
    check_slopes(build, np.log([30.0, 55.0, 0.04]), family, windows, jax.jacfwd)


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
    found, expected = (
        sensitivity_curves(
            stack_plants([FineEncoders(machine, motors(1))]),
            cascade,
            windows,
            np.geomspace(1e-3, np.pi, 50),
        )
        for machine in (SmoothFlexibleAxis(axis, dt, substeps=8), zoh_model(axis, dt))
    )
    assert expected.max() > 1.05
    np.testing.assert_allclose(found, expected, rtol=1e-5)


def test_bad_input_is_refused(two_axes, law, bent):
    short = along(circle(1e-3), 3e-4 * np.arange(9), 1e-3, 1, at_rest=False)
    windows, family = probe_windows(stack_references([short]), 2), stack_plants([two_axes])
    for query in (loop_peaks, lambda *three: late_radius(*three, 1)):
        with pytest.raises(ValueError, match="preview"):
            query(family, law, windows)
    with pytest.raises(ValueError, match="samples"):
        late_radius(family, law, probe_windows(stack_references([bent]), 1), -1)
