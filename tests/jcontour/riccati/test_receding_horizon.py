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


def test_gain_schedule_is_the_textbook_recursion_of_each_step():
    """eqs. 11-13 with a plain loop, one step of the run after the other."""
    random = np.random.default_rng(5)
    T, N, n, m, p = 6, 5, 5, 3, 2
    A, B, C = (random.standard_normal(shape) for shape in ((n, n), (n, p), (m, n)))
    root, y_d = random.standard_normal((T + N, m, m)), random.standard_normal((T + N, m))
    Q, stage, R = root @ np.swapaxes(root, 1, 2), random.uniform(0.5, 2, N), np.diag([0.7, 1.3])
    H_N = np.stack([np.eye(n) * (1 + k) for k in range(T)])
    g_N = random.standard_normal((T, n))
    arrays, terminal = (Q, y_d, stage, R), CostToGo(H_N, g_N)
    plan = jax.device_get(
        eqx.filter_jit(receding_horizon_plan)(LinearPlant(A, B, C, 1.0), *arrays, terminal)
    )
    for k in range(T):
        H, g = H_N[k], g_N[k]
        for j in range(N - 1, 0, -1):
            K = np.linalg.solve(B.T @ H @ B + R, B.T @ H @ A)
            Q_j = stage[j - 1] * Q[k + j]
            g = (A - B @ K).T @ g - C.T @ Q_j @ y_d[k + j]
            H = A.T @ H @ (A - B @ K) + C.T @ Q_j @ C
        M = np.linalg.inv(B.T @ H @ B + R)
        np.testing.assert_allclose(plan.F[k], M @ B.T @ H @ A, rtol=1e-9, atol=1e-11)
        np.testing.assert_allclose(plan.f[k], -M @ B.T @ g, rtol=1e-9, atol=1e-10)


def test_scheduled_gains_take_the_model_of_each_sample():
    """The same recursion with A, B, C of sample k + j."""
    random = np.random.default_rng(7)
    T, N, n, m, p = 4, 5, 4, 2, 3
    A, B, C = (random.standard_normal((T + N, *shape)) for shape in ((n, n), (n, p), (m, n)))
    root, y_d = random.standard_normal((T + N, m, m)), random.standard_normal((T + N, m))
    Q, stage, R = (
        root @ np.swapaxes(root, 1, 2),
        random.uniform(0.5, 2, N),
        np.diag([0.7, 1.3, 2.0]),
    )
    H_N = np.stack([np.eye(n) * (1 + k) for k in range(T)])
    g_N = random.standard_normal((T, n))
    arrays, terminal = (Q, y_d, stage, R), CostToGo(H_N, g_N)
    models = eqx.filter_vmap(lambda *matrices: LinearPlant(*matrices, 1.0))
    models = eqx.filter_jit(models)(A, B, C)
    plan = jax.device_get(eqx.filter_jit(readable_plan)(models, *arrays, terminal))
    for k in range(T):
        H, g = H_N[k], g_N[k]
        for j in range(N - 1, 0, -1):
            A_j, B_j, C_j, Q_j = A[k + j], B[k + j], C[k + j], stage[j - 1] * Q[k + j]
            K = np.linalg.solve(B_j.T @ H @ B_j + R, B_j.T @ H @ A_j)
            g = (A_j - B_j @ K).T @ g - C_j.T @ Q_j @ y_d[k + j]
            H = A_j.T @ H @ (A_j - B_j @ K) + C_j.T @ Q_j @ C_j
        M = np.linalg.inv(B[k].T @ H @ B[k] + R)
        np.testing.assert_allclose(plan.F[k], M @ B[k].T @ H @ A[k], rtol=1e-9, atol=1e-11)
        np.testing.assert_allclose(plan.f[k], -M @ B[k].T @ g, rtol=1e-9, atol=1e-10)


def horizon(model, Q, y_d, R, H, g):
    """Gains F, f of the first step of one horizon; Q and y_d of its samples but the last."""
    A, B, C = (np.asarray(M) for M in (model.A, model.B, model.C))
    for Q_j, y_j in zip(Q[::-1], y_d[::-1], strict=True):
        closed = A - B @ np.linalg.solve(B.T @ H @ B + R, B.T @ H @ A)
        g = closed.T @ g - C.T @ Q_j @ y_j
        H = A.T @ H @ closed + C.T @ Q_j @ C
    M = B.T @ H @ B + R
    return np.linalg.solve(M, B.T @ H @ A), -np.linalg.solve(M, B.T @ g)


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
        F, f = horizon(plant, Q[ahead], y_d[ahead], R, H[end], g[end])
        np.testing.assert_allclose(actual.F[k], F, rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(actual.f[k], f, rtol=1e-9, atol=1e-12)
