"""`reported_loop` against `simulate`, and what it does when a step has no answer."""

from functools import cache

import jax
import numpy as np
import pytest

from jcontour.app.machines.linear import bridgeport_machine
from jcontour.controllers.lq.contouring_lq import ContouringLQ, LQWeights
from jcontour.geometry.contours import circle
from jcontour.host.controller import HostController, StepReport
from jcontour.host.loop import Stopped, reported_loop
from jcontour.motion.references import along
from jcontour.qp.problem import QP, Unsolved
from jcontour.simulation.closed_loop import prepared, simulate

PREVIEW, DT = 3, 0.5e-3
WEIGHTS = LQWeights(3.0, 5.0, 2e-9)


@cache
def on_circle(steps=12):
    return along(circle(1e-3), 2.5e-5 * np.arange(steps), DT, PREVIEW, at_rest=False)


def same(actual, wanted, relative=1e-12):
    for a, b in zip(jax.tree.leaves(actual), jax.tree.leaves(wanted), strict=True):
        a, b = np.asarray(a), np.asarray(b)
        assert a.shape == b.shape and a.dtype == b.dtype
        np.testing.assert_allclose(
            a, b, rtol=0, atol=relative * max(1.0, np.abs(b).max(initial=0.0))
        )


class Affine(HostController):
    """u = f - F x on the host; fails in the steps it is told to."""

    def __init__(self, controller: ContouringLQ, failing=(), soft=False, last=None):
        self.inner, self.preview = controller, controller.preview
        self.failing, self.soft, self.last = failing, soft, last

    def prepare(self, reference):
        plan = prepared(self.inner, reference)
        return np.asarray(plan.F), np.asarray(plan.f)

    def initial_memory(self, reference):
        return 0

    def step(self, memory, plan, measurement):
        if memory in self.failing:
            raise Unsolved("test", "infeasible", crossed())
        return self.affine(memory, plan, measurement)

    def soft_step(self, memory, plan, measurement):
        return self.affine(memory, plan, measurement) if self.soft else None

    def affine(self, memory, plan, measurement):
        F, f = plan
        report = StepReport(active=2, residual=1e-12, iterations=3)
        return memory + 1, f - F @ measurement, report

    def held(self, memory, measurement, control):
        return memory + 1

    def finished(self, memory):
        return memory == self.last


def crossed():
    """A problem whose limits are crossed."""
    one = np.ones(1)
    return QP(np.eye(1), one, np.ones((0, 1)), one[:0], one[:0], one, -one)


@cache
def zoo():
    plant = bridgeport_machine().model
    return plant, ContouringLQ(plant, WEIGHTS, PREVIEW)


def test_a_host_controller_gives_the_rollout_of_its_traceable_twin():
    plant, controller = zoo()
    run, wanted = (
        reported_loop(plant, Affine(controller), on_circle()),
        simulate(plant, controller, on_circle()),
    )
    for name in ("state", "output", "measurement", "control", "final_state"):
        same(getattr(run.rollout, name), getattr(wanted, name))
    assert run.rollout.memory.tolist() == list(range(12)) and run.rollout.final_memory == 12
    assert (
        run.report.fallbacks == 0
        and run.report.active_fraction == 1.0
        and run.report.worst_residual == 1e-12
    )


def test_a_finished_run_is_shorter():
    plant, controller = zoo()
    rollout = reported_loop(plant, Affine(controller, last=7), on_circle()).rollout
    wanted = simulate(plant, controller, on_circle())
    same(rollout.output, np.asarray(wanted.output)[:7])
    same(rollout.final_state, np.asarray(wanted.state)[7])


def test_an_unsolved_step_stops_the_run_and_keeps_what_there_is():
    plant, controller = zoo()
    with pytest.raises(
        Stopped, match=r"^step 5: test did not solve the QP \(1 variables, 0 rows\): infeasible$"
    ) as caught:
        reported_loop(plant, Affine(controller, failing=(5,)), on_circle())
    stopped, wanted = caught.value, simulate(plant, controller, on_circle())
    assert (
        stopped.step == 5 and stopped.cause.step == 5 and stopped.cause.qp.upper.tolist() == [-1.0]
    )
    same(stopped.run.rollout.control, np.asarray(wanted.control)[:5])
    same(stopped.run.rollout.final_state, np.asarray(wanted.state)[5])
    assert stopped.run.report.active.shape == (5,)


def test_hold_repeats_the_last_control_and_is_counted():
    plant, controller = zoo()
    run = reported_loop(plant, Affine(controller, failing=(5, 6)), on_circle(), fallback="hold")
    assert run.report.fallbacks == 2 and np.flatnonzero(run.report.fallback).tolist() == [5, 6]
    control = np.asarray(run.rollout.control)
    same(control[5:7], np.repeat(control[4:5], 2, axis=0))
    with pytest.raises(Stopped) as caught:
        reported_loop(plant, Affine(controller, failing=(0,)), on_circle(), fallback="hold")
    assert caught.value.step == 0 and caught.value.run.rollout.output.shape == (0, 2)


def test_soft_solves_again():
    plant, controller = zoo()
    run = reported_loop(
        plant, Affine(controller, failing=(0, 5), soft=True), on_circle(), fallback="soft"
    )
    same(run.rollout.control, simulate(plant, controller, on_circle()).control)
    assert run.report.fallbacks == 2
    held = reported_loop(plant, Affine(controller, failing=(5,)), on_circle(), fallback="soft")
    same(np.asarray(held.rollout.control)[5], np.asarray(held.rollout.control)[4])


def test_bad_input(any_type):
    plant, controller = zoo()
    with pytest.raises(ValueError, match="^fallback: there are hold and soft, received 'pray'$"):
        reported_loop(plant, Affine(controller), on_circle(), fallback="pray")
    late = along(circle(1e-3), 2.5e-5 * np.arange(5), 1e-3, PREVIEW, at_rest=False)
    blind = along(circle(1e-3), 2.5e-5 * np.arange(5), DT, PREVIEW - 1, at_rest=False)
    with pytest.raises(ValueError, match="^dt: the plant is sampled"):
        reported_loop(plant, Affine(controller), late)
    with pytest.raises(ValueError, match="^preview: the controller looks 3 samples ahead"):
        reported_loop(plant, Affine(controller), blind)
