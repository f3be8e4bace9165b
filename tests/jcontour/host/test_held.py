"""A held controller against itself at its own period, a late one against its model."""

from functools import cache

import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.controllers.feedback.cascade import Cascade, CascadeGains
from jcontour.controllers.feedforward.inverse_feedforward import FrictionFeedforward
from jcontour.controllers.wrappers.adapters import BacklashCompensation
from jcontour.geometry import contours
from jcontour.host.controller import HostController, StepReport
from jcontour.host.held import FrictionCompensated, Held, OneSampleLate, thinned
from jcontour.host.loop import reported_loop
from jcontour.linear.plant import LinearPlant
from jcontour.linear.transformations import with_input_delay
from jcontour.motion.references import along
from jcontour.mpc.contouring.mpcc import MPCC
from jcontour.plants.xy_table import xy_table
from jcontour.qp.problem import QP, Unsolved
from jcontour.sensors import motors


@cache
def circle():
    return contours.circle(0.02)


def at_rest(steps, dt):
    return along(circle(), np.zeros(steps), dt, 0, at_rest=True)


class Counting(HostController):
    """It counts its own steps from zero on."""

    preview = 0

    def prepare(self, reference):
        return None

    def initial_memory(self, reference):
        return 0


class Failing(Counting):
    """Its control counts its own steps; the third has no answer."""

    def __init__(self, soft):
        self.soft = soft

    def step(self, memory, plan, measurement):
        if memory == 2:
            one = np.ones(1)
            qp = QP(np.eye(1), one, np.ones((0, 1)), one[:0], one[:0], one, -one)
            raise Unsolved("test", "infeasible", qp)
        return memory + 1, np.full(2, memory + 1.0), StepReport(active=memory + 1)

    def soft_step(self, memory, plan, measurement):
        return (memory + 1, np.full(2, 10.0), StepReport(active=7)) if self.soft else None

    def held(self, memory, measurement, control):
        return memory + 1


@pytest.mark.parametrize(("soft", "third"), [(True, 10.5), (False, 2.5)])
def test_friction_is_compensated_in_every_kind_of_step(soft, third):
    """0.5 beside the counts 1, 2, the softened 10 or the repeated 2, and 4; at most 4.2 in all."""
    repeated = []

    class Noting(Failing):
        def held(self, memory, measurement, control):
            repeated.append(control.tolist())
            return super().held(memory, measurement, control)

    diagonal = contours.line([0.0, 0.0], [1.0, 1.0])
    path = along(diagonal, 1e-3 * np.arange(6), 1e-3, 1, at_rest=True)
    cascade = Cascade(CascadeGains(30.0, 55.67, 0.04), motors(2), dt=1e-3)
    for limit in (np.inf, 4.2):
        controller = FrictionCompensated(Noting(soft), FrictionFeedforward(cascade, 0.5, limit))
        run = reported_loop(xy_table(1e-3), controller, path, fallback="soft")
        wanted = np.minimum([1.5, 2.5, third, 4.5], limit)
        np.testing.assert_allclose(np.asarray(run.rollout.control)[:4, 0], wanted)
        assert run.report.fallbacks == 1
    assert repeated == ([] if soft else [[2.0, 2.0]] * 2)


class Following(Failing):
    """Its control is the reference."""

    def prepare(self, reference):
        return np.asarray(reference.position[: reference.steps])

    def step(self, memory, plan, measurement):
        return memory + 1, plan, StepReport()


def test_a_lead_of_half_the_backlash_is_planned_for():
    """The run begins where the reference does: half a gap ahead is the plan's alone."""
    diagonal = contours.line([0.0, 0.0], [1.0, 1.0])
    path = along(diagonal, 1e-3 * np.arange(6), 1e-3, 1, at_rest=True)
    cascade = Cascade(CascadeGains(30.0, 55.67, 0.04), motors(2), dt=1e-3)
    ahead = BacklashCompensation(cascade, jnp.array([0.4, 0.0])).leading
    controller = FrictionCompensated(Following(False), FrictionFeedforward(cascade, 0.5), ahead)
    run = reported_loop(xy_table(1e-3), controller, path)
    position = np.asarray(path.position)[: path.steps]
    control = np.asarray(run.rollout.control)[:-1]
    np.testing.assert_allclose(control, position[:-1] + [0.5 + 0.2, 0.5], atol=1e-12)
    np.testing.assert_array_equal(run.rollout.output[0], position[0])


