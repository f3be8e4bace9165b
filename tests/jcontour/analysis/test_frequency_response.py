import numpy as np
import pytest

from jcontour.analysis.frequency_response import Encoding, Responses, Triangular
from jcontour.analysis.frozen_loops import FrozenLoop, LinearLaw, LinearMachine

Z = np.exp(1j * np.array([1e-3, 0.5, 2.0, np.pi]))


def systems(random, batch, states, inputs, outputs):
    shapes = (states, states), (states, inputs), (outputs, states)
    return [random.standard_normal((*batch, *shape)) for shape in shapes]


def by_numpy(A, B, C, z):
    """C (zI - A)^-1 B by a factorisation at every point."""
    shifted = z[:, None, None] * np.eye(A.shape[-1]) - A
    return C @ np.linalg.solve(shifted, np.broadcast_to(B + 0j, (z.size, *B.shape)))


@pytest.mark.parametrize("states", [0, 1, 5])
def test_a_response_is_that_of_the_whole_matrix(states):
    A, B, C = systems(np.random.default_rng(0), (2, 3), states, 2, 1)
    actual = Triangular.of(A, B, C).response(Z)
    assert actual.shape == (2, 3, Z.size, 1, 2)
    for index in np.ndindex(2, 3):
        np.testing.assert_allclose(
            actual[index], by_numpy(A[index], B[index], C[index], Z), rtol=1e-9
        )


def test_a_line_of_delays_has_its_closed_form():
    """Its matrix cannot be diagonalised."""
    line = Triangular.of(np.eye(4, k=-1), np.eye(4, 1), np.eye(1, 4, 3))
    np.testing.assert_allclose(line.response(Z)[:, 0, 0], Z**-4.0, rtol=1e-12)


@pytest.mark.parametrize("axes", [1, 2, 3])
def test_heights_of_a_batch_that_shares_plants_and_laws(axes):
    """Largest singular values of (I - K P)^-1, (I - P K)^-1 and both less I, by NumPy."""
    random = np.random.default_rng(axes)
    A, B, H = systems(random, (1, 3), 4, axes, axes)
    W, E, K = systems(random, (2, 1), 2, axes, axes)
    D = random.standard_normal((2, 1, axes, axes))
    shown = np.eye(axes)
    encoding = Encoding(shown, shown, 0 * shown)
    repeated = [np.repeat(matrix, 2, axis=0) for matrix in (A, B, H)]
    loop = FrozenLoop(LinearMachine(*repeated), LinearLaw(W, E, K, D))
    actual = Responses.of(loop, encoding).gains(np.angle(Z))
    assert actual.shape == (2, 3, Z.size, 2)
    for k, p in np.ndindex(2, 3):
        P = by_numpy(A[0, p], B[0, p], H[0, p], Z)
        L = D[k, 0] + by_numpy(W[k, 0], E[k, 0], K[k, 0], Z)
        both = [np.linalg.inv(shown - G) for G in (L @ P, P @ L)]
        for curve, less in enumerate((0 * shown, shown)):
            wanted = np.max([np.linalg.norm(S - less, 2, axis=(1, 2)) for S in both], axis=0)
            np.testing.assert_allclose(actual[k, p, :, curve], wanted, rtol=1e-9)


def test_a_change_of_position_shows_in_its_speed():
    """y = (d, (d - d before) / dt)."""
    encoding = Encoding(np.eye(1, 2), np.eye(2, 1), np.array([[0.0], [1e3]]))
    np.testing.assert_allclose(encoding.at(Z)[:, :, 0], np.stack([0 * Z + 1, (1 - 1 / Z) * 1e3], 1))
