"""Conditions of model matching against plain evaluation and differentiation.

H-infinity optima against the reference, a frequency grid and Pick's matrix.

Zeros on the unit circle against Table 2 and the explicit loop with integral action.
"""

import numpy as np
import pytest
import scipy.linalg
from numpy.polynomial import polynomial
from scipy.signal import lfilter

from jcontour.controllers.feedforward.model_matching import (
    ModelMatching,
    corollary_1,
    hinf_optimum,
    l1_norm,
    perturbed_error,
)

ZEROS = [0.0, -0.3, 0.5 + 0.4j, 0.5 - 0.4j, 0.8]


def test_the_shift_has_the_zeros_and_never_lengthens():
    problem = ModelMatching(ZEROS, [1.0, 2.0])
    actual = np.sort_complex(np.linalg.eigvals(problem.shift))
    np.testing.assert_allclose(actual, np.sort_complex(np.array(ZEROS)), atol=1e-12)
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


CIRCLE = np.exp(1j * np.linspace(0, np.pi, 721))


def pick_norm(problem: ModelMatching) -> float:
    """Square root of the largest eigenvalue of A^-1 B, Pick's matrices of distinct zeros.

    A_ij = 1 / (1 - z_i z_j*),   B_ij = M(z_i) M(z_j)* A_ij
    """
    z, w = problem.zeros, problem.values
    A = 1 / (1 - z[:, None] * z.conj())
    B = w[:, None] * w.conj() * A
    return float(np.sqrt(scipy.linalg.eigh(B, A, eigvals_only=True)[-1]))


def response(filter, points):
    points = np.asarray(points)
    return polynomial.polyval(points, filter.numerator) / polynomial.polyval(
        points, filter.denominator
    )


def test_general_zeros_are_the_reference(general_problems):
    for problem, wanted in general_problems:
        actual = hinf_optimum(problem)
        assert actual.cost == pytest.approx(wanted["J_hinf"], rel=1e-8)
        np.testing.assert_allclose(
            lfilter(actual.numerator, actual.denominator, np.eye(8)[0]),
            wanted["e_hinf_first8"],
            atol=1e-12,
        )
        modulus = np.abs(response(actual, CIRCLE))
        assert np.ptp(modulus) < 1e-12
        if "J_hinf_pick" in wanted and wanted["J_hinf_pick"] is not None:
            assert pick_norm(problem) == pytest.approx(wanted["J_hinf_pick"], rel=1e-8)


def test_certificates_on_random_zeros(random_problems):
    for problem in random_problems:
        actual = hinf_optimum(problem)
        np.testing.assert_allclose(np.abs(response(actual, CIRCLE)), actual.cost, rtol=1e-9)
        assert pick_norm(problem) == pytest.approx(actual.cost, rel=1e-9)
        np.testing.assert_allclose(response(actual, problem.zeros), problem.values, atol=1e-8)
        poles = np.roots(actual.denominator[::-1])
        assert np.all(np.abs(poles) > 1)


def test_a_repeated_zero_meets_the_slope():
    problem = ModelMatching([0.4, 0.4], [0.0, 0.0, 0.0, 1.0])
    actual = hinf_optimum(problem)
    ahead, behind = response(actual, [0.4 + 1e-6, 0.4 - 1e-6])
    assert np.real(ahead - behind) / 2e-6 == pytest.approx(3 * 0.4**2, rel=1e-8)
    np.testing.assert_allclose(np.abs(response(actual, CIRCLE)), actual.cost, rtol=1e-12)


def test_a_constant_model_is_its_own_optimum():
    actual = hinf_optimum(ModelMatching([0.3, -0.5, 0.7], [2.0]))
    assert actual.cost == pytest.approx(2.0)
    np.testing.assert_allclose(response(actual, CIRCLE), 2.0, rtol=1e-9)


def test_no_zero_and_nothing_to_follow():
    assert hinf_optimum(ModelMatching([], [1.0])).cost == 0
    assert hinf_optimum(ModelMatching([0.5], [0.0])).cost == 0


def test_corollary_1_is_table_2(alter_tsao):
    for row in alter_tsao["table2"]:
        for which in ("b_printed", "b_fitted"):
            actual = corollary_1(row[which]["M_b"], alter_tsao[which])
            assert actual.attainable == pytest.approx(row[which]["J1_opt"], rel=1e-8)
            assert actual.limit == pytest.approx(row[which]["lim_J_eps"], rel=1e-8)


@pytest.fixture(scope="module")
def model(alter_tsao):
    """M = lambda^8 - (1 / lambda) P C / (1 + P C) of controller B."""
    loop = alter_tsao["explicit_loop"]
    feedback = loop["B_lead_integral"]
    through = np.convolve(loop["num_lambda"], feedback["num_lambda"])
    closed = polynomial.polyadd(np.convolve(loop["den_lambda"], feedback["den_lambda"]), through)
    delayed = np.eye(1, 9, 8)[0]
    return polynomial.polysub(np.convolve(delayed, closed), through[1:]), closed


def test_the_perturbed_loop(alter_tsao, model):
    wanted = alter_tsao["explicit_loop"]["perturbation_0_9_0"]
    assert l1_norm(*model) == pytest.approx(wanted["norm_M_this_controller"], abs=1e-9)
    circle = np.exp(1j * np.linspace(0, np.pi, 20001))
    for row in wanted["sweep"]:
        top, below = perturbed_error(model, np.array([alter_tsao["b_printed"] ** 8]), row["eps"])
        assert l1_norm(top, below) == pytest.approx(row["J_eps"], abs=1e-9)
        modulus = np.abs(polynomial.polyval(circle, top) / polynomial.polyval(circle, below))
        assert modulus.max() == pytest.approx(row["hinf_grid"], abs=1e-9)


def test_l1_norms_in_closed_form():
    assert l1_norm(np.array([1.0]), np.array([1.0, -0.9])) == pytest.approx(10.0)
    assert l1_norm(np.array([1.0, -2.0]), np.array([1.0])) == pytest.approx(3.0)
    with pytest.raises(ValueError, match="not stable"):
        l1_norm(np.array([1.0]), np.array([1.0, -1.0]))


def test_bad_input(model):
    with pytest.raises(ValueError, match="between -1 and 0"):
        corollary_1(1.0, 0.3)
    with pytest.raises(ValueError, match="eps"):
        perturbed_error(model, np.array([1.0]), 0.0)
