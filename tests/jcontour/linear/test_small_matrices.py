"""Solutions, inverses and exponentials of small matrices against LAPACK's, in programs without it.

Two batches of LAPACK's factors in one program wait for each other for ever on two cores.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.linalg

from jcontour.linear.plant import LinearPlant, steady_motion
from jcontour.linear.small_matrices import exponential, small_inverse, small_solve
from jcontour.linear.transformations import zoh
from jcontour.riccati.algebraic import dare

RNG = np.random.default_rng(0)


def test_solutions_and_slopes_are_lapacks():
    """With a first pivot of zero, and rows of sizes far apart."""
    M = RNG.normal(size=(6, 6)) * 10.0 ** np.arange(-6, 6, 2)[:, None]
    M[0, 0] = 0.0
    right = RNG.normal(size=(6, 2))
    M, right = jnp.asarray(M), jnp.asarray(right)
    wanted = jnp.linalg.solve(M, right)
    np.testing.assert_allclose(small_solve(M, right), wanted, rtol=1e-11)
    np.testing.assert_allclose(small_solve(M, right[:, 0]), wanted[:, 0], rtol=1e-11)
    slope, known = (
        jax.grad(lambda M, solve=solve: jnp.sum(jnp.sin(solve(M, right) / wanted)))(M)
        for solve in (small_solve, jnp.linalg.solve)
    )
    np.testing.assert_allclose(slope, known, rtol=1e-11)


@pytest.mark.parametrize("p", [1, 2, 3, 4])
def test_inverses_are_lapacks(p):
    M = jnp.asarray(RNG.normal(size=(6, p, p)) + 3 * np.eye(p))
    np.testing.assert_allclose(small_inverse(M), np.linalg.inv(np.asarray(M)), rtol=1e-11)


def test_a_singular_matrix_has_no_finite_solution():
    assert not np.isfinite(small_solve(jnp.ones((4, 4)), jnp.arange(4.0))).all()


@pytest.mark.parametrize("size", [0.0, 1e-3, 1.0, 300.0])
def test_exponentials_are_scipys(size):
    M = size * RNG.normal(size=(5, 5)) - size * 3 * np.eye(5)
    wanted = scipy.linalg.expm(M)
    close = 1e-13 * max(1.0, size) * np.abs(wanted).max()
    np.testing.assert_allclose(exponential(jnp.asarray(M)), wanted, rtol=0, atol=close)


def test_programs_of_families_hold_no_batches_of_lapack():
    A, B, C = np.diag([1.0, 0.9, 0.7, 0.5]), np.ones((4, 1)), np.ones((1, 4))
    programs = {
        "steady motion": lambda A: steady_motion(LinearPlant(A, B, C, 1e-3)).Sv,
        "held controls": lambda A: zoh(A, B, 0.1)[1],
        "Riccati": lambda A: dare(A, B, jnp.eye(4), jnp.eye(1)),
    }
    family = jnp.asarray(A + 0.01 * RNG.normal(size=(3, 4, 4)))
    for name, program in programs.items():
        text = jax.jit(jax.vmap(program)).lower(family).compile().as_text()
        assert "lapack" not in text, name
