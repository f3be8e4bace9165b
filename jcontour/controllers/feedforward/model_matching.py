"""Model matching: a stable error filter E that equals a model M at given unstable zeros.

    E(z_i) = M(z_i),   M = numerator / denominator

A zero that comes r times also fixes the first r - 1 derivatives. Every E = M - G Q with a stable Q
is one of these, and no other filter is (Alter & Tsao, eq. 7). Polynomials are ascending in
lambda = z^-1; |z_i| < 1.

The conditions are written in the orthonormal basis of Takenaka and Malmquist,

    phi_i = sqrt(1 - |z_i|^2) / (1 - z_i* lambda) prod_{j<i} (lambda - z_j) / (1 - z_j* lambda),
where they are well conditioned, near and repeated zeros included: the space is shifted by the
lower triangular S, and the conditions read E(S) = M(S).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Complex, Float
from numpy.polynomial import polynomial

from jcontour.linear.transfer_functions import ON_CIRCLE

PAIRED = 1e-9  # largest distance of a complex zero's partner from its conjugate

Zeros = Complex[np.ndarray, "_"]
Polynomial = Float[np.ndarray, "_"]  # of any length


@dataclass(frozen=True, eq=False)
class ModelMatching:
    """Zeros and model of one problem.

    >>> problem = ModelMatching([0.0, -0.3], numerator=[0.0, 0.0, 1.0])
    >>> problem.values.real.round(3).tolist()
    [0.0, 0.09]

    Args:
        zeros: z_i, complex ones in conjugate pairs; the origin once for every sample of delay.
        numerator: of M.
        denominator: of M.

    Raises:
        ValueError: a zero is on or outside the unit circle, a complex zero lacks its conjugate, or
            the model has a pole at a zero.
    """

    zeros: Zeros
    numerator: Polynomial
    denominator: Polynomial

    def __init__(
        self,
        zeros: Sequence[complex | float] | np.ndarray,
        numerator: Sequence[float | int] | np.ndarray,
        denominator: Sequence[float | int] | np.ndarray = (1.0,),
    ):
        found = np.atleast_1d(np.asarray(zeros, complex))
        _check_zeros(found)
        top, below = (np.atleast_1d(np.asarray(one, float)) for one in (numerator, denominator))
        for zero in found:
            if abs(polynomial.polyval(zero, below)) <= PAIRED * np.abs(below).sum():
                raise ValueError(f"denominator: the model has a pole at the zero {zero:.6g}")
        object.__setattr__(self, "zeros", found)
        object.__setattr__(self, "numerator", top)
        object.__setattr__(self, "denominator", below)

    @property
    def values(self) -> Zeros:
        """M at the zeros."""
        return polynomial.polyval(self.zeros, self.numerator) / polynomial.polyval(
            self.zeros, self.denominator
        )

    @cached_property
    def shift(self) -> Complex[np.ndarray, "n n"]:
        """S, lambda compressed to the space of the zeros; its eigenvalues are the zeros."""
        z, n = self.zeros, self.zeros.size
        size = np.sqrt(1 - np.abs(z) ** 2)
        S = np.diag(z)
        for i in range(n):
            for k in range(i):
                S[i, k] = size[i] * size[k] * np.prod(-z[k + 1 : i].conj())
        return S

    @cached_property
    def one(self) -> Zeros:
        """Coordinates of the constant one: the conjugates of phi_i(0)."""
        size = np.sqrt(1 - np.abs(self.zeros) ** 2)
        before = np.concatenate([[1.0], np.cumprod(-self.zeros)[:-1]])
        return (size * before.conj()).astype(complex)

    @cached_property
    def model(self) -> Complex[np.ndarray, "n n"]:
        """M(S)."""
        return np.linalg.solve(
            _at_matrix(self.denominator, self.shift), _at_matrix(self.numerator, self.shift)
        )

    def powers(self, count: int) -> Complex[np.ndarray, "n count"]:
        """Coordinates of 1, lambda, lambda^2, ...; their lengths never grow."""
        columns = [self.one]
        for _ in range(count - 1):
            columns.append(self.shift @ columns[-1])
        return np.stack(columns, axis=1)

    def misses(self, taps: Polynomial) -> float:
        """Largest error of E(S) = M(S) in these coordinates; E is a polynomial."""
        reached = self.powers(len(taps)) @ taps
        return float(np.max(np.abs(reached - self.model @ self.one), initial=0.0))


def _at_matrix(coefficients: Polynomial, S) -> Complex[np.ndarray, "n n"]:
    """Polynomial of a matrix, by Horner's rule."""
    found = np.zeros_like(S)
    for coefficient in coefficients[::-1]:
        found = found @ S + coefficient * np.eye(len(S))
    return found


def _check_zeros(zeros: Zeros) -> None:
    if zeros.size and not np.isfinite(zeros).all():
        raise ValueError(f"zeros: need to be finite, received {zeros}")
    for zero in zeros:
        if abs(abs(zero) - 1) <= ON_CIRCLE:
            raise ValueError(
                f"zeros: {zero:.6g} is on the unit circle, where no filter is optimal: "
                "give it to `l1_optimum` as `on_circle`"
            )
        if abs(zero) > 1:
            raise ValueError(
                f"zeros: {zero:.6g} is outside the unit circle in lambda: a filter cancels it"
            )
    check_pairs("zeros", zeros)


def check_pairs(name: str, zeros: Zeros) -> None:
    """Raise ValueError unless complex zeros come in conjugate pairs."""
    left = list(zeros)
    while left:
        zero = left.pop()
        if abs(zero.imag) <= PAIRED:
            continue
        partner = min(left, key=lambda other: abs(other - zero.conjugate()), default=None)
        if partner is None or abs(partner - zero.conjugate()) > PAIRED:
            raise ValueError(f"{name}: the complex zero {zero:.6g} comes without its conjugate")
        left.remove(partner)
