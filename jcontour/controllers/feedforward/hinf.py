"""H-infinity optimal error filters (Nehari, Nevanlinna-Pick), with a certificate.

    minimise max |E| on the unit circle  over all filters that meet a `ModelMatching`

The least value is the largest singular value of M(S) (Sarason): M(S) v = J w. The optimum is the
all-pass filter

    E = J (sum w_i phi_i) / (sum v_i phi_i),   |E| = J on the unit circle.
Alter & Tsao, eq. 3: the norm is the largest ratio of RMS error to RMS reference.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Complex, Float
from numpy.polynomial import polynomial
from scipy.signal import lfilter

from jcontour.controllers.feedforward.model_matching import ModelMatching, Polynomial, Zeros

SHARED = 1e-6  # largest distance of a zero and a pole that cancel


@dataclass(frozen=True, eq=False)
class HinfOptimum:
    """An H-infinity optimal error filter and its certificate.

    Attributes:
        numerator: of E, ascending in lambda.
        denominator: of E; all roots are outside the unit circle.
        cost: J.
        margin: smallest eigenvalue of J^2 I - M(S) M(S)*, Pick's matrix in orthonormal
            coordinates: filters below J exist only if it stays above zero for a smaller J.
    """

    numerator: Polynomial
    denominator: Polynomial
    cost: float
    margin: float

    def response(self, points) -> Complex[np.ndarray, "*f"]:
        """E at points lambda."""
        points = np.asarray(points, complex)
        return polynomial.polyval(points, self.numerator) / polynomial.polyval(
            points, self.denominator
        )

    def samples(self, count: int) -> Float[np.ndarray, " count"]:
        """First samples of the impulse response."""
        pulse = np.zeros(count)
        pulse[0] = 1.0
        return np.asarray(lfilter(self.numerator, self.denominator, pulse))


def hinf_optimum(problem: ModelMatching) -> HinfOptimum:
    """The filter of least H-infinity norm.

    >>> found = hinf_optimum(ModelMatching([0.0, -0.3], numerator=[0.0, 0.0, 1.0]))
    >>> round(found.cost, 12), abs(found.samples(3)).round(12).tolist()
    (0.3, [0.0, 0.3, 0.0])
    """
    if problem.zeros.size == 0:
        return HinfOptimum(np.zeros(1), np.ones(1), 0.0, 0.0)
    X = problem.model
    left, sizes, right = np.linalg.svd(X)
    cost = float(sizes[0])
    if cost == 0:
        return HinfOptimum(np.zeros(1), np.ones(1), 0.0, 0.0)
    eigenvalues = np.linalg.eigvalsh(cost**2 * np.eye(len(X)) - X @ X.conj().T)
    basis = _basis_polynomials(problem.zeros)
    top, below = left[:, 0] @ basis, right[0].conj() @ basis
    phase = below[np.argmax(np.abs(below))]
    top, below = cost * np.real(top / phase), np.real(below / phase)
    top, below = _all_pass(cost, *_without_shared_roots(top, below))
    return HinfOptimum(top / below[0], below / below[0], cost, float(eigenvalues[0]))


def _basis_polynomials(zeros: Zeros) -> Complex[np.ndarray, "n n"]:
    """phi_i times prod_j (1 - z_j* lambda), row by row, ascending."""
    rows = []
    for i, zero in enumerate(zeros):
        row = np.array([np.sqrt(1 - abs(zero) ** 2)], complex)
        for before in zeros[:i]:
            row = np.convolve(row, [-before, 1.0])
        for after in zeros[i + 1 :]:
            row = np.convolve(row, [1.0, -after.conjugate()])
        rows.append(row)
    return np.array(rows)


def _all_pass(cost: float, top: Polynomial, below: Polynomial) -> tuple[Polynomial, Polynomial]:
    """The same quotient with |E| = J to the last digit: the numerator mirrors the denominator."""
    mirrored = cost * np.sign(top @ below[::-1]) * below[::-1]
    alike = np.max(np.abs(top - mirrored)) <= SHARED * np.max(np.abs(top))
    return (mirrored if alike else top), below


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
