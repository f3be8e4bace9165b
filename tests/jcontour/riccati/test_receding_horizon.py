import equinox as eqx
import jax
import numpy as np

from jcontour.linear.plant import LinearPlant
from jcontour.riccati.receding_horizon import (
    CostToGo,
    receding_horizon_plan,
    scheduled_plan,
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
    plan = jax.device_get(eqx.filter_jit(scheduled_plan)(models, *arrays, terminal))
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
