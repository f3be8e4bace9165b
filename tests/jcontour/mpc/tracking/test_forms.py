"""The forms' predictions against a model that is stepped by hand, and a QP written from it."""

import numpy as np
import pytest
import qpsolvers
import scipy.linalg

from jcontour.controllers.lq.contouring_lq import OutputTerminal, RiccatiTerminal
from jcontour.controllers.observers.kalman import DisturbedState
from jcontour.geometry.contours import circle
from jcontour.linear.transformations import with_input_delay
from jcontour.motion.references import along
from jcontour.mpc.tracking.condense import predict
from jcontour.mpc.tracking.forms import AbsoluteForm, OffsetFreeForm, VelocityForm
from jcontour.mpc.tracking.limits import Limits
from jcontour.mpc.tracking.tracking_mpc import TrackingMPC, TrackingWeights


@pytest.fixture(scope="module")
def drawn(coupled_plant):
    """A dense plant, the last three states of a run under a constant load, and its controls."""
    plant, random = coupled_plant(1, 5, 2), np.random.default_rng(4)
    A, B = np.asarray(plant.A), np.asarray(plant.B)
    load, controls = random.standard_normal(5), random.standard_normal((4, 2))
    states = [random.standard_normal(5)]
    for u in controls:
        states.append(A @ states[-1] + B @ u + load)
    return plant, A, B, load, controls, np.array(states)


def test_the_velocity_form_finds_a_constant_load(drawn):
    _, A, B, load, controls, states = drawn
    actual = VelocityForm().disturbance(A, B, states[0], controls[0], states[1])
    np.testing.assert_allclose(actual.state, load, rtol=0, atol=1e-12)
    first = VelocityForm().disturbance(A, B, np.full(5, np.nan), controls[0], states[1])
    none = AbsoluteForm().disturbance(A, B, states[0], controls[0], states[1])
    for one in (first.state, none.state, actual.control, first.control, none.control):
        assert not one.any()
    for form in (AbsoluteForm(), VelocityForm()):
        np.testing.assert_array_equal(form.state(states[1]), states[1])


def test_the_offset_free_form_is_told_of_the_load(drawn):
    _, A, B, _, controls, states = drawn
    fed = DisturbedState(states[1], np.array([0.3, -0.2]))
    actual = OffsetFreeForm().disturbance(A, B, states[0], controls[0], fed)
    assert OffsetFreeForm().state(fed) is fed.state and actual.control is fed.disturbance
    assert actual.state.shape == (5,) and not actual.state.any()


@pytest.mark.parametrize("horizon", [1, 3])
def test_terminal_maps_are_the_last_state_and_the_last_change(drawn, horizon):
    plant, _, _, load, controls, states = drawn
    prediction = predict(plant, horizon)
    s = np.concatenate([states[0], np.zeros(2), load, np.zeros(2)])
    z = controls[:horizon].ravel()
    F, G = AbsoluteForm().terminal_maps(prediction)
    np.testing.assert_allclose(F @ s + G @ z, states[horizon], rtol=0, atol=1e-11)
    for one, other in zip(OffsetFreeForm().terminal_maps(prediction), (F, G), strict=True):
        np.testing.assert_array_equal(one, other)
    F, G = VelocityForm().terminal_maps(prediction)
    change, output = states[horizon] - states[horizon - 1], np.asarray(plant.C) @ states[horizon]
    np.testing.assert_allclose(F @ s + G @ z, np.append(change, output), rtol=0, atol=1e-11)


N, ALPHA, BETA, RHO, CHANGE = 6, 3.0, 50.0, 2e-7, 1e-7
BOUNDS = {"control": 0.3, "increment": 0.25, "speed": 0.15, "acceleration": 150.0}


def stepped(model, x0, felt):
    """States x_0..x_N under the control that the machine feels."""
    states = [x0]
    for v in felt:
        states.append(np.asarray(model.step(states[-1], v)))
    return np.array(states)