class Pulling(Failing):
    """It pulls the loads of the table to the origin."""

    def step(self, memory, plan, measurement):
        control = -0.01 * np.asarray(measurement)[[2, 6]]
        return memory + 1, control, StepReport(active=memory)


def test_looking_between_the_samples_changes_nothing():
    slow = reported_loop(xy_table(0.004), Pulling(False), at_rest(50, 0.004))
    fast = reported_loop(xy_table(0.001), Held(Pulling(False), 4, 2), at_rest(200, 0.001))
    outputs, controls = slow.rollout.output, np.repeat(slow.rollout.control, 4, axis=0)
    assert np.ptp(outputs) > 1e-3
    np.testing.assert_allclose(fast.rollout.output[::4], outputs, rtol=0, atol=1e-12)
    np.testing.assert_allclose(fast.rollout.control, controls, rtol=0, atol=1e-9)
    np.testing.assert_array_equal(fast.report.active, np.repeat(slow.report.active, 4))


@pytest.mark.parametrize(("soft", "third"), [(False, 2.0), (True, 10.0)])
def test_a_fallback_lasts_a_whole_period_of_the_controller(soft, third):
    table, reference = xy_table(0.001), at_rest(8, 0.001)
    run = reported_loop(table, Held(Failing(soft), 2, 2), reference, fallback="soft")
    assert np.asarray(run.rollout.control)[:, 0].tolist() == [1, 1, 2, 2, third, third, 4, 4]
    assert run.report.fallbacks == 1 and run.report.fallback[4]


def test_thinned_reference_has_every_nth_sample_and_the_preview():
    reference = along(circle(), np.linspace(0.0, 0.05, 22), 0.001, 8, at_rest=False)
    thin = thinned(reference, 4)
    assert thin.steps == 6 and thin.preview == 2 and thin.dt == 0.004
    kept = np.asarray(reference.position)[::4]
    np.testing.assert_array_equal(np.asarray(thin.position)[:7], kept[:7])
    np.testing.assert_allclose(thin.start_increment, 4 * np.asarray(reference.start_increment))


def test_every_needs_to_be_a_whole_number():
    with pytest.raises(ValueError, match="every"):
        Held(MPCC(xy_table(0.004), circle()), 0, 2)


class CountingLate(Counting):
    """Its control is the number of the sample, from one on."""

    def step(self, memory, plan, measurement):
        assert measurement.size == 3 and np.all(measurement[1:] == memory)
        return memory + 1, np.full(2, memory + 1.0), StepReport()

    def finished(self, memory):
        return memory == 5


def test_one_sample_late_is_late_by_one_sample():
    machine = xy_table(4e-3)
    late = OneSampleLate(CountingLate(), machine)
    memory = late.initial_memory(
        along(contours.circle(1e-2), np.zeros(5), machine.dt, 0, at_rest=True)
    )
    acted = []
    for _ in range(5):
        memory, control, _ = late.step(memory, None, np.zeros(1))
        acted.append(control[0])
    assert acted == [0, 1, 2, 3, 4] and late.finished(memory)
    assert late.soft_step(memory, None, np.zeros(1)) is None  # there is none inside


def test_drives_that_take_a_position_are_held_where_the_run_begins():
    """y = 2 u at rest: half of the place is on its way, and is what the controller is told."""
    drives = LinearPlant(np.diag([0.9, 0.8]), np.diag([0.2, 0.4]), np.eye(2), 1e-3)
    model = with_input_delay(drives, 1)
    path = along(contours.circle(1e-2), np.zeros(5), model.dt, 0, at_rest=True)
    late = OneSampleLate(CountingLate(), model)
    waiting = late.initial_memory(path).waiting
    np.testing.assert_allclose(waiting, np.asarray(path.position[0]) / 2, rtol=1e-12, atol=1e-15)
    assert np.any(waiting != 0)
    state = np.asarray(model.initial_state(path.position[0], np.zeros(2)))
    np.testing.assert_allclose(late.enter(late.initial_memory(path), state[:2]), state, rtol=1e-12)
