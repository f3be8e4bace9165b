"""Modes of a model that its record does not tell from none, or that no machine has.

A zero may cancel their pole.

The pole p adds r p^k to the impulse response, with a residue r in proportion to

    B(p) = b_1 p^(m-1) + ... + b_m

A model with B(p) = 0 has a pole too many. Where that lies inside the 95 % interval of B(p), the
order is too high, and what a larger likelihood then describes is noise: regions of a pole and a
zero that overlap (Ljung, System Identification Toolbox, "Reducing Model Order Using Pole-Zero
Plots").

A pair of poles without damping describes noise as well: in pieces every start then has a vibration
of its own that never ends.
"""

import numpy as np
from jaxtyping import Complex
from scipy.stats import norm

from tuning.identification.estimates import CONFIDENCE
from tuning.identification.linear.evidence import estimate_of
from tuning.identification.linear.output_error import AxisFit

UNDAMPED = 1e-3  # damping: that of a bar of steel; of machines it is a hundredth and more


def hidden_modes(fit: AxisFit) -> Complex[np.ndarray, " h"]:
    """Poles of a fit, integrators apart, whose residue is nought within 95 %, or without damping.

    By the first-order slopes of B(p) over a and b, with p moving as dp/da_i = -p^(n-i) / A'(p).
    B(p) of a complex pole is taken along its own phase: there the interval holds 85 % at least, as
    the phase is free where B(p) = 0. So a pair that is cancelled counts as seen somewhat too often.
    A residue without a finite variance is not seen at all.
    """
    a, b, poles = fit.model.denominator, fit.model.numerator, fit.model.poles
    n, m = len(a), len(b)
    value = np.polyval(b, poles)
    moved = -(poles[:, None] ** np.arange(n - 1, -1, -1)) / _slope(np.append(1.0, a), poles)
    slopes = np.concatenate(
        [_slope(b, poles) * moved, poles[:, None] ** np.arange(m - 1, -1, -1)], axis=1
    )
    along = np.real(slopes * np.exp(-1j * np.angle(value))[:, None])  # of |B(p)|
    covariance = estimate_of(fit).covariance[: n + m, : n + m]
    variance = np.einsum("pi,ij,pj->p", along, covariance, along)
    factor = float(norm.ppf((1 + CONFIDENCE) / 2))
    known = np.where(variance > 0, variance, np.inf)  # nan and rounding below zero: not seen
    return poles[(np.abs(value) < factor * np.sqrt(known)) | _undamped(poles)]


def _undamped(poles: Complex[np.ndarray, " n"]) -> np.ndarray:
    """Whether a pole z = exp(s dt) belongs to a pair whose damping is next to nothing."""
    decay, angle = -np.log(np.maximum(np.abs(poles), 1e-300)), np.angle(poles)
    return (np.imag(poles) != 0) & (decay < UNDAMPED * np.hypot(decay, angle))


def lasting_hidden_mode(fit: AxisFit) -> bool:
    """Whether a hidden mode lasts as long as the mean part that is fitted in one.

    It may stand for what that part begins with, and no controller reaches it.
    """
    ends = np.flatnonzero(np.diff(fit.rows) > 1) + 1
    usual = len(fit.rows) / (len(ends) + 1)
    return bool((1 - np.abs(hidden_modes(fit)) < 1 / usual).any())


def _slope(polynomial: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Derivative of a polynomial, as a column."""
    return np.polyval(np.polyder(polynomial), at)[:, None]
