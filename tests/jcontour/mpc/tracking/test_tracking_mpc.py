"""Tracking MPC: ContouringLQ without limits, within its limits, no offset in velocity form."""

from functools import cache

import numpy as np
import pytest

from jcontour.controllers.lq.contouring_lq import (
    ContouringLQ,
    LQWeights,
    OutputTerminal,
    RiccatiTerminal,
)
from jcontour.geometry.contours import circle, lemniscate, polygon
from jcontour.host.loop import Stopped, reported_loop
from jcontour.linear.plant import LinearPlant
from jcontour.motion.feed_laws import constant_feed
from jcontour.motion.references import along, from_samples
from jcontour.mpc.tracking.forms import AbsoluteForm, VelocityForm
from jcontour.mpc.tracking.limits import Limits
from jcontour.mpc.tracking.tracking_mpc import TrackingMPC, TrackingWeights
from jcontour.plants.linear_machines import bridgeport
from jcontour.qp.problem import check_shapes, check_weight
from jcontour.simulation.closed_loop import simulate

N = 6
SQUARE = [[0.0, 0.0], [2e-4, 0.0], [2e-4, 2e-4], [0.0, 2e-4]]
LIMITED = Limits.within(control=0.4, increment=0.3, speed=0.15, acceleration=300.0)


@cache
def shapes():
    steps = np.arange(30)
    return {
        "circle": along(circle(1e-3), 2e-5 * steps, 1e-3, N, at_rest=False),
        "square": along(polygon(SQUARE), 2e-5 * steps, 1e-3, N, at_rest=True),
        "eight": along(lemniscate(3e-3), 3e-5 * steps, 1e-3, N, at_rest=False),
    }


def test_the_acceleration_is_limited_from_the_sample_itself_on():
    """Second differences of the run: a limit that acts alone ahead lets one of them go over."""
    mill, limit = bridgeport(), 0.5
    path = circle(1e-3)
    arc = constant_feed(path, 0.05, mill.dt)[:80]
    reference = along(path, arc, mill.dt, 10, at_rest=False)
    weights, limits = TrackingWeights(1e8, increment=1.0), Limits.within(acceleration=limit)
    run = reported_loop(
        mill, TrackingMPC(mill, weights, 10, limits._replace(control=(-5, 5))), reference
    )
    actual = np.abs(np.diff(np.asarray(run.rollout.output), 2, axis=0)) / mill.dt**2
    assert actual.max() == pytest.approx(limit, rel=1e-6) and run.report.fallbacks == 0


def still(where, steps=40, preview=N, dt=1e-3):
    """A step in position: the tool starts at the origin, the reference stands at `where`."""
    position = np.tile(np.asarray(where, float), (steps + preview, 1))
    position[0] = 0.0
    return from_samples(
        position, np.tile([1.0, 0.0], (steps + preview, 1)), dt, preview, in_motion=False
    )


def offset_free(*arguments):
    return TrackingMPC(*arguments, form=VelocityForm())


def sample_of(plan, k):
    return type(plan)(*(rows[k] for rows in plan))


@pytest.mark.parametrize(
    ("terminal", "stage"),
    [(OutputTerminal(), np.ones(N)), (RiccatiTerminal(), np.linspace(1.0, 3.0, N))],
    ids=["output", "riccati"],
)
def test_without_an_active_limit_it_is_contouring_lq(terminal, stage, two_axes):
    plant, weights = two_axes, LQWeights(3.0, 50.0, 2e-8, stage)
    controller = ContouringLQ(plant, weights, N, terminal)
    mpc = TrackingMPC(
        plant,
        TrackingWeights.of(weights),
        N,
        Limits.within(control=1e3, increment=1e3, speed=1e3),
        terminal,
    )
    for reference in shapes().values():
        run, wanted = reported_loop(plant, mpc, reference), simulate(plant, controller, reference)
        scale = np.abs(wanted.control).max()
        np.testing.assert_allclose(run.rollout.control, wanted.control, rtol=0, atol=1e-9 * scale)
        np.testing.assert_allclose(
            run.rollout.output, wanted.output, rtol=0, atol=1e-9 * np.abs(wanted.output).max()
        )
        assert run.report.active_fraction == 0 and run.report.worst_residual <= 1e-8


