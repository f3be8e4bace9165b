import equinox as eqx
import jax
import numpy as np
import pytest

from jcontour.linear.plant import LinearPlant
from jcontour.riccati.receding_horizon import (
    CostToGo,
    block_ends,
    blockwise_plan,
    readable_plan,
    receding_horizon_plan,
)


def horizon(samples, Q, y_d, R, H, g):
    """Gains F, f of the first step of one horizon; Q and y_d of its samples but the first.

    `samples` are A, B, C of each.
    """
    for (A, B, C), Q_j, y_j in zip(samples[:0:-1], Q[::-1], y_d[::-1], strict=True):
        closed = A - B @ np.linalg.solve(B.T @ H @ B + R, B.T @ H @ A)
        g = closed.T @ g - C.T @ Q_j @ y_j
        H = A.T @ H @ closed + C.T @ Q_j @ C
    A, B, _ = samples[0]
    M = B.T @ H @ B + R
    return np.linalg.solve(M, B.T @ H @ A), -np.linalg.solve(M, B.T @ g)


@pytest.mark.parametrize(
    ("plan_of", "changing"), [(receding_horizon_plan, False), (readable_plan, True)]
)
def test_gain_schedule_is_the_textbook_recursion_of_each_step(plan_of, changing):
    """eqs. 11-13 with a plain loop, one step of the run after the other."""
    random = np.random.default_rng(5)
    T, N, n, m, p = 6, 5, 5, 3, 2
    models = [random.standard_normal((T + N, *shape)) for shape in ((n, n), (n, p), (m, n))]
    if changing:
        model = eqx.filter_vmap(lambda *matrices: LinearPlant(*matrices, 1.0))(*models)
    else:
        models = [np.broadcast_to(M[0], M.shape) for M in models]
        model = LinearPlant(*(M[0] for M in models), 1.0)
    root, y_d = random.standard_normal((T + N, m, m)), random.standard_normal((T + N, m))
    Q, stage, R = root @ np.swapaxes(root, 1, 2), random.uniform(0.5, 2, N), np.diag([0.7, 1.3])
    H_N = np.stack([np.eye(n) * (1 + k) for k in range(T)])
    g_N = random.standard_normal((T, n))
    terminal = CostToGo(H_N, g_N)
    plan = jax.device_get(eqx.filter_jit(plan_of)(model, Q, y_d, stage, R, terminal))
    for k in range(T):
        samples, ahead = [*zip(*models, strict=True)][k : k + N], slice(k + 1, k + N)
        weights = stage[: N - 1, None, None] * Q[ahead]
        F, f = horizon(samples, weights, y_d[ahead], R, H_N[k], g_N[k])
        np.testing.assert_allclose(plan.F[k], F, rtol=1e-9, atol=1e-11)
        np.testing.assert_allclose(plan.f[k], f, rtol=1e-9, atol=1e-10)


@pytest.mark.parametrize(
    ("steps", "preview", "ends"),
    [
        (7, 3, (3, 6, 6, 6, 9, 9, 9)),  # the first block is one step long
        pytest.param(4, 4, (7, 7, 7, 7), marks=pytest.mark.slow),
        pytest.param(2, 5, (6, 6), marks=pytest.mark.slow),
        pytest.param(3, 1, (1, 2, 3), marks=pytest.mark.slow),  # a receding horizon
    ],
)
def test_every_step_is_a_horizon_up_to_the_end_of_its_block(coupled_plant, steps, preview, ends):
    """McNab & Tsao, eqs. 11-13, for every step by itself, in NumPy."""
    plant = coupled_plant(3, 4, 2)
    random, seen = np.random.default_rng(0), steps + preview
    roots, halves = random.standard_normal((seen, 2, 2)), random.standard_normal((steps, 4, 4))
    Q, H = roots @ roots.mT, halves @ halves.mT
    y_d, g = random.standard_normal((seen, 2)), random.standard_normal((steps, 4))
    R = 0.3 * np.eye(2)
    at = np.arange(seen)[block_ends(steps, preview)] - preview
    terminal = CostToGo(H[at], g[at])
    swept = jax.jit(blockwise_plan, static_argnums=5)
    actual = jax.device_get(swept(plant, Q, y_d, R, terminal, preview))
    for k, last in enumerate(ends):
        ahead, end = slice(k + 1, last), last - preview
        samples = [tuple(map(np.asarray, (plant.A, plant.B, plant.C)))] * (last - k)
        F, f = horizon(samples, Q[ahead], y_d[ahead], R, H[end], g[end])
        np.testing.assert_allclose(actual.F[k], F, rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(actual.f[k], f, rtol=1e-9, atol=1e-12)
