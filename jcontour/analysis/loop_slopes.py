"""Slopes of frozen loops: of the largest eigenvalue, and of answers to disturbances. Host side.

A change of any matrix of a loop acts through a state and its weights. Eigenvalues are found by
LAPACK in NumPy: XLA has none for a general matrix but on a CPU, and there JAX (0.10) may wait for
ever where two batches are computed at the same time.
"""

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Array, Complex, Float

from jcontour.analysis.frozen_loops import FrozenLoop, LinearLaw, LinearMachine

SHIFT = 1e-8  # relative to an eigenvalue: its matrix minus this shift can still be inverted


class Dominant(NamedTuple):
    """Eigenvalues of matrices, the largest modulus, and its derivative Re(left' dM right)."""

    values: Complex[np.ndarray, "*loops N"]
    radius: Float[np.ndarray, "*loops"]
    left: Complex[np.ndarray, "*loops N"]
    right: Complex[np.ndarray, "*loops N"]


def dominant(M: Float[np.ndarray, "*loops N N"]) -> Dominant:
    """Largest eigenvalue l of finite matrices, on the host.

        d|l| = Re(conj(l) / |l| w'dM v / w'v),     v, w' right and left eigenvector of l.
    They are found by inverse iteration. Where the largest eigenvalue is not simple the derivative
    is that of one of them.
    """
    N = M.shape[-1]
    values = np.linalg.eigvals(M).astype(complex)
    chosen = np.argmax(np.abs(values), axis=-1)[..., None]
    largest = np.take_along_axis(values, chosen, axis=-1)[..., 0]
    shift = largest * (1 + SHIFT) + SHIFT**2
    inverse = np.linalg.inv(M - shift[..., None, None] * np.eye(N))
    first = np.broadcast_to(np.sin(1.0 + np.arange(N)), M.shape[:-1])  # not normal to any mode
    right = left = first.astype(complex)
    for _ in range(2):
        right = _unit((inverse @ right[..., None])[..., 0])
        left = _unit((left[..., None, :] @ inverse)[..., 0, :])
    with np.errstate(all="ignore"):  # a nilpotent matrix has no slope
        turned = np.exp(-1j * np.angle(largest)) / np.sum(left * right, axis=-1)
        left = np.nan_to_num(turned[..., None] * left, nan=0.0, posinf=0.0, neginf=0.0)
    return Dominant(values, np.abs(largest), left, right)


def _unit(vector: Complex[np.ndarray, "*loops N"]) -> Any:
    return vector / np.linalg.norm(vector, axis=-1, keepdims=True)


def times(matrix: Array | np.ndarray, vector: Array | np.ndarray) -> Any:
    """Matrices (..., a, b) times vectors (..., b)."""
    return (matrix @ vector[..., None])[..., 0]


def real_outer(a: Array | np.ndarray, b: Array | np.ndarray) -> Float[np.ndarray, "*loops a b"]:
    """Real part of a b' for vectors in batches that go together."""
    return np.real(a[..., :, None] * b[..., None, :])


class Ends(NamedTuple):
    """Where a disturbance comes into a loop, and what of its answer counts, by weights."""

    control: Complex[np.ndarray, "*loops p"]  # added to the control
    reading: Complex[np.ndarray, "*loops q"]  # added to what the controller reads
    of_control: Complex[np.ndarray, "*loops p"]  # weights of the control
    of_reading: Complex[np.ndarray, "*loops q"]  # weights of what the sensors show


NO_ENDS = Ends(*[np.zeros(())] * 4)


def slope_of(loop: FrozenLoop, left, right, ends: Ends = NO_ENDS) -> FrozenLoop:
    """Derivative of Re(left' M right), ends included, with respect to the matrices of the loop.

    x and w are the states that `right` stands for, y what the controller reads and u the control
    then. of_x, ... are the weights of their changes, as far as `left` stands for them.
    """
    (A, B, H), (_, E, K, D) = loop
    n = A.shape[-1]
    x, w, of_x, of_w = right[..., :n], right[..., n:], left[..., :n], left[..., n:]
    y = times(H, x) + ends.reading
    u = times(D, y) + times(K, w) + ends.control
    of_u = times(turned(B), of_x) + ends.of_control
    of_y = times(turned(D), of_u) + times(turned(E), of_w) + ends.of_reading
    return FrozenLoop(
        LinearMachine(real_outer(of_x, x), real_outer(of_x, u), real_outer(of_y, x)),
        LinearLaw(
            real_outer(of_w, w), real_outer(of_w, y), real_outer(of_u, w), real_outer(of_u, y)
        ),
    )


def turned(matrix: Any) -> np.ndarray:
    """The transpose of the last two axes."""
    return np.swapaxes(matrix, -1, -2)
