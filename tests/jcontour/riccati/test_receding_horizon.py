import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.linalg import solve_discrete_are

from jcontour.linear.plant import LinearPlant, spectral_radius
from jcontour.riccati.algebraic import check_dare, dare, lqr_gain, small_inverse
from jcontour.riccati.receding_horizon import CostToGo, receding_horizon_plan, scheduled_plan


def system(seed, states, inputs, radius=1.2):
    """An unstable controllable system with full-rank weights."""
    random = np.random.default_rng(seed)
    A = random.standard_normal((states, states))
    A *= radius / np.abs(np.linalg.eigvals(A)).max()
    B, W = random.standard_normal((states, inputs)), random.standard_normal((states, states))
    V = random.standard_normal((inputs, inputs))
    return A, B, W @ W.T / states, V @ V.T + np.eye(inputs)


@pytest.mark.parametrize(("states", "inputs"), [(4, 2), (12, 3)])
def test_dare_is_that_of_scipy(states, inputs):
    solve = jax.jit(lambda A, B, Q, R: ((H := dare(A, B, Q, R)), lqr_gain(A, B, H, R)))
    for seed in range(5):
        A, B, Q, R = system(seed, states, inputs)
        (H, gain), wanted = solve(A, B, Q, R), solve_discrete_are(A, B, Q, R)
        assert np.max(np.abs(H - wanted)) < 1e-9 * np.max(np.abs(wanted))
        K = np.linalg.solve(B.T @ wanted @ B + R, B.T @ wanted @ A)
        np.testing.assert_allclose(gain, K, rtol=1e-8, atol=1e-9)
        assert spectral_radius(A - B @ K) < 1


def test_gradient_of_dare_is_that_of_differences():
    A, B, Q, R = system(3, 4, 2)
    random = np.random.default_rng(0)
    weight = random.standard_normal((4, 4))

    def value(arguments):
        return jnp.sum(weight * dare(*arguments))

    slopes = jax.jit(jax.grad(value))((A, B, Q, R))
    wanted = lambda *arguments: np.sum(weight * solve_discrete_are(*arguments))  # noqa: E731
    for index, slope in enumerate(slopes):
        change = random.standard_normal(slope.shape)
        change = change + change.T if index > 1 else change
        h = 1e-5
        ahead, behind = (
            [m + s * h * change if i == index else m for i, m in enumerate((A, B, Q, R))]
            for s in (1, -1)
        )
        assert np.sum(np.asarray(slope) * change) == pytest.approx(
            (wanted(*ahead) - wanted(*behind)) / (2 * h), rel=1e-6
        )


@pytest.mark.parametrize(
    ("A", "B", "Q"),
    [
        (np.diag([1.1, 0.5]), [[0.0], [1.0]], np.eye(2)),  # out of reach
        (np.diag([1.0, 0.5]), [[0.0], [1.0]], np.eye(2)),  # an integrator out of reach
        (
            np.diag([1.0, 0.5]),
            [[1.0], [1.0]],
            np.diag([0.0, 1.0]),
        ),  # an integrator that costs nothing
        (np.diag([0.9, 0.5]), [[1.0], [1.0]], np.full((2, 2), np.nan)),
    ],
)
def test_no_stabilising_solution_is_said(A, B, Q):
    with pytest.raises(ValueError, match="no stabilising solution"):
        check_dare(A, np.array(B), Q, np.eye(1))


def test_traced_values_pass_unchecked():
    jax.eval_shape(lambda A: check_dare(A, jnp.ones((2, 1)), jnp.eye(2), jnp.eye(1)), jnp.eye(2))


@pytest.mark.parametrize("size", [1, 2, 3, 4])
def test_small_inverse(size):
    M = np.random.default_rng(size).standard_normal((6, size, size)) + 3 * np.eye(size)
    np.testing.assert_allclose(
        small_inverse(jnp.asarray(M)), np.linalg.inv(M), rtol=1e-12, atol=1e-14
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
    arrays, terminal = (
        map(jnp.asarray, (Q, y_d, stage, R)),
        CostToGo(jnp.asarray(H_N), jnp.asarray(g_N)),
    )
    plan = eqx.filter_jit(receding_horizon_plan)(LinearPlant(A, B, C, 1.0), *arrays, terminal)
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
    arrays, terminal = (
        map(jnp.asarray, (Q, y_d, stage, R)),
        CostToGo(jnp.asarray(H_N), jnp.asarray(g_N)),
    )
    models = eqx.filter_vmap(lambda *matrices: LinearPlant(*matrices, 1.0))(A, B, C)
    plan = eqx.filter_jit(scheduled_plan)(models, *arrays, terminal)
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
