"""Sliding mode control against its own equations, solved by others."""

import numpy as np
import pytest
import scipy.linalg

from jcontour.controllers.feedback.sliding_mode import (
    BoundaryLayer,
    SlidingMode,
    SuperTwisting,
    riccati_surface,
)
from jcontour.controllers.feedback.state_feedback import moving_target
from jcontour.simulation.closed_loop import simulate
from tests.canonical import STEPS, plant, reference, round_path

LAYER, TWISTING = BoundaryLayer(0.1, 0.02, 0.05), SuperTwisting(0.02, 3e-3)
Q, R = 1e8, 1.0


def layer(s, w):
    return 0.9 * s - 0.02 * np.clip(s / 0.05, -1, 1), w


def twisting(s, w):
    """The inclusion by bisection: n grows with the residual."""
    low, high = -np.abs(s + w) - 1.0, np.abs(s + w) + 1.0
    for _ in range(200):
        n = (low + high) / 2
        left = n + 0.02 * np.sqrt(np.abs(n)) * np.sign(n) + 3e-3 * np.sign(n) < s + w
        low, high = np.where(left, n, low), np.where(left, high, n)
    n = (low + high) / 2
    return n, n - s + 0.02 * np.sqrt(np.abs(n)) * np.sign(n)


def made(reaching, integral):
    machine = plant(2)
    surface, gain = riccati_surface(machine, Q * machine.C.T @ machine.C, R * np.eye(2))
    return SlidingMode(machine, surface, reaching, gain if integral else None)


@pytest.mark.parametrize("integral", [False, True])
@pytest.mark.parametrize(("reaching", "answer"), [(LAYER, layer), (TWISTING, twisting)])
def test_the_surface_follows_the_reaching_law_from_a_disturbed_start(reaching, answer, integral):
    """By a recursion in NumPy whose Riccati equation and inclusion are solved by others."""
    machine, path = plant(2), reference(round_path(2))
    A, B, C = (np.asarray(matrix) for matrix in (machine.A, machine.B, machine.C))
    P = scipy.linalg.solve_discrete_are(A, B, Q * C.T @ C, R * np.eye(2))
    S = np.linalg.solve(B.T @ P @ B, B.T @ P)
    K = np.linalg.solve(R * np.eye(2) + B.T @ P @ B, B.T @ P @ A) if integral else S @ A
    target, y = moving_target(machine), np.asarray(path.position)
    x_d = y[:-1] @ np.asarray(target.state).T
    x_d = x_d + np.diff(y, axis=0) @ np.asarray(target.state_moving).T
    start = x_d[0] + 1e-5 * np.random.default_rng(0).standard_normal(8)
    run = simulate(machine, made(reaching, integral), path, start)
    x, w, gathered = start, np.zeros(2), np.zeros(2)
    for k in range(STEPS):
        error = x - x_d[k]
        sigma = S @ error + gathered
        n, w = answer(sigma, w)
        u = S @ (x_d[k + 1] - A @ x_d[k]) - K @ error + n - (sigma if integral else 0.0)
        gathered = sigma - S @ (A - B @ K) @ error if integral else gathered
        np.testing.assert_allclose(run.control[k], u, rtol=1e-8, atol=1e-10)
        x = A @ x + B @ u
        if not integral:
            np.testing.assert_allclose(S @ (x - x_d[k + 1]), n, rtol=0, atol=1e-9)


def test_the_surface_of_a_riccati_equation_is_stable():
    for seed in range(20):
        random = np.random.default_rng(seed)
        A, B = random.standard_normal((4, 4)), random.standard_normal((4, 2))
        P = scipy.linalg.solve_discrete_are(A, B, np.eye(4), np.eye(2))
        S = np.linalg.solve(B.T @ P @ B, B.T @ P)
        left = A - B @ S @ A
        assert np.linalg.eigvalsh(P - left.T @ P @ left).min() > 0


def test_a_surface_without_relative_degree_one_is_refused():
    machine = plant(2)
    with pytest.raises(ValueError, match="relative degree one"):
        SlidingMode(machine, machine.C, LAYER)
