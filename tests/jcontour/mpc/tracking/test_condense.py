"""The condensed problem against simulations of the model."""

import numpy as np
import pytest

from jcontour.linear.transformations import with_input_delay
from jcontour.mpc.tracking.condense import (
    Condensed,
    TerminalMaps,
    Window,
    difference_maps,
    limit_rows,
    predict,
)
from jcontour.mpc.tracking.limits import Limits, full_limits
from jcontour.qp.problem import check_shapes, check_weight

N = 5


@pytest.fixture
def drawn(coupled_plant):
    """A dense plant, what is known at the sample (x_0, u_{-1}, w, d), and some controls."""
    plant, random = coupled_plant(1, 5, 2), np.random.default_rng(2)
    known = [random.standard_normal(size) for size in (5, 2, 5, 2)]
    known[2] *= 0.1
    return plant, known, random.standard_normal((N, 2))


def simulated(plant, known, controls):
    x0, _, w, d = known
    states = [x0]
    for u in controls:
        states.append(np.asarray(plant.A) @ states[-1] + np.asarray(plant.B) @ (u + d) + w)
    return np.array(states), np.array(states) @ np.asarray(plant.C).T


def test_predictions_are_simulations(drawn):
    plant, known, controls = drawn
    states, outputs = simulated(plant, known, controls)
    one, s, z = predict(plant, N), np.concatenate(known), controls.ravel()
    np.testing.assert_allclose(one.Fx @ s + one.Gx @ z, states[1:], rtol=0, atol=1e-12)
    np.testing.assert_allclose(one.Fy @ s + one.Gy @ z, outputs[1:], rtol=0, atol=1e-12)
    Fu, Gu = difference_maps(N, 2, 5)
    np.testing.assert_allclose(
        Fu @ s + Gu @ z, np.diff(np.vstack([known[1], controls]), axis=0), rtol=0, atol=1e-14
    )


def output_before(plant, known):
    """y_{-1}: the output of the state from which the last control led to the state now."""
    x0, control, w, d = known
    A, B = np.asarray(plant.A), np.asarray(plant.B)
    return np.asarray(plant.C) @ np.linalg.inv(A) @ (x0 - w - B @ (control + d))


def test_rows_are_the_signals_they_limit(drawn):
    plant, known, controls = drawn
    limits = full_limits(
        Limits.within(
            increment=1.0,
            state=[2.0, np.inf, np.inf, np.inf, 3.0],
            output=4.0,
            speed=5.0,
            acceleration=6.0,
        ),
        plant,
    )
    rows = limit_rows(plant, predict(plant, N), limits)
    states, outputs = simulated(plant, known, controls)
    wanted = [
        np.diff(np.vstack([known[1], controls]), axis=0),
        states[1:, [0, 4]],
        outputs[1:],
        np.diff(outputs, axis=0) / plant.dt,
        np.diff(np.vstack([output_before(plant, known), outputs]), 2, axis=0) / plant.dt**2,
    ]
    bounds = [
        np.full(10, 1.0),
        np.tile([2.0, 3.0], N),
        np.full(10, 4.0),
        np.full(10, 5.0),
        np.full(10, 6.0),
    ]
    actual = rows.size * (rows.C @ controls.ravel() + rows.F @ np.concatenate(known))
    np.testing.assert_allclose(
        actual, np.concatenate([part.ravel() for part in wanted]), rtol=1e-9, atol=1e-9
    )
    np.testing.assert_allclose(rows.size * rows.upper, np.concatenate(bounds), rtol=1e-12)
    assert (
        np.abs(rows.C).max(axis=1) == pytest.approx(1.0)
        and rows.soft.tolist() == [False] * 10 + [True] * 40
    )


def cost_of(plant, known, controls, Q, y_d, P, xi_d, R, S, stage):
    """The cost written as the docstring has it."""
    states, outputs = simulated(plant, known, controls)
    e, du = outputs[1:N] - y_d, np.diff(np.vstack([known[1], controls]), axis=0)
    felt = controls + known[3]
    last = states[N] - xi_d
    running = sum(stage[j] * e[j] @ Q[j] @ e[j] for j in range(N - 1))
    return (
        running
        + np.einsum("ja,ab,jb", felt, R, felt)
        + np.einsum("ja,ab,jb", du, S, du)
        + last @ P @ last
    )


@pytest.mark.parametrize("penalty", [None, 7.0])
def test_the_cost_up_to_a_constant(drawn, penalty):
    plant, known, controls = drawn
    random = np.random.default_rng(3)

    def psd(*shape):
        M = random.standard_normal((*shape, shape[-1]))
        return M @ np.swapaxes(M, -1, -2)

    Q, P, R, S, stage = psd(N - 1, 2), psd(5), psd(2), psd(2), 1 + random.random(N)
    y_d, xi_d = random.standard_normal((N - 1, 2)), random.standard_normal(5)
    s = np.concatenate(known)
    one = predict(plant, N)
    limits = full_limits(Limits.within(control=1.0, output=0.5), plant)
    maps = TerminalMaps(one.Fx[-1], one.Gx[-1], P)
    problem = Condensed(plant, R, S, stage, np.eye(2), maps, limits, penalty)
    window = Window(Q, y_d, P, xi_d, np.zeros(2))
    qp = problem.problem(s, window)
    check_shapes(qp)
    check_weight("H", qp.H)
    again = problem.problem(2 * s, window)
    again = problem.problem(s, window, out=again)  # writing over another leaves nothing of it
    for field, fresh in zip(again, qp, strict=True):
        np.testing.assert_array_equal(field, fresh)
    slack = np.zeros(qp.g.size - 2 * N)
    other = random.standard_normal((N, 2))

    def quadratic(u):
        z = np.concatenate([u.ravel(), slack])
        return (z @ qp.H @ z / 2 + qp.g @ z) / problem.cost.scale

    wanted = [cost_of(plant, known, u, Q, y_d, P, xi_d, R, S, stage) for u in (controls, other)]
    assert quadratic(controls) - quadratic(other) == pytest.approx(wanted[0] - wanted[1], rel=1e-10)
    _, outputs = simulated(plant, known, controls)
    values = qp.C[:, : 2 * N] @ controls.ravel()
    room = (qp.upper_rows - values)[: 2 * N] * problem.rows.size
    np.testing.assert_allclose(room, 0.5 - outputs[1:].ravel(), atol=1e-11)
    if penalty is not None:
        assert (qp.g[2 * N :] == penalty).all() and len(qp.upper_rows) == 4 * N
        z = np.concatenate([controls.ravel(), np.maximum(-room, 0) / problem.rows.size])
        assert problem.slack(z) == pytest.approx(max(-room.min(), 0.0))


def test_rows_out_of_reach_are_left_out(coupled_plant):
    """A control that acts two samples late cannot change the first output."""
    plant = coupled_plant(1, 5, 2)
    late = with_input_delay(plant, 1)
    rows = limit_rows(late, predict(late, N), full_limits(Limits.within(output=1.0), late))
    assert len(rows.size) == 2 * (N - 1)
