"""Optimal feedforward that follows a reference model with preview (Alter & Tsao).

    E = R - G F = T E',   R = lambda^N_p M_0,   M_0 = [(1/lambda + 2 + lambda) / 4]^m,
    T = (1 - lambda)^N,   E'(z) = R(z) / T(z)  at the unstable zeros z of the plant

M_0 is a zero-phase model of order m. T limits the references to those whose N-th difference is
bounded. F = W / P with W = R - E acts on the reference N_p samples ahead, and the machine follows
W of it. A stable feedback cancels: E depends on the unstable zeros of the plant only (errata).
Polynomials are ascending in lambda = z^-1.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import polynomial

from jcontour._arrays import whole_number
from jcontour.controller import warn_of_short_preview
from jcontour.controllers.feedforward.l1 import L1Optimum, l1_optimum
from jcontour.controllers.feedforward.model_matching import HinfOptimum, ModelMatching, Polynomial
from jcontour.linear.transfer_functions import TransferFunction, polynomial_from_zeros, sorted_zeros

MINUS_3_DB = 10**-0.15
LEFT_OVER = 1e-9  # relative remainder that a division may leave
ErrorFilter = L1Optimum | HinfOptimum  # E' and its cost


@dataclass(frozen=True)
class ModelFollowing:
    """Numbers of a model-following problem: m, N_p and N.

    >>> ModelFollowing(order=1, preview=2).response.tolist()
    [0.0, 0.25, 0.5, 0.25]

    Args:
        order: m of the reference model; 0 follows the reference itself.
        preview: N_p [samples].
        constraint: N, the difference of the reference that is bounded.

    Raises:
        ValueError: a number is negative, or the model looks farther ahead than the preview.
    """

    order: int = 0
    preview: int = 0
    constraint: int = 0

    def __post_init__(self):
        for name in ("order", "preview", "constraint"):
            whole_number(name, getattr(self, name))
        if self.preview < self.order:
            raise ValueError(
                f"preview: a model of order {self.order} looks {self.order} samples ahead, "
                f"received {self.preview}"
            )

    @property
    def response(self) -> Polynomial:
        """R = lambda^N_p M_0."""
        model = polynomial.polypow([0.5, 0.5], 2 * self.order)
        return np.concatenate([np.zeros(self.preview - self.order), model])

    @property
    def weight(self) -> Polynomial:
        """T = (1 - lambda)^N."""
        return np.asarray(polynomial.polypow([1.0, -1.0], self.constraint), float)

    def bandwidth(self, dt: float, gain: float = MINUS_3_DB) -> float:
        """Frequency at which M_0 has fallen to `gain` [Hz]; infinite for m = 0."""
        if self.order == 0:
            return float("inf")
        return float(np.arccos(gain ** (1 / (2 * self.order))) / (np.pi * dt))

    def matching(self, zeros: Sequence[complex | float] | np.ndarray) -> ModelMatching:
        """Conditions on E' at these unstable zeros, the origin once for each sample of delay."""
        return ModelMatching(zeros, self.response, self.weight)

    def error(self, optimum: ErrorFilter) -> tuple[Polynomial, Polynomial]:
        """Model following error E = T E': numerator, denominator."""
        return np.convolve(self.weight, optimum.numerator), optimum.denominator

    def tracking_error(self, optimum: ErrorFilter) -> tuple[Polynomial, Polynomial]:
        """Error of the machine against the reference itself, lambda^N_p - R + T E'."""
        delayed = np.eye(1, self.preview + 1, self.preview)[0]
        top, below = self.error(optimum)
        apart = np.convolve(polynomial.polysub(delayed, self.response), below)
        return polynomial.polyadd(apart, top), below


@dataclass(frozen=True, eq=False)
class OptimalFeedforward:
    """An optimal feedforward filter and what it promises."""

    numerator: Polynomial  # of F, the control that a reference needs without feedback
    denominator: Polynomial  # of F
    # W, numerator and denominator: what the machine makes of the previewed reference
    wanted: tuple[Polynomial, Polynomial]
    optimum: ErrorFilter  # the error filter E', with its cost
    preview: int  # N_p [samples]


