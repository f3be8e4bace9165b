"""How far a warped motion is beyond its limits between the points that the search looks at."""

import numpy as np
from jaxtyping import Float

from jcontour.compiled import compiled
from jcontour.geometry.pieces import Piece
from jcontour.motion.jerk_limited.conditions import Cells
from jcontour.motion.jerk_limited.cubic_motion import CubicMotion
from jcontour.motion.jerk_limited.derivatives import axis_jet, chained, moved, wave
from jcontour.motion.jerk_limited.limits import AxisLimits
from jcontour.native.lanes import part

CHECKED = np.linspace(0.0, 1.0, 13)  # fractions of a cell at which the limits are checked
MARGIN = 2e-4  # of every limit: what may pass between two of them


@part
def _warped(old, cells, square, i, x):
    """Place on the piece [m] and derivatives of the motion at a fraction of cell i."""
    first, middle, end, length = square[i, 0], square[i, 1], square[i, 2], cells.length[i]
    u = first * (1 - x) ** 2 + middle * 2 * x * (1 - x) + end * x**2
    half_slope = (first * (x - 1) + middle * (1 - 2 * x) + end * x) / length
    half_bend = (first - 2 * middle + end) / length**2
    rate = np.sqrt(u)
    place, v, a, j = moved(old, cells, i, x * length)
    return place, *chained(v, a, j, rate, half_slope, half_bend * rate)


@part
def _fill_values(pieces, feed, limits, old, cells, square, i, values):
    """Feed, and speed, acceleration and jerk of every axis, over their limits: (1 + 3 m, points).

    Derivatives of s(t) go through the path's as those of the warp go through the old motion's.
    """
    axes, k = pieces.cosine.shape[1], cells.piece[i]
    for x in range(CHECKED.size):
        place, v, a, j = _warped(old, cells, square, i, CHECKED[x])
        cos, sin = wave(pieces, k, place)
        fed = 0.0
        for axis in range(axes):
            first, second, third = axis_jet(pieces, k, axis, place, cos, sin)
            speed, acceleration, jerk = chained(first, second, third, v, a, j)
            fed += speed * speed
            values[1 + axis, x] = speed / limits.speed[axis]
            values[1 + axes + axis, x] = acceleration / limits.acceleration[axis]
            values[1 + 2 * axes + axis, x] = jerk / limits.jerk[axis]
        values[0, x] = np.sqrt(fed) / feed[k]


@part
def _peak(values):
    """Greatest magnitude of some rows, that between the samples included.

    A parabola through three samples exceeds them by an eighth of their second difference.
    """
    peak = 0.0
    for row in range(values.shape[0]):
        largest, between = 0.0, 0.0
        for x in range(values.shape[1]):
            largest = max(largest, abs(values[row, x]))
        for x in range(1, values.shape[1] - 1):
            bent = values[row, x + 1] - 2 * values[row, x] + values[row, x - 1]
            between = max(between, abs(bent))
        peak = max(peak, largest + between / 8)
    return peak


@compiled
def slower(
    pieces: Piece,
    feed: Float[np.ndarray, " P"],
    limits: AxisLimits,
    old: CubicMotion,
    cells: Cells,
    square: Float[np.ndarray, "n 3"],
) -> Float[np.ndarray, " n"]:
    """Factor on the square of the rate of every cell that brings it within all limits."""
    axes = pieces.cosine.shape[1]
    values = np.empty((1 + 3 * axes, CHECKED.size))
    factor = np.empty(cells.length.size)
    for i in range(factor.size):
        _fill_values(pieces, feed, limits, old, cells, square, i, values)
        speed = _peak(values[: 1 + axes])
        acceleration = _peak(values[1 + axes : 1 + 2 * axes])
        jerk = _peak(values[1 + 2 * axes :])
        most = max(speed * speed, acceleration, np.cbrt(jerk * jerk))
        factor[i] = (1 - MARGIN) / max(most, 1 - MARGIN)
    return factor
