"""Sliding mode control against its own equations, solved by others.

Dynamic surface and adaptive robust control against recursions in NumPy.
"""

import numpy as np
import pytest
import scipy.linalg

from jcontour.controllers.feedback.cascade import Cascade, CascadeGains
from jcontour.controllers.feedback.sliding_mode import (
    AdaptiveRobust,
    BoundaryLayer,
    DynamicSurface,
    SlidingMode,
    SuperTwisting,
    riccati_surface,
)
from jcontour.controllers.feedback.state_feedback import moving_target
from jcontour.controllers.wrappers.adapters import SpeedByDifference
from jcontour.plants.encoders import Encoders
from jcontour.sensors import Sensors, motors
from jcontour.simulation.closed_loop import simulate
from tests.canonical import DT, STEPS, plant, reference, round_path

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


K_1, K_2, K_A, K_V, K_C, LIMIT = 30.0, 2.0, 0.01, 1.1, 0.02, 0.2


def run(law):
    gains = CascadeGains(K_1, K_2, 0.05, 1.0, K_A, K_V, K_C)
    path = reference(round_path(2))
    inner = law(Cascade(gains, motors(2), DT, LIMIT))
    wrapped = SpeedByDifference(inner, Sensors([0, 1]), DT)
    start = np.asarray(plant(2).initial_state(path.position[0], path.start_increment))
    actual = simulate(Encoders(plant(2)), wrapped, path, start + 1e-5)
    r, y = np.asarray(path.position), np.asarray(actual.measurement)
    r_dot = np.diff(r[: STEPS + 1], axis=0) / DT
    before = np.asarray(path.start_increment)[None]
    r_dd = np.diff(r_dot, axis=0, prepend=before / DT) / DT
    v = np.diff(y, axis=0, prepend=r[:1] - before) / DT
    return r[:STEPS], r_dot, r_dd, y, v, np.asarray(actual.control)


def test_dynamic_surface():
    r, r_dot, _, y, v, control = run(lambda loops: DynamicSurface(loops, 4e-3))
    alpha = r_dot[0]
    first = np.asarray(reference(round_path(2)).start_increment) / DT
    alpha = first
    for k in range(STEPS):
        virtual = r_dot[k] + K_1 * (r[k] - y[k])
        slope = (virtual - alpha) / 4e-3
        u = K_A * slope + K_V * r_dot[k] + K_C * np.sign(r_dot[k]) + K_2 * (alpha - v[k])
        np.testing.assert_allclose(control[k], np.clip(u, -LIMIT, LIMIT), rtol=1e-8, atol=1e-12)
        alpha = virtual + (alpha - virtual) * np.exp(-DT / 4e-3)


def test_adaptive_robust():
    share, load, rate = 0.3, 5e-3, 40.0
    r, r_dot, r_dd, y, v, control = run(lambda loops: AdaptiveRobust(loops, rate, share, load))
    theta = np.tile([K_A, K_V, K_C, 0.0], (2, 1))
    reach = np.array([share * K_A, share * K_V, load, load])
    low, high, bounded = theta - reach, theta + reach, False
    for k in range(STEPS):
        psi = np.stack([r_dd[k], r_dot[k], np.sign(r_dot[k]), np.ones(2)], axis=1)
        p = v[k] - r_dot[k] + K_1 * (y[k] - r[k])
        free = (theta * psi).sum(1) - K_A * K_1 * (v[k] - r_dot[k]) - K_2 * p
        u = np.clip(free, -LIMIT, LIMIT)
        np.testing.assert_allclose(control[k], u, rtol=1e-8, atol=1e-12)
        learned = rate * K_2 * DT * np.where(free == u, p, 0.0)[:, None]
        moved = theta - learned * np.array([1.0, 100.0, 1.0, 1.0]) * psi
        theta = np.clip(moved, low, high)
        bounded = bounded or (theta != moved).any()
    assert bounded


def test_a_lag_of_zero_is_refused():
    loops = Cascade(CascadeGains(K_1, K_2, 0.05), motors(2), DT)
    with pytest.raises(ValueError, match="lag: needs to be finite and above zero"):
        DynamicSurface(loops, 0.0)