@pytest.mark.slow
def test_horizon_of_one(two_axes):
    plant, weights = two_axes, LQWeights(3.0, 50.0, 2e-8)
    for terminal in (OutputTerminal(), RiccatiTerminal()):
        wanted = simulate(plant, ContouringLQ(plant, weights, 1, terminal), shapes()["circle"])
        actual = reported_loop(
            plant,
            TrackingMPC(plant, TrackingWeights.of(weights), 1, terminal=terminal),
            shapes()["circle"],
        ).rollout
        np.testing.assert_allclose(
            actual.control, wanted.control, rtol=0, atol=1e-9 * np.abs(wanted.control).max()
        )


def test_every_limit_holds_along_the_run(two_axes):
    plant = two_axes
    mpc = TrackingMPC(plant, TrackingWeights(3.0, 50.0, 2e-8), N, LIMITED)
    run = reported_loop(plant, mpc, still([2e-3, -1e-3], 60))
    control, output = np.asarray(run.rollout.control), np.asarray(run.rollout.output)
    speed = np.diff(output, axis=0) / plant.dt
    for values, bound in (
        (control, 0.4),
        (np.diff(control, axis=0), 0.3),
        (speed, 0.15),
        (np.diff(speed, axis=0) / plant.dt, 300.0),
    ):
        assert np.abs(values).max() <= bound * (1 + 1e-6)
    assert np.abs(control).max() > 0.39 or np.abs(speed).max() > 0.149
    assert 0 < run.report.active_fraction < 1
    np.testing.assert_allclose(output[-1], [2e-3, -1e-3], atol=2e-5)


def test_soft_limits_are_exact_where_the_hard_problem_has_an_answer(two_axes):
    plant, reference = two_axes, still([2e-3, -1e-3])
    weights = TrackingWeights(3.0, 50.0, 2e-8)
    hard = reported_loop(plant, TrackingMPC(plant, weights, N, LIMITED), reference).rollout
    soft = reported_loop(plant, TrackingMPC(plant, weights, N, LIMITED, penalty=1e5), reference)
    np.testing.assert_allclose(soft.rollout.control, hard.control, rtol=0, atol=1e-7)
    assert soft.report.slack.max() <= 1e-9


def test_an_output_limit_out_of_reach_stops_the_run_or_gives_way(two_axes):
    """The tool comes in too fast to stay inside: hard is infeasible, soft returns early."""
    plant, reference = two_axes, still([0.9e-3, 0.0])
    limits = Limits(control=(-0.4, 0.4), output=(-1e-3, 1e-3))
    fast = np.array([0.99e-3, 0.5, 0.0, 0.0])
    weights = TrackingWeights(3.0, 5.0, 2e-8)
    with pytest.raises(
        Stopped, match="^step 0: daqp did not solve the QP .*: infeasible"
    ) as caught:
        reported_loop(plant, TrackingMPC(plant, weights, N, limits), reference, fast)
    assert caught.value.step == 0
    run = reported_loop(
        plant, TrackingMPC(plant, weights, N, limits), reference, fast, fallback="soft"
    )
    assert 0 < run.report.fallbacks < 20 and run.report.fallback[0]
    output = np.asarray(run.rollout.output)
    assert np.asarray(run.report.slack)[0] == pytest.approx(output[1:N].max() - 1e-3, rel=0.5)
    assert np.abs(output[-10:]).max() <= 1e-3 + 1e-9
    always = reported_loop(
        plant, TrackingMPC(plant, weights, N, limits, penalty=1e5), reference, fast
    )
    assert always.report.fallbacks == 0
    np.testing.assert_allclose(always.rollout.output, run.rollout.output, rtol=0, atol=1e-9)


class Loaded(LinearPlant):
    """The table under a constant load on its controls."""

    def step(self, state, control):
        return super().step(state, control + np.array([0.05, -0.02]))


@pytest.mark.parametrize(
    "terminal", [OutputTerminal(), RiccatiTerminal()], ids=["output", "riccati"]
)
def test_the_velocity_form_leaves_no_offset(terminal, two_axes):
    plant, reference = two_axes, still([1e-3, 5e-4], 200, 12)
    loaded = Loaded(plant.A, plant.B, plant.C, plant.dt)
    limits = Limits.within(control=0.5, increment=0.4)
    free = reported_loop(
        loaded,
        offset_free(plant, TrackingWeights(1.0, increment=1e-7), 12, limits, terminal),
        reference,
    ).rollout
    absolute = reported_loop(
        loaded,
        TrackingMPC(plant, TrackingWeights(1.0, control=1e-7), 12, limits, terminal),
        reference,
    ).rollout
    end = np.asarray(reference.position)[-1]
    assert np.abs(np.asarray(free.output)[-1] - end).max() <= 1e-12
    assert np.abs(np.asarray(absolute.output)[-1] - end).max() >= 1e-6