def qp_in_controls(model, fed, before, reference, stage, riccati):
    """The problem of sample 0 in u alone: cost of u + d, limits on u. Responses by simulation.

    Returns:
        H, g, G, h of 1/2 z' H z + g' z under G z <= h.
    """
    A, B, C = (np.asarray(matrix) for matrix in (model.A, model.B, model.C))
    x0, d = fed
    free = stepped(model, x0, np.tile(d, (N, 1)))
    units = np.eye(2 * N).reshape(2 * N, N, 2)
    pushed = np.array([stepped(model, 0 * x0, one) for one in units])  # (2 N, N + 1, n)
    H, g = 2 * RHO * np.eye(2 * N), 2 * RHO * np.tile(d, N)
    change = np.eye(2 * N) - np.eye(2 * N, k=-2)
    first = np.concatenate([before, np.zeros(2 * N - 2)])
    H += 2 * CHANGE * change.T @ change
    g -= 2 * CHANGE * change.T @ first
    for j in range(1, N + 1):
        tangent = np.asarray(reference.tangent[j])
        maps, weight = C, ALPHA * np.eye(2) + BETA * (np.eye(2) - np.outer(tangent, tangent))
        target = np.asarray(reference.position[j])
        if j == N and riccati:
            Q_max = (ALPHA + BETA) * C.T @ C
            maps, weight = (
                np.eye(len(A)),
                scipy.linalg.solve_discrete_are(A, B, Q_max, RHO * np.eye(2)),
            )
            increment = np.asarray(reference.position[N] - reference.position[N - 1])
            target = np.asarray(model.initial_state(target, increment))
        reach, error = (pushed[:, j] @ maps.T).T, maps @ free[j] - target
        H += 2 * stage[j - 1] * reach.T @ weight @ reach
        g += 2 * stage[j - 1] * reach.T @ weight @ error
    y, Y = free @ C.T, (pushed @ C.T).transpose(1, 2, 0)
    signals = {
        "control": (np.zeros(2 * N), np.eye(2 * N)),
        "increment": (-first, change),
        "speed": (np.diff(y, axis=0) / model.dt, np.diff(Y, axis=0) / model.dt),
        "acceleration": (np.diff(y, 2, axis=0) / model.dt**2, np.diff(Y, 2, axis=0) / model.dt**2),
    }
    rows = [
        np.concatenate([G.reshape(-1, 2 * N), -G.reshape(-1, 2 * N)]) for _, G in signals.values()
    ]
    room = [
        np.concatenate([BOUNDS[name] - f.ravel(), BOUNDS[name] + f.ravel()])
        for name, (f, _) in signals.items()
    ]
    return H, g, np.concatenate(rows), np.concatenate(room)


@pytest.mark.parametrize(
    ("terminal", "delay"),
    [(OutputTerminal(), 0), (RiccatiTerminal(), 1)],
    ids=["output", "riccati, late"],
)
def test_the_offset_free_plan_is_the_optimum_of_the_problem_written_in_controls(
    terminal, delay, two_axes
):
    model, stage = with_input_delay(two_axes, delay), np.linspace(1.0, 2.0, N)
    reference = along(circle(1e-3), 1e-4 * np.arange(4), model.dt, N, at_rest=True)
    weights = TrackingWeights(ALPHA, BETA, RHO, CHANGE, stage)
    limits = Limits.within(**BOUNDS)
    mpc = TrackingMPC(model, weights, N, limits, terminal, form=OffsetFreeForm())
    x0 = np.array(model.initial_state(np.asarray(reference.position)[0], np.zeros(2)))
    x0 += np.append([2e-4, 0.02, -3e-4, 0.01], np.full(2 * delay, 0.05))
    fed, before = DisturbedState(x0, np.array([0.2, -0.15])), np.array([0.1, -0.05])
    memory = mpc.initial_memory(reference)._replace(control=before)
    window = type(plan := mpc.prepare(reference))(*(np.asarray(rows)[0] for rows in plan))
    after, control, report = mpc.step(memory, window, fed)
    H, g, G, h = qp_in_controls(
        model, fed, before, reference, stage, isinstance(terminal, RiccatiTerminal)
    )
    size, scale = np.abs(G).max(axis=1), np.abs(H).max()
    kept = size > 1e-12 * size.max()  # a late control cannot change the first outputs
    G, h = G[kept] / size[kept, None], h[kept] / size[kept]
    problem = qpsolvers.Problem(H / scale, g / scale, G, h)
    wanted = qpsolvers.solve_problem(problem, "proxqp", eps_abs=1e-12, eps_rel=0.0)
    assert wanted.is_optimal(1e-9)
    np.testing.assert_allclose(control, wanted.x[:2], rtol=0, atol=1e-7)
    solution = mpc.solver.solve(mpc.problem(memory, window, fed))
    np.testing.assert_allclose(solution.z, wanted.x, rtol=0, atol=1e-7)
    assert report.active > 0 and np.count_nonzero(wanted.z > 1e-9) == report.active
    np.testing.assert_array_equal(after.state, x0)
    unlimited = np.linalg.solve(H, -g)
    assert np.abs(unlimited - solution.z).max() > 0.01


@pytest.mark.parametrize(
    ("form", "R", "S", "says"),
    [
        (AbsoluteForm(), 0.0, 0.0, "^control, increment: every control needs a weight"),
        (OffsetFreeForm(), 0.0, 0.0, "^control, increment: every control needs a weight"),
        (VelocityForm(), 1.0, 1.0, "^control: the velocity form weighs increments only"),
        (VelocityForm(), 0.0, 0.0, "^increment: needs to be positive definite"),
    ],
)
def test_weights_that_do_not_suit(form, R, S, says):
    with pytest.raises(ValueError, match=says):
        form.check_weights(R * np.eye(2), S * np.eye(2))
