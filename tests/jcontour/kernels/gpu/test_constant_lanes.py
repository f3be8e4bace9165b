"""The constant part of a window against its definition: a problem with one weight at all samples.

Without a GPU the kernels are interpreted, so the cases are tiny.
"""

import jax
import numpy as np
import pytest

from jcontour.kernels.gpu.constant_lanes import constant_part, own_pattern
from jcontour.kernels.gpu.lanes import Operand
from jcontour.linear.plant import Axis, Pattern


def test_an_axis_by_itself():
    pattern = Pattern.of(np.diag([1.0, 0.0, 2.0]), np.eye(3)[:, ::2], np.eye(3)[2:])
    own = own_pattern(pattern, Axis((2,), (1,), (0,)))
    assert own == Pattern(((True,),), ((True,),), ((True,),))


@pytest.mark.parametrize(
    ("sizes", "inputs", "preview"),
    [((1,), 1, 2), pytest.param((2, 1), 3, 4, marks=pytest.mark.slow)],
)
def test_responses_of_the_condensed_problem(problems, sizes, inputs, preview):
    plant = problems.machine(sizes, inputs, len(sizes))
    stage, q, R = np.linspace(0.7, 1.5, preview), 2.3, 0.4 * np.eye(inputs)
    arrays = plant.A, plant.B, plant.C, np.array([q]), stage, R

    def found():
        part = constant_part(plant.pattern, preview, [Operand(array) for array in arrays])
        return [operand.array for operand in part]

    K, D, E, O = map(np.asarray, jax.jit(found)())  # noqa: E741
    gain, covariance, first, free = condensed(plant, stage, q, R)
    own = plant.C.astype(bool)  # outputs of the states' axes
    of_state = np.argmax(np.asarray(own), axis=0)
    of_input = np.array([int(of_state[np.flatnonzero(column)[0]]) for column in plant.B.T])
    same = of_input[:, None] == of_state
    np.testing.assert_allclose(K.reshape(same.shape)[same], gain[same], rtol=0, atol=1e-13)
    for a in range(plant.axes):
        np.testing.assert_allclose(D[a], covariance[:, a, :, a], rtol=0, atol=1e-12)
    for u, a in enumerate(of_input):
        np.testing.assert_allclose(E[u], first[u, :, a], rtol=0, atol=1e-12)
    for i, a in enumerate(of_state):
        np.testing.assert_allclose(O[i], free[:, a, i], rtol=0, atol=1e-12)


def condensed(plant, stage, q, R):
    """First gain, and covariances of the scaled outputs, by dense algebra on the whole window."""
    A, B, C = (np.asarray(matrix) for matrix in (plant.A, plant.B, plant.C))
    N, m, p, root = len(stage), len(C), B.shape[1], np.sqrt(stage)
    powers = [np.linalg.matrix_power(A, k) for k in range(N + 1)]
    free = np.stack([root[j] * C @ powers[j + 1] for j in range(N)])
    push = np.zeros((N, m, N, p))
    for j in range(N):
        for k in range(j + 1):
            push[j, :, k] = root[j] * C @ powers[j - k] @ B
    G = push.reshape(N * m, N * p)
    inverse = np.linalg.inv(q * G.T @ G + np.kron(np.eye(N), R))
    gains = q * inverse @ G.T @ free.reshape(N * m, -1)
    covariance = (G @ inverse @ G.T).reshape(N, m, N, m)
    first = (inverse[:p] @ G.T).reshape(p, N, m)
    steered = free - (G @ gains).reshape(free.shape)
    return gains[:p], covariance, first, steered
