"""Suboptimal feedforward for a loop whose plant has a zero on the unit circle (Alter & Tsao, 3).

Integral action in the feedback gives G the zero lambda = 1. An l1 optimum need not exist then. The
paper moves the zero to 1 + eps and lets eps go to zero:

    E_eps = [eps M + (1 - lambda) E_0] / (1 + eps - lambda),   M(1) = 0

E_0 is the optimum without this zero. The cost tends to |E_0|_1 + |E_0(1)| (Vidyasagar, lemma 4.3).
The least cost that a filter attains is smaller: `l1_optimum` with `on_circle=[1.0]`. For one
unstable zero b < 0 they are 2 |M(b)| and 2 |M(b)| / (1 - b) (Corollary 1; the errata's
denominators).
"""

from typing import NamedTuple

import numpy as np
from numpy.polynomial import polynomial
from scipy.signal import lfilter

from jcontour.controllers.feedforward.model_matching import Polynomial

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
