"""Dynamic surface and adaptive robust control against recursions in NumPy."""

import numpy as np
import pytest

from jcontour.controllers.feedback.cascade import Cascade, CascadeGains
from jcontour.controllers.feedback.sliding_mode import AdaptiveRobust, DynamicSurface
from jcontour.controllers.wrappers.adapters import SpeedByDifference
from jcontour.plants.encoders import Encoders
from jcontour.sensors import Sensors, motors
from jcontour.simulation.closed_loop import simulate
from tests.canonical import DT, STEPS, plant, reference, round_path

K_1, K_2, K_A, K_V, K_C, LIMIT = 30.0, 2.0, 0.01, 1.1, 0.02, 0.2


def run(law):
    gains = CascadeGains(K_1, K_2, 0.05, 1.0, K_A, K_V, K_C)
    path = reference(round_path(2))
    inner = law(Cascade(gains, motors(2), DT, LIMIT))
    wrapped = SpeedByDifference(inner, Sensors([0, 1]), DT)
    start = np.asarray(plant(2).initial_state(path.position[0], path.start_increment))
    found = simulate(Encoders(plant(2)), wrapped, path, start + 1e-5)
    r, y = np.asarray(path.position), np.asarray(found.measurement)
    r_dot = np.diff(r[: STEPS + 1], axis=0) / DT
    before = np.asarray(path.start_increment)[None]
    r_dd = np.diff(r_dot, axis=0, prepend=before / DT) / DT
    v = np.diff(y, axis=0, prepend=r[:1] - before) / DT
    return r[:STEPS], r_dot, r_dd, y, v, np.asarray(found.control)


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
