"""Generalised predictive control against a least-squares problem of a simulated model.

Predictive repetitive control against SciPy's Riccati solver, and its zeros.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.linalg

from jcontour.controllers.feedback.cascade import Cascade, CascadeGains
from jcontour.controllers.feedback.predictive import MOVES, PredictiveCascade, PredictiveRepetitive
from jcontour.controllers.feedback.state_feedback import accelerated_targets
from jcontour.sensors import motors
from jcontour.simulation.closed_loop import simulate
from tests.canonical import DT, STEPS, plant, reference, round_path

LAG, EFFORT, HORIZON = 5e-3, 1e-4, 8
LOOPS = Cascade(CascadeGains(30.0, 20.0, 0.02, inertia=0.1), motors(2), DT)


def ahead(state, commands):
    """States of the lag under commands, by its exact solution."""
    stays = np.exp(-DT / LAG)
    actual = []
    for u in commands:
        y, v = state
        state = y + u * DT + (v - u) * LAG * (1 - stays), u + (v - u) * stays
        actual.append(state)
    return np.array(actual)


def test_the_command_is_that_of_a_least_squares_problem():
    """The model is simulated; a constant error of its output stays ahead of it."""
    law, path = PredictiveCascade(LOOPS, LAG, EFFORT, HORIZON), reference(round_path(2), preview=8)
    before, last, error = (2e-3, 0.02), 0.03, np.array([1e-4, 0.0])
    now = ahead(before, [last])[0]

    def outputs(moves):
        later = np.concatenate([moves, np.zeros(HORIZON - len(moves))])
        return ahead(now, last + np.cumsum(later))[:, 0] + error[0]

    free = outputs(np.zeros(MOVES))
    G = np.stack([outputs(row) - free for row in np.eye(MOVES)], axis=1)
    wanted = np.asarray(path.position)[1 : HORIZON + 1, 0]
    A = np.vstack([G, np.sqrt(EFFORT) * np.eye(MOVES)])
    mu = np.linalg.lstsq(A, np.concatenate([wanted - free, np.zeros(MOVES)]), rcond=None)[0][0]

    state = np.tile(np.array(before) + error, (2, 1))
    start = law.initial_memory(path)
    memory = start._replace(state=jnp.asarray(state), command=jnp.full(2, last))
    row = jax.tree.map(lambda leaf: leaf[0], law.prepare(path))
    position, speed = now + error
    past, _ = law.step(memory, row, (np.full(2, position), np.full(2, speed)))
    assert float(past.command[0]) == pytest.approx(last + mu, rel=1e-8)


def test_bad_numbers_are_told():
    for name, lag, effort in (("lag", 0.0, EFFORT), ("effort", LAG, -1.0)):
        with pytest.raises(ValueError, match=name):
            PredictiveCascade(LOOPS, lag, effort, horizon=8)


TURN, HARMONICS, REPETITION, Q, R = 0.1, 2, 1e5, 1e7, 1.0


def law():
    machine = plant(2)
    weight = Q * machine.C.T @ machine.C
    return PredictiveRepetitive(machine, weight, R * jnp.eye(2), REPETITION, TURN, HARMONICS)


def augmented():
    """Model and resonators, put together axis by axis."""
    A, B, C = (np.asarray(matrix) for matrix in (plant(2).A, plant(2).B, plant(2).C))
    whole, entry = np.zeros((16, 16)), np.vstack([B, np.zeros((8, 2))])
    whole[:8, :8] = A
    for h in range(HARMONICS):
        c, s = np.cos((h + 1) * TURN), np.sin((h + 1) * TURN)
        for axis in range(2):
            first = 8 + 4 * h + 2 * axis
            whole[first : first + 2, first : first + 2] = [[c, s], [-s, c]]
            whole[first + 1, :8] = C[axis]
    return whole, entry


def test_the_run_is_that_of_a_regulator_of_both():
    machine, path, controller = plant(2), reference(round_path(2)), law()
    A, B = augmented()
    weight = np.diag([0.0] * 8 + [REPETITION] * 8)
    weight[:8, :8] = Q * np.asarray(machine.C).T @ np.asarray(machine.C)
    P = scipy.linalg.solve_discrete_are(A, B, weight, R * np.eye(2))
    K = np.linalg.solve(R * np.eye(2) + B.T @ P @ B, B.T @ P @ A)
    target = accelerated_targets(machine, path)
    x_d, u_d = np.asarray(target.state), np.asarray(target.control)
    start = x_d[0] + 1e-5 * np.random.default_rng(0).standard_normal(8)
    run = simulate(machine, controller, path, start)
    x, z = start, np.zeros(8)
    for k in range(STEPS):
        u = u_d[k] - K @ np.concatenate([x - x_d[k], z])
        np.testing.assert_allclose(run.control[k], u, rtol=1e-8, atol=1e-10)
        z = (A @ np.concatenate([x - x_d[k], z]))[8:]
        x = A[:8, :8] @ x + B[:8] @ u


def test_a_load_of_the_period_leaves_no_error():
    """The closed loop is stable, and has zeros from the load to the error at the harmonics."""
    A, B = augmented()
    closed = A - B @ np.asarray(law().gain)
    assert np.abs(np.linalg.eigvals(closed)).max() < 1
    for h, error in ((1, 1e-9), (2, 1e-9), (1.5, None)):
        answer = np.linalg.solve(np.exp(1j * h * TURN) * np.eye(16) - closed, B)[[0, 4]]
        still = np.linalg.norm(np.linalg.solve(np.eye(16) - closed, B)[[0, 4]])
        size = np.linalg.norm(answer) / still
        assert size > 1e-2 if error is None else size < error


def test_bad_periods_are_told():
    machine = plant(1)
    with pytest.raises(ValueError, match="harmonics: needs at least one"):
        PredictiveRepetitive(machine, jnp.eye(4), jnp.eye(1), 1.0, 0.1, 0)
    with pytest.raises(ValueError, match="between 0 and pi"):
        PredictiveRepetitive(machine, jnp.eye(4), jnp.eye(1), 1.0, 2.0, 2)
