"""Conditions of model matching against plain evaluation and differentiation."""

import numpy as np
import pytest
from numpy.polynomial import polynomial

from jcontour.controllers.feedforward.model_matching import ModelMatching

ZEROS = [0.0, -0.3, 0.5 + 0.4j, 0.5 - 0.4j, 0.8]


def test_the_shift_has_the_zeros_and_never_lengthens():
    problem = ModelMatching(ZEROS, [1.0, 2.0])
    found = np.sort_complex(np.linalg.eigvals(problem.shift))
    np.testing.assert_allclose(found, np.sort_complex(np.array(ZEROS)), atol=1e-12)
    assert np.linalg.norm(problem.shift, 2) <= 1 + 1e-12
    samples = problem.powers(400)
    np.testing.assert_allclose(samples @ samples.conj().T, np.eye(5), atol=1e-12)


def test_a_filter_that_meets_the_values_meets_the_conditions():
    problem = ModelMatching(ZEROS, [0.3, 0.0, 1.0], [1.0, -0.2])
    vandermonde = np.vander(problem.zeros, 5, increasing=True)
    taps = np.real(np.linalg.solve(vandermonde, problem.values))
    assert problem.misses(taps) < 1e-12
    assert problem.misses(taps + np.eye(5)[2]) > 0.01


def test_a_double_zero_fixes_the_slope():
    problem = ModelMatching([0.4, 0.4], [0.0, 0.0, 0.0, 1.0])
    value, slope = 0.4**3, 3 * 0.4**2
    assert problem.misses(np.array([value - 0.4 * slope, slope])) < 1e-14
    assert problem.misses(np.array([value, 0.0])) > 0.01


def test_the_model_at_the_shift():
    problem = ModelMatching(ZEROS, [0.3, 0.0, 1.0], [1.0, -1.0])
    S = problem.shift
    np.testing.assert_allclose((np.eye(5) - S) @ problem.model, 0.3 * np.eye(5) + S @ S, atol=1e-12)
    wanted = polynomial.polyval(-0.3, [0.3, 0.0, 1.0]) / 1.3
    assert problem.values[1] == pytest.approx(wanted)


@pytest.mark.parametrize(
    ("zeros", "words"),
    [
        ([1.0], "1 is on the unit circle|on the unit circle"),
        ([np.exp(0.3j), np.exp(-0.3j)], "on the unit circle"),
        ([-1.5], "outside the unit circle"),
        ([0.3 + 0.2j], "without its conjugate"),
        ([np.nan], "finite"),
    ],
)
def test_bad_zeros(zeros, words):
    with pytest.raises(ValueError, match=words):
        ModelMatching(zeros, [1.0])


def test_a_pole_of_the_model_at_a_zero():
    with pytest.raises(ValueError, match="pole at the zero"):
        ModelMatching([0.5], [1.0], [1.0, -2.0])
