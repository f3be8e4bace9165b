"""How far blends reach: within a tolerance, no farther than a feed needs, and without gaps."""

import numpy as np
from jaxtyping import Float

from jcontour.motion.blends import Blends
from jcontour.motion.jerk_limited.limits import AxisLimits

SEARCHES = 60  # halvings and secants for the length of a blend
LEAST = 0.01  # of the reach that the tolerance allows
APPROACHES = 7  # halvings of what is not known of the reach, which is then known to 4 %
SWING = 1.1  # of the curvature that a blend meets: it goes 8 % beyond, however long it is
SHORTEST = 1e-9  # [m] of what is left of a piece between two blends
MEETING = 1e-13  # [m] what is left where two blends meet
SHORTER = 0.99  # of a blend, where less than the shortest would be left: a gap, which turns


def within(blends: Blends, tolerance: Float[np.ndarray, " B"]) -> Blends:
    """The blends shortened until each is within its tolerance [m].

    Near its end the search takes the deviation to grow with the reach at a corner, and with its
    square where the curvature jumps.
    """
    for _ in range(SEARCHES):
        deviation = blends.deviation()
        over = np.flatnonzero(deviation > tolerance)
        if over.size == 0:
            break
        fewer = blends.some(over)
        nearby = fewer._replace(reach=0.9 * fewer.reach).deviation()
        with np.errstate(divide="ignore", invalid="ignore"):
            power = np.log(deviation[over] / nearby) / np.log(1 / 0.9)
        steep = np.clip(np.nan_to_num(power, nan=1.0), 0.5, 4.0)
        factor = (0.999 * tolerance[over] / deviation[over]) ** (1 / steep)
        reach = blends.reach.copy()
        reach[over] *= np.clip(factor, 1e-3, 0.999)
        blends = blends._replace(reach=reach)
    return blends


def as_needed(
    blends: Blends,
    tolerance: Float[np.ndarray, " B"],
    feed: Float[np.ndarray, " B"],
    limits: AxisLimits,
) -> Blends:
    """The blends shortened to what their feed needs: longer ones would be passed no faster.

    At a speed v along a blend every axis has the acceleration v^2 r_ss and the jerk v^3 r_sss,
    larger ones where it is shorter. They may be as large as `AxisLimits.at_ease`, the acceleration
    also about as large as beside the blend. A blend that is not passed so stays as it is, and one
    that would deviate more where it is shorter, as may be between curves.

    Args:
        blends: as long as the tolerance allows.
        tolerance: of each [m].
        feed: that is asked for in each [m/s]. Where the speed limit of an axis, or the curvature
            and the acceleration limit, allow less beside the blend, v is that.
        limits: of the axes.
    """
    _, tangent, bend = np.swapaxes(blends.ends(), 0, 1)
    with np.errstate(divide="ignore"):
        speed = (limits.speed / np.abs(tangent)).min(axis=(0, 2))
        turning = np.sqrt((limits.acceleration / np.abs(bend)).min(axis=(0, 2)))
    v = np.minimum(np.minimum(feed, speed), turning)[:, None]
    beside = np.abs(bend).max(axis=0) * v**2
    acceleration = np.maximum(limits.at_ease.acceleration, SWING * beside)
    jerk = limits.at_ease.jerk
    enough, short = np.ones(feed.size), np.full(feed.size, LEAST)
    for _ in range(APPROACHES):
        between = np.sqrt(enough * short)
        with np.errstate(divide="ignore", invalid="ignore"):  # a blend that has no reach at all
            along = blends._replace(reach=between * blends.reach).along()
        _, second, third = np.abs(along).max(axis=2)
        easy = (second * v**2 <= acceleration) & (third * v**3 <= jerk)
        passed = easy.all(axis=1)
        enough, short = np.where(passed, between, enough), np.where(passed, short, between)
    shorter = blends._replace(reach=enough * blends.reach)
    near = shorter.deviation() <= tolerance
    return shorter._replace(reach=np.where(near, shorter.reach, blends.reach))


def without_gaps(blends: Blends) -> Blends:
    """The blends, those a little shortened between which too little of a piece is left.

    A blend that still leaves too little is none: its piece would be lost, and the path have a gap.
    """
    left = blends.left()[blends.at]
    narrow = (left > MEETING) & (left <= SHORTEST)
    blends = blends._replace(reach=np.where(narrow, SHORTER, 1.0) * blends.reach)
    left = blends.left()
    lost = (left > MEETING) & (left <= SHORTEST)
    return blends.some(~(lost[blends.at] | lost[blends.at + 1]))
