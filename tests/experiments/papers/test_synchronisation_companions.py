"""Frozen stability is not enough, and how fast a schedule may move."""

import ast

import jax
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from experiments.papers.synchronisation.companions import admissible_rate, turning
from tests.reference_data import numbers_of

INTEGRATED, EXACT, EIGENVALUES = numbers_of("adaptive/companions")["lpv_frozen"]

turned = jax.jit(turning)


def ended(rate, time):
    """State at an instant, the parameter moving at a steady rate."""

    def slopes(t, x):
        c, s = np.cos(rate * t), np.sin(rate * t)
        A = [[-1 + 1.5 * c * c, 1 - 1.5 * c * s], [-1 - 1.5 * c * s, -1 + 1.5 * s * s]]
        return np.asarray(A) @ x

    return solve_ivp(slopes, (0, time), [1.0, 0.0], rtol=1e-11, atol=1e-12).y[:, -1]


def test_the_frozen_matrix_is_that_of_the_reference():
    poles = np.sort_complex(np.linalg.eigvals(turned(0.3)))
    wanted = np.sort_complex([complex(ast.literal_eval(text)) for text in EIGENVALUES])
    np.testing.assert_allclose(poles, wanted, rtol=1e-8)
    everywhere = [np.linalg.eigvals(turned(a)) for a in np.linspace(0, 7, 29)]
    np.testing.assert_allclose(np.real(everywhere), -0.25, rtol=1e-12)


def test_it_grows_all_the_same():
    def slopes(t, x):
        return np.asarray(turned(t)) @ x

    end = solve_ivp(slopes, (0, 10), [1.0, 0.0], "DOP853", rtol=1e-11, atol=1e-11).y[:, -1]
    np.testing.assert_allclose(end, EXACT, rtol=1e-8)
    np.testing.assert_allclose(end, INTEGRATED, rtol=1e-8)
    exact = np.exp(5) * np.array([np.cos(10), -np.sin(10)])
    np.testing.assert_allclose(end, exact, rtol=1e-8)


def test_below_the_admissible_rate_it_dies_out():
    rate = admissible_rate(turning, np.linspace(0, 2 * np.pi, 37))
    assert 0 < rate < 1
    assert np.linalg.norm(ended(0.99 * rate, 80.0)) < 1e-3
    assert np.linalg.norm(ended(1.0, 10.0)) > 100


def test_the_rate_against_differences_of_lyapunov_matrices():
    """The largest |P(p + h) - P(p - h)| / 2h, each P by its Kronecker form."""

    def P(angle):
        A = np.asarray(turned(angle))
        K = np.kron(A.T, np.eye(2)) + np.kron(np.eye(2), A.T)
        return np.linalg.solve(K, -np.eye(2).ravel()).reshape(2, 2)

    angles = np.linspace(0, np.pi, 13)
    slopes = [np.linalg.norm(P(a + 1e-5) - P(a - 1e-5), 2) / 2e-5 for a in angles]
    assert admissible_rate(turning, angles) == pytest.approx(1 / max(slopes), rel=1e-6)
