"""How far a warped motion is beyond its limits between the points that the search looks at."""

import numpy as np
from jaxtyping import Float

from jcontour.compiled import compiled
from jcontour.geometry.along_pieces import in_rows, moved_axis, wave
from jcontour.geometry.pieces import Piece
from jcontour.motion.jerk_limited.conditions import Cells
from jcontour.motion.jerk_limited.cubic_motion import CubicMotion
from jcontour.motion.jerk_limited.limits import AxisLimits
from jcontour.native.lanes import part

CHECKED = np.linspace(0.0, 1.0, 13)  # fractions of a cell at which the limits are checked
MARGIN = 2e-4  # of every limit: what may pass between two of them


def slower(
    pieces: Piece,
    feed: Float[np.ndarray, " P"],
    limits: AxisLimits,
    old: CubicMotion,
    cells: Cells,
    square: Float[np.ndarray, "n 3"],
) -> Float[np.ndarray, " n"]:
    """Factor on the square of the rate of every cell that brings it within all limits."""
    warped = np.concatenate([*cells.in_columns(old), square], axis=1)
    rows, greatest, factor = in_rows(pieces), np.stack(limits), np.empty(len(warped))
    _fill_factors(rows, cells.piece, feed[cells.piece], greatest, warped, factor)
    return factor


@part
def _moved(row, x):
    """Place on the piece [m] and derivatives of the warped motion at a fraction of a cell."""
    s, v, a, j = row[0], row[1], row[2], row[3]
    place, length, first, middle, end = row[4], row[6], row[7], row[8], row[9]
    t = row[5] + x * length
    u = first * (1 - x) ** 2 + middle * 2 * x * (1 - x) + end * x * x
    half_slope = (first * (x - 1) + middle * (1 - 2 * x) + end * x) / length
    half_bend = (first - 2 * middle + end) / (length * length)
    arc = s + t * (v + t * (a + t * j)) - place
    v, a, j = v + t * (2 * a + 3 * t * j), 2 * a + 6 * t * j, 6 * j
    rate = np.sqrt(u)
    jerk = j * u + 3.0 * a * half_slope + v * half_bend
    return arc, v * rate, a * u + v * half_slope, jerk * rate


@compiled
def _fill_factors(
    rows: np.ndarray,
    piece: np.ndarray,
    feed: np.ndarray,
    limits: np.ndarray,
    warped: np.ndarray,
    factor: np.ndarray,
) -> None:
    """Write the factors; `warped` has the old cubic, the cell and the square of the rate."""
    axes = limits.shape[1]
    values = np.empty((1 + 3 * axes, CHECKED.size))
    for i in range(factor.size):
        row = rows[piece[i]]
        for x in range(CHECKED.size):
            place, v, a, j = _moved(warped[i], CHECKED[x])
            cos, sin = wave(row, place)
            fed = 0.0
            for axis in range(axes):
                found = moved_axis(row, axes, axis, place, v, a, j, cos, sin)
                fed += found[1] * found[1]
                for k in range(3):
                    values[1 + k * axes + axis, x] = found[1 + k] / limits[k, axis]
            values[0, x] = np.sqrt(fed) / feed[i]
        most = 0.0
        for k in range(values.shape[0]):
            peak = _peak(values[k])
            kind = (k - 1) // axes  # of limit: speed, acceleration, jerk
            most = max(most, peak * peak if kind < 1 else peak if kind < 2 else peak ** (2 / 3))
        factor[i] = (1 - MARGIN) / max(most, 1 - MARGIN)


@part
def _peak(values):
    """Greatest magnitude of a curve, that between the samples included.

    A parabola through three samples exceeds them by an eighth of their second difference.
    """
    largest, between = 0.0, 0.0
    for x in range(values.size):
        largest = max(largest, abs(values[x]))
        if 0 < x < values.size - 1:
            between = max(between, abs(values[x + 1] - 2 * values[x] + values[x - 1]))
    return largest + between / 8
