"""Causal inversion of a linear model: feedforward that looks ahead no further than its delay.

    G = lambda^d B^a(lambda) B^u(lambda) / A(lambda)
    u(k) = A(lambda) / (B^a(lambda) B^u(1)) y_d(k + d)
Poles and cancellable zeros leave, of the other zeros B^u the steady gain is matched: the output is
y = B^u(lambda) / B^u(1) y_d. Wang & Chen (2006, Yuan's [44]) invert a non-minimum phase arm
causally. Zero phase tracking cancels the phase of B^u by looking further ahead, with the error of
second order in the frequency. Here it is of first order: a lag, constant along a steady motion.
"""

import numpy as np

from jcontour.controllers.feedforward.preview_filter import PreviewFilter
from jcontour.controllers.feedforward.zpetc import RINGING, uncancelled_zeros
from jcontour.linear.transfer_functions import (
    TransferFunction,
    polynomial_from_zeros,
    sorted_zeros,
)


def causal_filter(transfer: TransferFunction, ringing: float = RINGING) -> PreviewFilter:
    """The filter from y_d to u.

    >>> from jcontour.linear.transfer_functions import from_polynomials
    >>> plant = from_polynomials([0.0, 0.5, 1.0], [1.0, -0.25], dt=1e-3)
    >>> ahead = causal_filter(plant)
    >>> ahead.preview, ahead.numerator.round(4).tolist(), ahead.denominator.tolist()
    (1, [1.0, -0.25], [1.5])

    Args:
        transfer: G.
        ringing: modulus in z above which a stable zero in the left half plane is not cancelled.

    Raises:
        ValueError: B^u(1) = 0.
    """
    cancelled = polynomial_from_zeros(sorted_zeros(transfer, ringing).cancellable)
    gain = transfer.gain * float(np.sum(uncancelled_zeros(transfer, ringing)))
    return PreviewFilter(transfer.denominator, gain * cancelled, transfer.delay)
