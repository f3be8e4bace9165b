"""H-infinity optima against the reference, a frequency grid and Pick's matrix."""

import numpy as np
import pytest
import scipy.linalg

from jcontour.controllers.feedforward.model_matching import ModelMatching, hinf_optimum

CIRCLE = np.exp(1j * np.linspace(0, np.pi, 721))


def pick_norm(problem: ModelMatching) -> float:
    """Square root of the largest eigenvalue of A^-1 B, Pick's matrices of distinct zeros.

    A_ij = 1 / (1 - z_i z_j*),   B_ij = M(z_i) M(z_j)* A_ij
    """
    z, w = problem.zeros, problem.values
    A = 1 / (1 - z[:, None] * z.conj())
    B = w[:, None] * w.conj() * A
    return float(np.sqrt(scipy.linalg.eigh(B, A, eigvals_only=True)[-1]))


def test_general_zeros_are_the_reference(general_problems):
    for problem, wanted in general_problems:
        found = hinf_optimum(problem)
        assert found.cost == pytest.approx(wanted["J_hinf"], rel=1e-8)
        np.testing.assert_allclose(found.samples(8), wanted["e_hinf_first8"], atol=1e-12)
        modulus = np.abs(found.response(CIRCLE))
        assert np.ptp(modulus) < 1e-12 and abs(found.margin) < 1e-12
        if "J_hinf_pick" in wanted and wanted["J_hinf_pick"] is not None:
            assert pick_norm(problem) == pytest.approx(wanted["J_hinf_pick"], rel=1e-8)


def test_certificates_on_random_zeros(random_problems):
    for problem in random_problems:
        found = hinf_optimum(problem)
        np.testing.assert_allclose(np.abs(found.response(CIRCLE)), found.cost, rtol=1e-9)
        assert pick_norm(problem) == pytest.approx(found.cost, rel=1e-9)
        assert abs(found.margin) <= 1e-9 * found.cost**2
        np.testing.assert_allclose(found.response(problem.zeros), problem.values, atol=1e-8)
        poles = np.roots(found.denominator[::-1])
        assert np.all(np.abs(poles) > 1)


def test_a_repeated_zero_meets_the_slope():
    problem = ModelMatching([0.4, 0.4], [0.0, 0.0, 0.0, 1.0])
    found = hinf_optimum(problem)
    ahead, behind = found.response([0.4 + 1e-6, 0.4 - 1e-6])
    assert np.real(ahead - behind) / 2e-6 == pytest.approx(3 * 0.4**2, rel=1e-8)
    np.testing.assert_allclose(np.abs(found.response(CIRCLE)), found.cost, rtol=1e-12)


def test_a_constant_model_is_its_own_optimum():
    found = hinf_optimum(ModelMatching([0.3, -0.5, 0.7], [2.0]))
    assert found.cost == pytest.approx(2.0)
    np.testing.assert_allclose(found.response(CIRCLE), 2.0, rtol=1e-9)


def test_no_zero_and_nothing_to_follow():
    assert hinf_optimum(ModelMatching([], [1.0])).cost == 0
    assert hinf_optimum(ModelMatching([0.5], [0.0])).cost == 0
