import numpy as np
import pytest

from tuning.identification.linear.validation import (
    Estimate,
    autocorrelation,
    coloured_covariance,
    scaled_inverse,
)

COVARIANCE = np.array([[0.04, 0.01], [0.01, 0.09]])


def test_interval():
    one = Estimate(("a", "b"), np.array([2.0, 10.0]), COVARIANCE)
    assert one["b"] == 10.0 and one.deviation("b") == pytest.approx(0.3)
    np.testing.assert_allclose(
        one.interval("a"), [2 - 0.2 * 1.959964, 2 + 0.2 * 1.959964], rtol=1e-6
    )


def test_covariance_of_a_mean_under_correlated_noise():
    """Var of the mean of n values with correlation rho^|k|, in closed form."""
    n, rho, variance = 400, 0.8, 3.0
    expected = (
        variance / n**2 * (n * (1 + rho) / (1 - rho) - 2 * rho * (1 - rho**n) / (1 - rho) ** 2)
    )
    found = coloured_covariance([np.ones((n, 1))], [variance * rho ** np.arange(n)])
    np.testing.assert_allclose(found, [[expected]], rtol=1e-12)


def test_covariance_over_runs_is_that_of_the_whole_matrix():
    random = np.random.default_rng(2)
    slopes = [random.normal(size=(30, 2)), random.normal(size=(5, 2))]
    correlation = 0.5 ** np.arange(8)
    dense = np.zeros((35, 35))
    for start, end in ((0, 30), (30, 35)):
        for k in range(start, end):
            for m in range(start, end):
                dense[k, m] = correlation[abs(k - m)] if abs(k - m) < 8 else 0.0
    J = np.concatenate(slopes)
    gain = np.linalg.pinv(J)
    np.testing.assert_allclose(
        coloured_covariance(slopes, [correlation] * 2), gain @ dense @ gain.T, rtol=1e-10
    )


def test_autocorrelation_by_hand():
    """Products within runs only: (1 + 4 + 9 + 16) / 4, then (1 * 2 + 3 * 4) / 4.

    The third and last lag of four counts half.
    """
    runs = [np.array([1.0, 2.0]), np.array([3.0, 4.0])]
    np.testing.assert_allclose(autocorrelation(runs, 1), [7.5, 3.5])
    np.testing.assert_allclose(autocorrelation([np.ones(8)], 3), [1, 7 / 8, 6 / 8, 5 / 8 / 2])


def test_inverse_across_magnitudes_and_of_what_is_not_seen():
    scale, inner = (
        np.array([1e-12, 1.0, 1e12]),
        np.array([[2.0, 0.5, 0.1], [0.5, 1.0, 0.2], [0.1, 0.2, 3.0]]),
    )
    inverse = scaled_inverse(inner * np.outer(scale, scale)) * np.outer(scale, scale)
    np.testing.assert_allclose(inverse @ inner, np.eye(3), atol=1e-12)
    blind = scaled_inverse(np.array([[1.0, 1.0], [1.0, 1.0]]))
    assert blind[0, 0] > 1e14 and blind[1, 1] > 1e14


def test_a_variance_that_rounding_took_below_zero_is_not_known():
    """Without a warning of a root: those are errors here."""
    one = Estimate(("a",), np.ones(1), np.array([[-1e-20]]))
    assert one.deviation("a") == np.inf
