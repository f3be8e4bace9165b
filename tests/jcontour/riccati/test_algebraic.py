"""The algebraic Riccati equation, against SciPy and differences."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.linalg import solve_discrete_are

from jcontour.linear.plant import spectral_radius
from jcontour.riccati.algebraic import check_dare, dare, lqr_gain


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
        assert np.max(np.abs(np.subtract(H, wanted))) < 1e-9 * np.max(np.abs(wanted))
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
    """Two equal unstable modes under one input have no solution: refused as numbers, not traced."""
    A, rest = 2 * np.eye(2), (np.ones((2, 1)), np.eye(2), np.eye(1))
    with pytest.raises(ValueError, match="no stabilising solution"):
        check_dare(A, *rest)
    assert jax.eval_shape(lambda A: check_dare(A, *rest), A) is None
