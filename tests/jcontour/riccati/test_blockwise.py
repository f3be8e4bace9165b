import jax
import numpy as np
import pytest

from jcontour.riccati.blockwise import block_ends, blockwise_plan
from jcontour.riccati.receding_horizon import CostToGo


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
    found = jax.device_get(swept(plant, Q, y_d, R, terminal, preview))
    for k, last in enumerate(ends):
        ahead, end = slice(k + 1, last), last - preview
        F, f = horizon(plant, Q[ahead], y_d[ahead], R, H[end], g[end])
        np.testing.assert_allclose(found.F[k], F, rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(found.f[k], f, rtol=1e-9, atol=1e-12)
