"""Transfer functions of linear plants in lambda = z^-1, their delays and their zeros.

    P(lambda) = g lambda^d prod(1 - zeta_i lambda) / prod(1 - p_i lambda)

zeta_i and p_i are zeros and poles in z. The zeros in lambda are 1 / zeta_i. A zero in lambda
inside the unit circle is unstable: no stable filter cancels it. Polynomials are ascending in
lambda.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
import scipy.linalg
from jaxtyping import Complex, Float

from jcontour._arrays import check_above_zero
from jcontour.linear.plant import LinearPlant, decoupled_axes

# A zero of order two is only known to the root of the precision, times what its plant magnifies.
ON_CIRCLE = 1e-6  # nearer to the unit circle than this a zero counts as on it
UNREACHED = 16  # times the rounding error of a product of matrices

Polynomial = Float[np.ndarray, "_"]  # of any length
Roots = Complex[np.ndarray, "_"]


class SortedZeros(NamedTuple):
    """Zeros in lambda, the origin left out."""

    cancellable: Roots  # outside the unit circle
    on_circle: Roots
    unstable: Roots  # inside the unit circle, and those that would ring


@dataclass(frozen=True, eq=False)
class TransferFunction:
    """Response of one output to one input.

    >>> slide = from_polynomials([0.0, 0.045, 0.026], [1.0, -1.18, 0.18], dt=3e-3)
    >>> slide.delay, slide.zeros.real.round(4).tolist()
    (1, [-1.7308])
    >>> slide.numerator.round(6).tolist()
    [0.0, 0.045, 0.026]
    """

    gain: float  # g, the first sample of the impulse response that is not zero
    delay: int  # d, the relative degree [samples]
    zeros_z: Roots  # finite zeros in z
    poles_z: Roots  # poles in z
    dt: float  # sample period [s]

    @cached_property
    def numerator(self) -> Polynomial:
        """Coefficients of lambda^0, lambda^1, ..."""
        finite = self.gain * _from_z_roots(self.zeros_z)
        return np.concatenate([np.zeros(self.delay), finite])

    @cached_property
    def denominator(self) -> Polynomial:
        """Coefficients of lambda^0 = 1, lambda^1, ..."""
        return _from_z_roots(self.poles_z)

    @property
    def zeros(self) -> Roots:
        """Zeros in lambda without the origin, those nearest to it first."""
        zeros = 1 / self.zeros_z[self.zeros_z != 0]
        return zeros[np.argsort(np.abs(zeros), kind="stable")]

    def response(self, points) -> Complex[np.ndarray, "*f"]:
        """P at points lambda of the complex plane; lambda = exp(-j w dt) at w [rad/s].

        The product of its factors: no coefficient is expanded.
        """
        points = np.asarray(points, complex)
        ratio = np.full(points.shape, complex(self.gain)) * points**self.delay
        for zero in self.zeros_z:
            ratio = ratio * (1 - zero * points)
        for pole in self.poles_z:
            ratio = ratio / (1 - pole * points)
        return np.asarray(ratio)


def from_polynomials(
    numerator: Sequence[float | int] | np.ndarray,
    denominator: Sequence[float | int] | np.ndarray,
    dt: float,
) -> TransferFunction:
    """Transfer function from ascending polynomials in lambda.

    Raises:
        ValueError: a polynomial has no coefficient or one that is not finite, the numerator is
            zero, the denominator begins with zero, or `dt` is not above zero.
    """
    top, below = (np.atleast_1d(np.asarray(one, float)) for one in (numerator, denominator))
    for name, one in {"numerator": top, "denominator": below}.items():
        if one.ndim != 1 or one.size == 0 or not np.isfinite(one).all():
            raise ValueError(f"{name}: needs a row of finite coefficients, received {one}")
    check_above_zero(dt=dt)
    if not np.any(top):
        raise ValueError("numerator: needs a coefficient that is not zero")
    if below[0] == 0:
        raise ValueError("denominator: needs a first coefficient that is not zero")
    delay = int(np.flatnonzero(top)[0])
    return TransferFunction(
        float(top[delay] / below[0]),
        delay,
        np.roots(top[delay:]).astype(complex),
        np.roots(below).astype(complex),
        float(dt),
    )


def transfer_function(plant: LinearPlant, output: int = 0, entry: int = 0) -> TransferFunction:
    """Transfer function from input `entry` to `output`, without modes that it does not see.

    The zeros are the eigenvalues of A - B C A^d / (C A^(d-1) B) on the states that no output shows
    for d samples, in balanced coordinates.

    Raises:
        ValueError: there is no such input or output, or the input does not act on the output.
    """
    for name, index, count in (("output", output, plant.axes), ("input", entry, plant.inputs)):
        if not 0 <= index < count:
            raise ValueError(f"{name}: the plant has {name}s 0 to {count - 1}, received {index}")
    unreached = f"input {entry} does not act on output {output}: no transfer function"
    linked = [axis for axis in decoupled_axes(plant.pattern) if output in axis.outputs]
    rows = np.array(linked[0].states, int)
    if entry not in linked[0].inputs or rows.size == 0:
        raise ValueError(unreached)
    A, B = np.asarray(plant.A)[np.ix_(rows, rows)], np.asarray(plant.B)[rows, entry]
    A, B, C = _balanced(A, B, np.asarray(plant.C)[output, rows])
    first = _first_sample(A, B, C)
    if first is None:
        raise ValueError(unreached)
    gain, delay = first
    A, B, C = _reached(A, B, C)
    A, C, B = (matrix.T for matrix in _reached(A.T, C, B))
    shown = np.stack([C @ np.linalg.matrix_power(A, k) for k in range(delay)])
    hidden = np.linalg.qr(shown.T, mode="complete")[0][:, delay:]
    closed = A - np.outer(B, shown[-1] @ A) / gain
    zeros = np.linalg.eigvals(hidden.T @ closed @ hidden).astype(complex)
    poles = np.linalg.eigvals(A).astype(complex)
    return TransferFunction(gain, delay, zeros, poles, plant.dt)


def sorted_zeros(transfer: TransferFunction, ringing: float = 1.0) -> SortedZeros:
    """Zeros in lambda: cancellable, on the unit circle, and unstable.

    >>> slide = from_polynomials([0.0, 0.045, 0.026], [1.0, -1.18, 0.18], dt=3e-3)
    >>> sorted_zeros(slide).cancellable.size, sorted_zeros(slide, ringing=0.5).unstable.size
    (1, 1)

    Args:
        transfer: the transfer function.
        ringing: modulus in z above which a stable zero in the left half plane counts as unstable,
            because its inverse rings; 1 counts none.

    Raises:
        ValueError: `ringing` is not above zero and at most one.
    """
    if not 0 < ringing <= 1:
        raise ValueError(f"ringing: needs a modulus above 0 and at most 1, received {ringing}")
    zeros = transfer.zeros
    modulus = np.abs(zeros)
    on_circle = np.abs(modulus - 1) <= ON_CIRCLE
    rings = (modulus < 1 / ringing) & (np.real(zeros) < 0)
    unstable = ~on_circle & ((modulus < 1) | rings)
    return SortedZeros(zeros[~on_circle & ~unstable], zeros[on_circle], zeros[unstable])


def polynomial_from_zeros(zeros: Roots) -> Polynomial:
    """prod(1 - lambda / zero) of zeros in lambda that come in conjugate pairs: 1 at the origin."""
    return _from_z_roots(1 / np.asarray(zeros, complex))


def _from_z_roots(roots: Roots) -> Polynomial:
    """prod(1 - root lambda), real."""
    return np.real(np.poly(roots)) if len(roots) else np.ones(1)


def _balanced(A, B, C):
    """The same system in coordinates in which rows and columns are about equally large."""
    n = len(A)
    block = np.zeros((n + 1, n + 1))
    block[:n, :n], block[:n, n], block[n, :n] = A, B, C
    _, (scale, _) = scipy.linalg.matrix_balance(block, permute=False, separate=True)
    states, signal = scale[:n], scale[n]
    return A * (states / states[:, None]), B * (signal / states), C * (states / signal)


def _reached(A, B, C):
    """Part of the system that the input reaches, in an orthonormal basis (Arnoldi)."""
    size = max(np.linalg.norm(A, 2), 1e-300)
    basis: list[np.ndarray] = []
    new = B
    scale = np.linalg.norm(B)
    while len(basis) < len(A):
        for _ in range(2):  # twice is enough
            for old in basis:
                new = new - old * (old @ new)
        length = np.linalg.norm(new)
        if not length > UNREACHED * len(A) * np.finfo(float).eps * scale:
            break
        basis.append(new / length)
        new, scale = A @ basis[-1], size
    if not basis:
        return np.zeros((0, 0)), np.zeros(0), np.zeros(0)
    Q = np.stack(basis, axis=1)
    return Q.T @ A @ Q, Q.T @ B, C @ Q


def _first_sample(A, B, C) -> tuple[float, int] | None:
    """First sample of the impulse response that is not zero, and its place from one on."""
    row, bound = C, np.abs(C)
    for k in range(len(A)):
        sample = float(row @ B)
        rounding = np.finfo(float).eps * UNREACHED * len(A) * (bound @ np.abs(B))
        if abs(sample) > rounding:
            return sample, k + 1
        row, bound = row @ A, bound @ np.abs(A)
    return None
