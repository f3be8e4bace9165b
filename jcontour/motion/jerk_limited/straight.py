"""Stretches between two stops that are one straight line at one feed: motions in closed form."""

import numpy as np
from jaxtyping import Float, Int

from jcontour.geometry.pieces import Piece
from jcontour.motion.jerk_limited.cubic_motion import CubicMotion
from jcontour.motion.jerk_limited.limits import AxisLimits
from jcontour.motion.jerk_limited.mesh import curved
from jcontour.motion.point_to_point import PointToPoint

SAME = 1e-9  # of the duration: places passed so near a change of the jerk begin no node


def straight_motions(
    pieces: Piece,
    feed: Float[np.ndarray, " P"],
    limits: AxisLimits,
    stretch: Int[np.ndarray, " P"],
) -> list[CubicMotion | None]:
    """Quickest motion of every stretch from rest to rest; None where it bends or changes its feed.

    An axis moves with its part t_i of the direction, so that along the line the limits are the
    least ones of V_i / |t_i|, A_i / |t_i| and J_i / |t_i|; `PointToPoint` is the motion under them.
    A node is where a piece begins.

    Args:
        pieces: of the path.
        feed: greatest speed on every piece [m/s].
        limits: of the axes.
        stretch: number of the stretch of every piece.
    """
    begins = np.flatnonzero(np.diff(stretch, prepend=-1))
    direction = np.abs(pieces.polynomial[:, 1])
    with np.errstate(divide="ignore", over="ignore"):
        speed, acceleration, jerk = (
            np.minimum.reduceat((limit / direction).min(axis=1), begins) for limit in limits
        )
    speed = np.minimum(speed, np.minimum.reduceat(feed, begins))
    even = np.maximum.reduceat(feed, begins) == np.minimum.reduceat(feed, begins)
    flat = even & ~np.logical_or.reduceat(curved(pieces), begins)
    starts = np.append(0.0, np.cumsum(pieces.extent))
    ends = np.append(begins[1:], stretch.size)
    found: list[CubicMotion | None] = [None] * begins.size
    for k in np.flatnonzero(flat):
        places = starts[begins[k] : ends[k] + 1]
        law = PointToPoint(float(places[-1] - places[0]), speed[k], acceleration[k], jerk[k])
        found[k] = _line(places, law)
    return found


def _line(places: Float[np.ndarray, " n"], law: PointToPoint) -> CubicMotion:
    """A law from the first place [m] to the last, with a node at every place."""
    start, arc, speed, acceleration, jerk = law.phases
    powers = np.stack([places[0] + arc, speed, acceleration / 2, jerk / 6], axis=1)
    whole = CubicMotion(np.append(start, law.duration), powers)
    passed = whole.reached(places[1:-1])
    after = np.searchsorted(whole.time, passed)
    apart = np.minimum(passed - whole.time[after - 1], whole.time[after] - passed)
    time = np.unique(np.concatenate([whole.time, passed[apart > SAME * law.duration]]))
    cell = np.searchsorted(start, time[:-1], side="right") - 1
    s, v, a, j = whole.on_cell(cell, time[:-1] - start[cell])
    return CubicMotion(time, np.stack([s, v, a / 2, j / 6], axis=1))