def optimal_feedforward(
    plant: TransferFunction,
    following: ModelFollowing,
    optimum: Callable[[ModelMatching], ErrorFilter] = l1_optimum,
) -> OptimalFeedforward:
    """The feedforward whose error filter E' has the least norm.

    >>> from jcontour.linear.transfer_functions import from_polynomials
    >>> plant = from_polynomials([0.0, 0.3075, 1.0], [1.0, -1.5, 0.5], dt=5e-4)
    >>> design = optimal_feedforward(plant, ModelFollowing(preview=9))
    >>> f"{design.optimum.cost:.3e}"
    '7.994e-05'

    Args:
        plant: its transfer function.
        following: m, N_p and N.
        optimum: `l1_optimum` or `hinf_optimum`.

    Raises:
        ValueError: the plant has a zero on the unit circle.
    """
    warn_of_short_preview(following.preview, plant.delay)
    zeros = sorted_zeros(plant)
    if zeros.on_circle.size:
        raise ValueError(
            f"plant: the zero {zeros.on_circle[0]:.6g} is on the unit circle, "
            "no filter is optimal: leave the integrator out of the plant, or see `unit_circle`"
        )
    unstable = zeros.unstable
    solution = optimum(following.matching(np.concatenate([np.zeros(plant.delay), unstable])))
    error, below = following.error(solution)
    wanted = polynomial.polysub(np.convolve(following.response, below), error)
    kept = np.concatenate([np.zeros(plant.delay), polynomial_from_zeros(unstable)])
    quotient = divided(wanted, kept, size=float(np.max(np.abs(below))))
    stable = plant.gain * polynomial_from_zeros(zeros.cancellable)
    return OptimalFeedforward(
        np.convolve(quotient, plant.denominator),
        np.convolve(stable, below),
        (wanted, below),
        solution,
        following.preview,
    )


def shortest_error(problem: ModelMatching) -> Polynomial:
    """The filter of as many taps as there are conditions that meets them.

    Of one zero b beside the origin, e0 + lambda (e_b - e0) / b: the closed form of both optima
    where e0 = 0.
    """
    if problem.zeros.size == 0:
        return np.zeros(1)
    powers = problem.powers(problem.zeros.size)
    values = problem.model @ problem.one
    both = np.concatenate([np.real(powers), np.imag(powers)])
    wanted = np.concatenate([np.real(values), np.imag(values)])
    return np.linalg.lstsq(both, wanted, rcond=None)[0]


def parallel_feedforward(
    plant: TransferFunction,
    feedback: tuple[Polynomial, Polynomial],
    wanted: Polynomial,
    shared: Polynomial | tuple[float, ...] = (1.0,),
) -> tuple[Polynomial, Polynomial]:
    """C_ff = F - C_fb beside a feedback that sees the previewed reference (Alter & Tsao, Fig. 1).

        C_ff = (W~ D - P~ C) / (P~ c),   D = A c + P C

    P = P / A is the plant, C / c the feedback; ~ is divided by the plant's delay and unstable
    zeros.

    Args:
        plant: its transfer function.
        feedback: C and c, ascending.
        wanted: W.
        shared: factor that numerator and denominator of C_ff are divided by, such as the
            integrator 1 - lambda that C_fb and C_ff have in common.

    Raises:
        ValueError: a division leaves a remainder.
    """
    top, below = feedback
    unstable = sorted_zeros(plant).unstable
    kept = np.concatenate([np.zeros(plant.delay), np.real(polynomial.polyfromroots(unstable))])
    inverted = divided(plant.numerator, kept)
    loop = polynomial.polyadd(
        np.convolve(plant.denominator, below), np.convolve(plant.numerator, top)
    )
    numerator = polynomial.polysub(
        np.convolve(divided(wanted, kept), loop), np.convolve(inverted, top)
    )
    return divided(numerator, shared), divided(np.convolve(inverted, below), shared)


def divided(top, below, size: float = 0.0) -> Polynomial:
    """Quotient of polynomials that divide.

    Args:
        top: dividend.
        below: divisor.
        size: of the terms that the dividend is the sum of; its own where it is larger.

    Raises:
        ValueError: there is a remainder.
    """
    quotient, remainder = polynomial.polydiv(top, below)
    if np.max(np.abs(remainder)) > LEFT_OVER * max(np.max(np.abs(top)), size):
        raise ValueError(
            f"division: leaves a remainder of {np.max(np.abs(remainder)):.3g}, "
            "the filter does not meet its conditions"
        )
    return quotient