def test_the_problem_is_well_posed_and_belongs_to_whom_asked_for_it(two_axes):
    plant, reference = two_axes, still([2e-3, -1e-3])
    mpc = TrackingMPC(plant, TrackingWeights(3.0, 50.0, 2e-8), N, LIMITED)
    plan, memory = mpc.prepare(reference), mpc.initial_memory(reference)
    first = mpc.problem(memory, sample_of(plan, 0), np.zeros(4))
    kept = [np.array(field) for field in first]
    check_shapes(first)
    check_weight("H", first.H)
    assert np.abs(first.H).max() == pytest.approx(1, rel=0.5)
    mpc.step(memory, sample_of(plan, 1), np.full(4, 1e-4))
    for field, before in zip(first, kept, strict=True):
        np.testing.assert_array_equal(field, before)
    assert mpc.problem(memory, sample_of(plan, 1), np.zeros(4), out=first) is first


@pytest.mark.parametrize("form", [AbsoluteForm(), VelocityForm()])
def test_two_runs_of_one_controller_are_two_runs(form, two_axes):
    """Sample by sample in turns, towards different points, as each alone: to the last bit."""
    plant, weights = two_axes, TrackingWeights(3.0, 50.0, increment=2e-8)
    mpc = TrackingMPC(plant, weights, N, LIMITED, form=form)
    references = [still([2e-3, -1e-3]), still([-1e-3, 1.5e-3])]
    wanted = [
        reported_loop(plant, TrackingMPC(plant, weights, N, LIMITED, form=form), one).rollout
        for one in references
    ]
    plans = [mpc.prepare(one) for one in references]
    memories = [mpc.initial_memory(one) for one in references]
    for k in range(references[0].steps):
        for i, run in enumerate(wanted):
            state = np.asarray(run.state[k])
            memories[i], control, _ = mpc.step(memories[i], sample_of(plans[i], k), state)
            np.testing.assert_array_equal(control, np.asarray(run.control)[k])
    assert not np.array_equal(wanted[0].control, wanted[1].control)


BAD = {
    "increment: the limits need lower <= upper, received 0.1 and -0.1": dict(
        limits=Limits(increment=(0.1, -0.1))
    ),
    r"output: needs one bound or one per component, shape \(2,\), received \(3,\)": dict(
        limits=Limits.within(output=[1.0, 2.0, 3.0])
    ),
    "output: needs to be positive semidefinite": dict(weights=TrackingWeights(-1.0, control=1.0)),
    "output: needs to be symmetric": dict(
        weights=TrackingWeights([[1.0, 0.5], [0.0, 1.0]], control=1.0)
    ),
    r"control: needs a number, \(2,\) or \(2, 2\)": dict(
        weights=TrackingWeights(1.0, control=[1.0, 1.0, 1.0])
    ),
    "control, increment: every control needs a weight": dict(weights=TrackingWeights(1.0)),
    "contour: needs a finite weight": dict(weights=TrackingWeights(1.0, -2.0, 1.0)),
    "stage: needs 6 finite entries above zero": dict(
        weights=TrackingWeights(1.0, 0.0, 1.0, stage=np.ones(5))
    ),
    "preview: needs a whole number of at least 1, received 0": dict(preview=0),
    "penalty: needs to be finite": dict(penalty=-1.0),
}


@pytest.mark.parametrize("message", BAD)
def test_bad_input(message, two_axes):
    arguments = (
        dict(model=two_axes, weights=TrackingWeights(1.0, control=1.0), preview=N) | BAD[message]
    )
    with pytest.raises(ValueError, match=f"^{message}"):
        TrackingMPC(**arguments)


def test_a_start_outside_the_limits(two_axes):
    mpc = TrackingMPC(two_axes, TrackingWeights(1.0, control=1.0), N, Limits(output=(5e-4, 1.0)))
    with pytest.raises(ValueError, match="^output: the start is outside the limits"):
        reported_loop(two_axes, mpc, still([1e-3, 1e-3]))
    with pytest.raises(ValueError, match="^control: the velocity form weighs increments only"):
        offset_free(two_axes, TrackingWeights(1.0, control=1.0, increment=1.0), N)
