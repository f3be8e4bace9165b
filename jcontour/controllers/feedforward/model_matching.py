"""Model matching: a stable error filter E that equals a model M at given unstable zeros.

    E(z_i) = M(z_i),   M = numerator / denominator

A zero that comes r times also fixes the first r - 1 derivatives. Every E = M - G Q with a stable Q
is one of these, and no other filter is (Alter & Tsao, eq. 7). Polynomials are ascending in
lambda = z^-1; |z_i| < 1.

The conditions are written in the orthonormal basis of Takenaka and Malmquist,

    phi_i = sqrt(1 - |z_i|^2) / (1 - z_i* lambda) prod_{j<i} (lambda - z_j) / (1 - z_j* lambda),
where they are well conditioned, near and repeated zeros included: the space is shifted by the
lower triangular S, and the conditions read E(S) = M(S).

H-infinity optimal error filters (Nehari, Nevanlinna-Pick), with a certificate.

    minimise max |E| on the unit circle  over all filters that meet a `ModelMatching`

The least value is the largest singular value of M(S) (Sarason): M(S) v = J w. The optimum is the
all-pass filter

    E = J (sum w_i phi_i) / (sum v_i phi_i),   |E| = J on the unit circle.
Alter & Tsao, eq. 3: the norm is the largest ratio of RMS error to RMS reference.

Suboptimal feedforward for a loop whose plant has a zero on the unit circle (Alter & Tsao, 3).

Integral action in the feedback gives G the zero lambda = 1. An l1 optimum need not exist then. The
paper moves the zero to 1 + eps and lets eps go to zero:

    E_eps = [eps M + (1 - lambda) E_0] / (1 + eps - lambda),   M(1) = 0

E_0 is the optimum without this zero. The cost tends to |E_0|_1 + |E_0(1)| (Vidyasagar, lemma 4.3).
The least cost that a filter attains is smaller: `l1_optimum` with `on_circle=[1.0]`. For one
unstable zero b < 0 they are 2 |M(b)| and 2 |M(b)| / (1 - b) (Corollary 1; the errata's
denominators).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from jaxtyping import Complex, Float
from numpy.polynomial import polynomial
from scipy.signal import lfilter

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
        points = np.atleast_1d(np.asarray(zeros, complex))
        _check_zeros(points)
        top, below = (np.atleast_1d(np.asarray(one, float)) for one in (numerator, denominator))
        for zero in points:
            if abs(polynomial.polyval(zero, below)) <= PAIRED * np.abs(below).sum():
                raise ValueError(f"denominator: the model has a pole at the zero {zero:.6g}")
        object.__setattr__(self, "zeros", points)
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
    value = np.zeros_like(S)
    for coefficient in coefficients[::-1]:
        value = value @ S + coefficient * np.eye(len(S))
    return value


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


SHARED = 1e-6  # largest distance of a zero and a pole that cancel


@dataclass(frozen=True, eq=False)
class HinfOptimum:
    """An H-infinity optimal error filter."""

    numerator: Polynomial  # of E, ascending in lambda
    denominator: Polynomial  # of E; all roots are outside the unit circle
    cost: float  # J


def hinf_optimum(problem: ModelMatching) -> HinfOptimum:
    """The filter of least H-infinity norm.

    >>> optimum = hinf_optimum(ModelMatching([0.0, -0.3], numerator=[0.0, 0.0, 1.0]))
    >>> round(optimum.cost, 12), abs(optimum.numerator).round(12).tolist()
    (0.3, [0.0, 0.3])
    """
    if problem.zeros.size == 0:
        return HinfOptimum(np.zeros(1), np.ones(1), 0.0)
    left, sizes, right = np.linalg.svd(problem.model)
    cost = float(sizes[0])
    if cost == 0:
        return HinfOptimum(np.zeros(1), np.ones(1), 0.0)
    # phi_i times prod_j (1 - z_j* lambda), row by row, ascending
    rows = []
    for i, zero in enumerate(problem.zeros):
        row = np.array([np.sqrt(1 - abs(zero) ** 2)], complex)
        for before in problem.zeros[:i]:
            row = np.convolve(row, [-before, 1.0])
        for after in problem.zeros[i + 1 :]:
            row = np.convolve(row, [1.0, -after.conjugate()])
        rows.append(row)
    basis = np.array(rows)
    top, below = left[:, 0] @ basis, right[0].conj() @ basis
    phase = below[np.argmax(np.abs(below))]
    top, below = cost * np.real(top / phase), np.real(below / phase)
    top, below = _without_shared_roots(top, below)
    mirrored = cost * np.sign(top @ below[::-1]) * below[::-1]
    if np.max(np.abs(top - mirrored)) <= SHARED * np.max(np.abs(top)):
        top = mirrored  # |E| = J to the last digit
    return HinfOptimum(top / below[0], below / below[0], cost)


def _without_shared_roots(top: Polynomial, below: Polynomial) -> tuple[Polynomial, Polynomial]:
    """The same quotient without the unstable poles, which zeros cancel."""
    for root in np.roots(below[::-1]):
        if abs(root) > 1 + SHARED or root.imag < 0:
            continue
        factor = np.array([-root.real, 1.0])
        if root.imag > 0:
            factor = np.array([abs(root) ** 2, -2 * root.real, 1.0])
        quotients = [polynomial.polydiv(one, factor) for one in (top, below)]
        for (_, remainder), one in zip(quotients, (top, below), strict=True):
            assert np.max(np.abs(remainder)) <= SHARED * np.max(np.abs(one)), "a pole is unstable"
        top, below = (quotient for quotient, _ in quotients)
    return top, below


TRUNCATION = 1e-20  # share of a geometric tail that is left out of the sum
MOST_SAMPLES = 10_000_000


class CircleCosts(NamedTuple):
    """Costs of a loop with one unstable zero and one zero at lambda = 1."""

    attainable: float  # 2 |M(b)| / (1 - b)
    limit: float  # 2 |M(b)|, of the paper's suboptimal filters


def corollary_1(value: float, zero: float) -> CircleCosts:
    """Costs where M(1) = 0 and M(b) = `value`.

    >>> [f"{cost:.3g}" for cost in corollary_1(0.3075**8, -0.3075)]
    ['0.000122', '0.00016']

    Raises:
        ValueError: the zero is not between -1 and 0: the corollary holds for b < 0.
    """
    if not -1 < zero < 0:
        raise ValueError(f"zero: the corollary needs one between -1 and 0, received {zero}")
    return CircleCosts(2 * abs(value) / (1 - zero), 2 * abs(value))


def perturbed_error(
    model: tuple[Polynomial, Polynomial], error: Polynomial, eps: float
) -> tuple[Polynomial, Polynomial]:
    """E_eps: numerator and denominator.

    Args:
        model: numerator and denominator of M.
        error: taps of E_0.
        eps: how far the zero is moved.

    Raises:
        ValueError: `eps` is not above zero.
    """
    if not eps > 0:
        raise ValueError(f"eps: needs to be above zero, received {eps}")
    top, below = model
    kept = np.convolve(np.convolve([1.0, -1.0], error), below)
    return (
        polynomial.polyadd(eps * np.asarray(top), kept),
        np.convolve([1 + eps, -1.0], below),
    )


def l1_norm(numerator: Polynomial, denominator: Polynomial) -> float:
    """Sum of the absolute impulse response of a stable filter, to its convergence.

    Raises:
        ValueError: the filter is not stable, or decays too slowly to be summed.
    """
    poles = np.abs(np.roots(denominator))  # in z
    slowest = float(np.max(poles, initial=0.0))
    if slowest >= 1:
        raise ValueError(f"filter: is not stable, a pole has the modulus {slowest:.6g} in z")
    decay = np.log(TRUNCATION) / np.log(max(slowest, 1e-3))
    count = len(numerator) + len(denominator) + int(np.ceil(decay))
    if count > MOST_SAMPLES:
        raise ValueError(f"filter: decays over {count} samples, too many to be summed")
    pulse = np.zeros(count)
    pulse[0] = 1.0
    return float(np.abs(lfilter(numerator, denominator, pulse)).sum())
