"""Programs whose coordinates are too coarse for the tolerance: their curves cannot be smoothed.

Ends of chords that are rounded to a step h lie up to a = h/2 beside their curve, on one side and on
the other. A tool that goes through them at a speed v, a chord of a length l each, needs about

    v^2 a (pi/l)^2 of acceleration,        v^3 a (pi/l)^3 of jerk.

Where that is beyond the limits, the tool is slower than it could be: a motion within a tolerance
below h has to follow the rounding.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from jcontour.app.jobs.motion_laws import axis_limits
from jcontour.app.jobs.pace import Pace
from jcontour.geometry.contour import Contour, unpadded
from jcontour.geometry.toolpath_rules import INCH, MM
from jcontour.motion.smoothing import SHARPEST

# [m] of the last digit of coordinates in inches and millimetres, the coarsest first
STEPS = sorted((10.0**-k * unit for unit in (INCH, MM) for k in (1, 2, 3, 4)), reverse=True)
# [m]: coarser than three digits of an inch is a grid that is meant
COARSEST = 30e-6
STRAIGHT = 1e-5  # [rad]: what turns less goes on straight
ON_STEP = 1e-3  # of a step
ALMOST_ALL = 0.99  # of the chords
ENOUGH = 0.1  # of the way that is cut


class Coarse(NamedTuple):
    """Step that coordinates are rounded to [m], and how many moves cannot be smoothed for it."""

    step: float
    moves: int


def coarse_coordinates(
    contour: Contour, speed: Float[np.ndarray, " P"], cut: Bool[np.ndarray, " P"], pace: Pace
) -> Coarse | None:
    """Rounding of coordinates that spoils a jerk-limited motion; None where it spoils none.

    Args:
        contour: of a file.
        speed: that is asked for along every piece [m/s].
        cut: which pieces are cut.
        pace: limits and tolerance.
    """
    limits, tolerance = axis_limits(pace), pace.corner_tolerance
    pieces = unpadded(contour)
    # Straight pieces that turn a little from the one before, or into the next
    straight = cut & (pieces.rate == 0) & ~pieces.polynomial[:, 2:].any(axis=(1, 2))
    along = pieces.polynomial[:, 1]
    cosine = np.sum(along[1:] * along[:-1], axis=1)
    turns = (cosine > np.cos(SHARPEST)) & (cosine < np.cos(STRAIGHT))
    smooth = straight[1:] & straight[:-1] & turns
    chords = np.append(smooth, False) | np.append(False, smooth)
    step = _step_of(pieces.polynomial[chords, 1] * pieces.extent[chords, None])
    if step is None or not tolerance < (1 - ON_STEP) * step <= COARSEST:
        return None
    by_acceleration = np.sqrt(step / 2 / limits.acceleration.min())  # [s]
    by_jerk = np.cbrt(step / 2 / limits.jerk.min())
    slowed = chords & (pieces.extent < np.pi * speed * max(by_acceleration, by_jerk))
    if pieces.extent[slowed].sum() < ENOUGH * pieces.extent[cut].sum():
        return None
    return Coarse(step, int(slowed.sum()))


def _step_of(moves: Float[np.ndarray, "n m"]) -> float | None:
    """Coarsest step [m] that almost all of these moves are multiples of."""
    for step in STEPS if len(moves) else ():
        multiple = moves / step
        on = (np.abs(multiple - np.round(multiple)) < ON_STEP).all(axis=1)
        if on.mean() >= ALMOST_ALL:
            return step
    return None
