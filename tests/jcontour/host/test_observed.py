"""The host's observers against the traceable ones, with the same controller inside."""

import numpy as np
import pytest

from jcontour._arrays import placed
from jcontour.controllers.lq.contouring_lq import (
    ContouringLQ,
    LQWeights,
    OutputTerminal,
    RiccatiTerminal,
)
from jcontour.controllers.observers.kalman import (
    FilterObserver,
    OffsetFreeObserver,
    kalman_gain,
    offset_free_gain,
)
from jcontour.geometry.contours import circle
from jcontour.host.loop import reported_loop
from jcontour.host.observed import ObservedHost, OffsetFreeHost
from jcontour.linear.transformations import with_input_delay
from jcontour.motion.references import along, from_samples
from jcontour.mpc.tracking.forms import OffsetFreeForm
from jcontour.mpc.tracking.limits import Limits
from jcontour.mpc.tracking.tracking_mpc import TrackingMPC, TrackingWeights
from jcontour.plants.actuation import Disturbed
from jcontour.plants.encoders import Encoders, Quantised
from jcontour.plants.linear_machines import exact_bridgeport
from jcontour.simulation.closed_loop import simulate

WEIGHTS, N = LQWeights(3.0, 50.0, 2e-8), 4
STIFF = LQWeights(3.0, 5.0, 2e-9)  # for the Bridgeport table
LOAD = np.array([0.3, -0.2])  # [V] on its drives
COUNT = 1e-6  # [m]
OUT_OF_REACH = Limits.within(control=1e3, increment=1e3, speed=10.0, acceleration=1e5)


def late_table(delay: int):
    """Model of the Bridgeport table, and its observer's gain."""
    model = with_input_delay(exact_bridgeport(), delay)
    return model, offset_free_gain(model, model.C, 0.05, 0.01, COUNT)


def behind_encoders(model):
    """The machine of the model under the load, seen by its encoders."""
    return Encoders(Disturbed(model, force=placed(LOAD[None])))


def limited(model, gain, limits, terminal=None, preview=N, penalty=None):
    """The MPC behind the observer of state and load."""
    mpc = TrackingMPC(
        model,
        TrackingWeights.of(STIFF),
        preview,
        limits,
        terminal,
        penalty=penalty,
        form=OffsetFreeForm(),
    )
    return OffsetFreeHost(mpc, model, gain, model.C)


def around_a_circle(model, preview=N, steps=100):
    return along(circle(1e-3), 2e-5 * np.arange(steps), model.dt, preview, at_rest=True)


def step_away(model, steps, preview=N):
    """The reference stands 1 mm and -0.5 mm from where the tool starts."""
    position = np.tile([1e-3, -5e-4], (steps + preview, 1))
    position[0] = 0.0
    tangent = np.tile([1.0, 0.0], (steps + preview, 1))
    return from_samples(position, tangent, model.dt, preview, in_motion=False)


def test_it_is_the_filter_observer(two_axes):
    gain = kalman_gain(two_axes, 0.1, 1e-6)
    reference = along(circle(1e-3), 2e-5 * np.arange(30), 1e-3, N, at_rest=True)
    plant = Encoders(two_axes)
    start = 1e-5 * np.random.default_rng(0).standard_normal(4) + np.asarray(
        plant.initial_state(reference.position[0], np.zeros(2))
    )
    wanted = simulate(
        plant, FilterObserver(ContouringLQ(two_axes, WEIGHTS, N), two_axes, gain), reference, start
    )
    mpc = TrackingMPC(two_axes, TrackingWeights.of(WEIGHTS), N)
    actual = reported_loop(plant, ObservedHost(mpc, two_axes, gain), reference, start).rollout
    np.testing.assert_allclose(
        actual.control, wanted.control, rtol=0, atol=1e-9 * np.abs(wanted.control).max()
    )
    np.testing.assert_allclose(actual.memory.estimate, wanted.memory.estimate, rtol=0, atol=1e-12)


def test_the_gain_needs_its_shape(two_axes):
    with pytest.raises(ValueError, match=r"^gain: needs shape \(4, 2\), received \(2, 4\)"):
        ObservedHost(
            TrackingMPC(two_axes, TrackingWeights.of(WEIGHTS), N), two_axes, np.zeros((2, 4))
        )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("terminal", "delay", "counting"),
    [(OutputTerminal(), 0, True), (RiccatiTerminal(), 1, False)],
    ids=["output", "riccati"],
)
def test_without_an_active_limit_it_is_the_offset_free_observer(terminal, delay, counting):
    """Counts hide the rounding of the two loops from each other: it adds up on the integrators."""
    model, gain = late_table(delay)
    plant, tolerance = behind_encoders(model), 1e-12
    if counting:
        plant, tolerance = Quantised(plant, COUNT), 1e-11
    reference = around_a_circle(model)
    inner = ContouringLQ(model, STIFF, N, terminal)
    wanted = simulate(plant, OffsetFreeObserver(inner, model, gain, model.C), reference)
    actual = reported_loop(plant, limited(model, gain, OUT_OF_REACH, terminal), reference)
    assert actual.report.active_fraction == 0 and actual.report.worst_residual <= 1e-8
    for one, other in (
        (actual.rollout.control, wanted.control),
        (actual.rollout.output, wanted.output),
        (actual.rollout.memory.estimate, wanted.memory.estimate),
        (actual.rollout.memory.disturbance, wanted.memory.disturbance),
    ):
        np.testing.assert_allclose(one, other, rtol=0, atol=tolerance * np.abs(other).max())


