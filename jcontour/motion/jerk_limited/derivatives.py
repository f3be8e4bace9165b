"""Derivatives of a path, and of a motion along it."""

import numpy as np
from jaxtyping import Float

from jcontour.geometry.along_pieces import jet
from jcontour.geometry.pieces import Piece
from jcontour.motion.jerk_limited.cubic_motion import MotionSamples

Jet = tuple[np.ndarray, np.ndarray, np.ndarray]  # first, second and third derivative, axes last

SAMPLES = np.linspace(0.0, 1.0, 9)[:, None]  # of a piece


def everywhere(pieces: Piece) -> Float[np.ndarray, "3 9 P m"]:
    """First, second and third derivative [1, 1/m, 1/m^2] at nine places of every piece."""
    s = SAMPLES * pieces.extent
    return jet(pieces, np.broadcast_to(np.arange(pieces.extent.size), s.shape), s)[1:]


def composed(path: Float[np.ndarray, "3 ... m"], motion: MotionSamples) -> Jet:
    """First, second and third derivative of p(sigma(tau)) with respect to tau, axes last."""
    first, second, third = path
    v, a, j = (values[..., None] for values in motion[1:])
    return (
        first * v,
        second * v**2 + first * a,
        third * v**3 + 3 * second * v * a + first * j,
    )
