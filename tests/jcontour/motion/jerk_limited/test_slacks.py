"""Newton's equations of a warp, solved by their band, beside NumPy's solution of the whole."""

import numpy as np
import pytest

from jcontour.motion.jerk_limited.slacks import (
    FAR,
    MAIN,
    NEAR,
    PER_UNKNOWN,
    SLOPE,
    solve_equations,
)


def solved(matrix, pull, slope, mu):
    """Step of a band, by the function before it is compiled: it may not leave its arrays."""
    n = len(matrix)
    rows, step = np.zeros((n, PER_UNKNOWN)), np.full(n, np.nan)
    rows[:, 0], rows[:, SLOPE], rows[:, MAIN] = pull, slope, np.diag(matrix)
    rows[1:, NEAR], rows[2:, FAR] = np.diag(matrix, 1), np.diag(matrix, 2)
    solve_equations.py_func(rows.ravel(), mu, step)
    return step


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
        actual = solved(scale * held[np.ix_(twice, twice)], np.zeros(4), scale * slope[twice], 1.0)
        assert actual[1] == 0.0
        np.testing.assert_allclose(actual[[0, 2, 3]], np.linalg.solve(held, -slope), rtol=1e-12)