@pytest.mark.parametrize("delay", [0, 1])
def test_limits_hold_for_the_control_that_acts(delay):
    """The load takes 0.3 of 0.5 V: limits on u + d instead would be passed or not be used."""
    model, gain = late_table(delay)
    limits = Limits.within(control=0.5, increment=0.2)
    controller = limited(model, gain, limits, preview=20)
    reference = step_away(model, 600, 20)
    run = reported_loop(behind_encoders(model), controller, reference)
    control = np.asarray(run.rollout.control)
    assert np.abs(control).max() <= 0.5 * (1 + 1e-9)
    assert np.abs(np.diff(control, axis=0)).max() <= 0.2 * (1 + 1e-9)
    assert np.abs(control).max(axis=0) == pytest.approx(0.5)
    assert np.abs(np.diff(control, axis=0)).max() == pytest.approx(0.2)
    felt = control + np.asarray(run.rollout.memory.disturbance)
    assert np.abs(felt).max() > 0.7
    assert 0 < run.report.active_fraction < 1
    # a control at its limit does not disturb the estimate
    np.testing.assert_allclose(run.rollout.final_memory.disturbance, LOAD, rtol=0, atol=1e-6)
    end = np.asarray(reference.position)[-1]
    np.testing.assert_allclose(np.asarray(run.rollout.output)[-1], end, rtol=0, atol=1e-9)


@pytest.mark.parametrize("delay", [0, 1])
def test_a_constant_load_leaves_no_offset_at_rest(delay):
    model, gain = late_table(delay)
    plant, reference = behind_encoders(model), step_away(model, 600)
    free = reported_loop(plant, limited(model, gain, OUT_OF_REACH), reference).rollout
    np.testing.assert_allclose(free.output[-1], reference.position[-1], rtol=0, atol=1e-12)
    np.testing.assert_allclose(free.control[-1], -LOAD, rtol=0, atol=1e-9)
    gain = kalman_gain(model, 0.05, COUNT)
    without = ObservedHost(
        TrackingMPC(model, TrackingWeights.of(STIFF), N, OUT_OF_REACH), model, gain
    )
    left = np.abs(
        reported_loop(plant, without, reference).rollout.output[-1] - reference.position[-1]
    )
    assert left.min() >= 1e-6


def test_a_held_control_drives_both_estimates(two_axes):
    """Model and estimate go on together: no innovation, and the load stays as it is."""
    gain = offset_free_gain(two_axes, two_axes.C, 0.1, 0.1, 1e-6)
    mpc = TrackingMPC(two_axes, TrackingWeights.of(WEIGHTS), N, form=OffsetFreeForm())
    host = OffsetFreeHost(mpc, two_axes, gain, two_axes.C)
    reference = along(circle(1e-3), 2e-5 * np.arange(5), 1e-3, N, at_rest=True)
    memory = host.initial_memory(reference)._replace(disturbance=np.array([0.1, -0.2]))
    state, held = memory.estimate, np.array([0.4, 0.7])
    following = host.held(memory, two_axes.output(state), held)
    wanted = two_axes.step(state, held + memory.disturbance)
    np.testing.assert_allclose(following.estimate, wanted, rtol=0, atol=1e-15)
    np.testing.assert_allclose(following.disturbance, [0.1, -0.2], rtol=0, atol=1e-12)
    np.testing.assert_array_equal(following.inner.control, held)
    np.testing.assert_allclose(following.inner.state, state, rtol=0, atol=1e-15)


@pytest.mark.parametrize("fallback", ["hold", "soft"])
def test_the_offset_free_loop_falls_back(fallback):
    """A speed limit that the load breaks before it is known; the increments are too small."""
    model, gain = late_table(1)
    limits = Limits.within(control=0.5, increment=0.02, speed=1e-3)
    controller = limited(model, gain, limits)
    run = reported_loop(
        behind_encoders(model), controller, step_away(model, 300), fallback=fallback
    )
    control = np.asarray(run.rollout.control)
    assert run.report.fallbacks > 0
    assert np.isfinite(control).all() and np.abs(control).max() <= 0.5 * (1 + 1e-9)
    assert np.abs(np.diff(control, axis=0)).max() <= 0.02 * (1 + 1e-9)
    if fallback == "hold":
        repeated = run.report.fallback[1:]
        np.testing.assert_array_equal(control[1:][repeated], control[:-1][repeated])


def test_bad_numbers_of_the_offset_free_observer(two_axes):
    mpc = TrackingMPC(two_axes, TrackingWeights.of(WEIGHTS), N, form=OffsetFreeForm())
    gain = np.asarray(offset_free_gain(two_axes, two_axes.C, 0.1, 0.1, 1e-6))
    with pytest.raises(ValueError, match=r"^gain: needs shape \(6, 2\), received \(4, 2\)"):
        OffsetFreeHost(mpc, two_axes, gain[:4], two_axes.C)
    with pytest.raises(ValueError, match=r"^measured: needs shape \(q, 4\), received \(2, 3\)"):
        OffsetFreeHost(mpc, two_axes, gain, np.asarray(two_axes.C)[:, :3])
    with pytest.raises(ValueError, match=r"^measured: needs shape \(q, 4\), received \(4,\)"):
        OffsetFreeHost(mpc, two_axes, gain, np.asarray(two_axes.C)[0])
    with pytest.raises(ValueError, match="^gain: the observer is not stable"):
        OffsetFreeHost(mpc, two_axes, 0 * gain, two_axes.C)
    host = OffsetFreeHost(mpc, two_axes, gain, two_axes.C)
    with pytest.raises(ValueError, match="^dt: the controller is sampled every 0.001 s"):
        host.initial_memory(along(circle(1e-3), 2e-5 * np.arange(5), 2e-3, N, at_rest=True))
