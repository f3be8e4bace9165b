from functools import cache

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.signal import lfilter

from jcontour._arrays import placed
from jcontour.controllers.feedback.cascade import Cascade, CascadeGains
from jcontour.controllers.lq.contouring_lq import ContouringLQ, LQWeights
from jcontour.controllers.wrappers.filters import (
    Biquad,
    Compensated,
    Filtered,
    Shaped,
    low_pass,
    notch,
    shaped_positions,
)
from jcontour.geometry.contours import circle, line
from jcontour.linear.plant import LinearPlant
from jcontour.motion.input_shaping import Shaper, zv, zvd
from jcontour.motion.point_to_point import PointToPoint
from jcontour.motion.references import along, in_time
from jcontour.plant import Plant
from jcontour.sensors import motors
from jcontour.simulation.closed_loop import prepared, simulate

DT = 1e-3


def coefficients(filter):
    return np.asarray(filter.numerator), np.array([1.0, *np.asarray(filter.denominator)])


@pytest.mark.slow
def test_filtered_controls_are_the_filter_of_the_controls(two_axes):
    reference = along(circle(1e-3), 2.5e-5 * np.arange(6), two_axes.dt, 3, at_rest=False)
    inside = ContouringLQ(two_axes, LQWeights(3.0, 5.0, 2e-9), 3)
    filter = low_pass(0.2 / two_axes.dt, 0.7, two_axes.dt)
    rollout = simulate(two_axes, Filtered(inside, filter, 2), reference)
    plan = prepared(inside, reference)
    raw = np.stack(
        [
            inside.step(None, jax.tree.map(lambda leaf, k=k: leaf[k], plan), rollout.state[k])[1]
            for k in range(6)
        ]
    )
    np.testing.assert_allclose(
        rollout.control, lfilter(*coefficients(filter), raw, axis=0), rtol=1e-9
    )


def test_a_filter_of_three_controls_on_two_axes_begins_at_zero(two_axes):
    reference = along(circle(1e-3), 2.5e-5 * np.arange(6), two_axes.dt, 3, at_rest=False)
    machine = LinearPlant(0.5 * np.eye(2), np.ones((2, 3)), np.eye(2), two_axes.dt)
    inside = ContouringLQ(machine, LQWeights(3.0, 5.0, 2e-9), 3)
    memory = Filtered(inside, low_pass(100.0, 0.7, DT), 3).initial_memory(reference)
    np.testing.assert_array_equal(memory.filter, np.zeros((2, 3)))


def test_bad_filters_are_named():
    with pytest.raises(ValueError, match="filter: is not stable"):
        Biquad(placed(np.ones(3)), placed(np.array([0.0, 1.1])))
    with pytest.raises(ValueError, match="not stable"):
        notch(300.0, 0.5, -0.1, DT)
    with pytest.raises(ValueError, match="prewarp"):
        low_pass(1e4, 0.7, DT)


LAW = PointToPoint(0.02, 0.1, 4.0)


@cache
def short_task():
    return in_time(line([0.0], [0.02]), LAW, 0.45, DT)


@cache
def thesis_cascade():
    return Cascade(CascadeGains(30.0, 55.67, 0.04), motors(1), DT)


def test_whole_samples_of_delay_shift_the_law():
    shaper = Shaper([0.0, 0.02, 0.035], [0.2, 0.5, 0.3])
    time = DT * np.arange(len(short_task().position))
    pairs = zip((0.0, 0.02, 0.035), (0.2, 0.5, 0.3), strict=True)
    wanted = sum(share * LAW(np.maximum(time - late, 0.0)) for late, share in pairs)
    np.testing.assert_allclose(
        jax.jit(shaped_positions)(short_task(), shaper)[:, 0], wanted, rtol=0, atol=1e-15
    )


def test_a_ramp_is_late_by_the_mean_delay_from_its_first_sample_on():
    ramp = along(line([0.0, 0.0], [0.3, 0.4]), 1e-4 * np.arange(60), DT, 1, at_rest=False)
    shaper = zvd(87.0, 0.05)
    late = float(np.dot(shaper.times, shaper.amplitudes)) / DT
    np.testing.assert_allclose(
        jax.jit(shaped_positions)(ramp, shaper),
        np.asarray(ramp.position) - late * 1e-4 * np.array([0.6, 0.8]),
        rtol=0,
        atol=1e-15,
    )


def test_it_sees_as_far_as_the_controller_inside_and_starts_like_it():
    shaped = Shaped(thesis_cascade(), zv(87.0))
    assert shaped.preview == thesis_cascade().preview
    np.testing.assert_array_equal(
        shaped.initial_memory(short_task()), thesis_cascade().initial_memory(short_task())
    )


COMPENSATED_DT, STIFFNESS = 1e-3, 4e3


@cache
def compensated_short_task():
    return along(line([0.0], [0.02]), 1e-4 * np.arange(200), COMPENSATED_DT, 1, at_rest=False)


@cache
def stiff_cascade():
    return Cascade(CascadeGains(30.0, 50.0, 0.05), motors(1), COMPENSATED_DT)


class Mass(Plant):
    """A mass on a spring that hardens, x'' = u - k (x + 100 x^3), by one explicit step."""

    stiffness: float
    dt: float = eqx.field(static=True, default=COMPENSATED_DT)

    def initial_state(self, position, increment):
        return jnp.stack([position[0], increment[0] / COMPENSATED_DT])

    def step(self, state, control):
        x, v = state
        v = v + COMPENSATED_DT * (control[0] - self.stiffness * (x + 100 * x**3))
        return jnp.stack([x + COMPENSATED_DT * v, v])

    def output(self, state):
        return state[:1]

    def measure(self, state):
        return state[:1], state[1:]


class Cancelling(eqx.Module):
    stiffness: jax.Array

    def __call__(self, measurement, control):
        x, _ = measurement
        return self.stiffness * (x + 100 * x**3)


def test_what_is_cancelled_is_as_if_it_were_not_there():
    free = simulate(Mass(0.0), stiff_cascade(), compensated_short_task())
    held = simulate(
        Mass(STIFFNESS),
        Compensated(stiff_cascade(), Cancelling(STIFFNESS)),
        compensated_short_task(),
    )
    np.testing.assert_allclose(held.output, free.output, rtol=0, atol=1e-12)
    np.testing.assert_allclose(held.memory, free.memory, rtol=0, atol=1e-10)
    uncompensated = simulate(Mass(STIFFNESS), stiff_cascade(), compensated_short_task())
    assert np.abs(np.subtract(uncompensated.output, free.output)).max() > 1e-3


def test_the_compensation_sees_the_control_of_the_one_inside():
    """Adding what it is asked for doubles the loop's gain."""
    doubled = simulate(
        Mass(0.0),
        Compensated(stiff_cascade(), lambda _, control: control),
        compensated_short_task(),
    )
    wanted = simulate(
        Mass(0.0),
        Cascade(CascadeGains(30.0, 100.0, 0.05), motors(1), COMPENSATED_DT),
        compensated_short_task(),
    )
    np.testing.assert_allclose(doubled.output, wanted.output, rtol=0, atol=1e-12)


def test_a_compensation_of_another_size_is_refused():
    with pytest.raises(
        ValueError, match=r"compensation: needs the control's shape \(1,\), received \(\)"
    ):
        simulate(
            Mass(0.0),
            Compensated(stiff_cascade(), lambda measurement, control: control[0]),
            compensated_short_task(),
        )
