"""Newton's equations of a warp, solved by their band, beside NumPy's solution of the whole."""

import numba
import numpy as np
import pytest

from jcontour.motion.jerk_limited.equations import FAR, MAIN, NEAR, PER_UNKNOWN, solve_equations


@numba.njit
def _solve(equations, mu, step):
    solve_equations(equations, mu, step)


def solved(matrix, pull, slope, mu):
    """Step of a band whose neighbours in memory are no numbers."""
    n = len(matrix)
    rows = np.full((n + 4, PER_UNKNOWN), np.nan)
    rows[2:-2] = 0.0
    found = rows[2:-2]
    found[:, 0], found[:, 1], found[:, MAIN] = pull, slope, np.diag(matrix)
    found[1:, NEAR], found[2:, FAR] = np.diag(matrix, 1), np.diag(matrix, 2)
    step = np.full(n + 4, np.nan)
    _solve(found.ravel(), mu, step[2:-2])
    assert np.isnan(step[:2]).all() and np.isnan(step[-2:]).all()
    return step[2:-2]


@pytest.mark.parametrize("n", [3, 4, 20])
def test_the_band_is_solved_as_a_whole_matrix(n):
    random = np.random.default_rng(n)
    root = np.tril(np.triu(random.standard_normal((n, n)), -2)) + 3 * np.eye(n)
    pull, slope, mu = random.standard_normal(n), random.standard_normal(n), 0.3
    wanted = np.linalg.solve(root @ root.T, mu * pull - slope)
    np.testing.assert_allclose(solved(root @ root.T, pull, slope, mu), wanted, rtol=1e-9)


def test_an_unknown_that_nothing_holds_stays_where_it_is():
    """Its row is the one before it, as if it were the same unknown: the others share the rest."""
    held = np.array([[2.0, 1.0, 0.0], [1.0, 3.0, 1.0], [0.0, 1.0, 2.0]])
    twice = [0, 0, 1, 2]
    slope = np.array([1.0, -2.0, 0.5])
    for scale in np.random.default_rng(0).uniform(0.1, 1.0, 20):  # what is left differs by rounding
        found = solved(scale * held[np.ix_(twice, twice)], np.zeros(4), scale * slope[twice], 1.0)
        assert found[1] == 0.0
        np.testing.assert_allclose(found[[0, 2, 3]], np.linalg.solve(held, -slope), rtol=1e-12)
