"""What limits mean for the unknowns of a warp, at three points of every cell.

A condition is linear in u, u' and u'' at a point, and so in the window of three unknowns of a cell:
for the speed `speed @ c <= 1`, for the acceleration `|acceleration @ c| <= 1`, and for the jerk
`|jerk @ c| <= 1 / sqrt(u)`.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from jcontour.compiled import compiled
from jcontour.geometry.pieces import Piece
from jcontour.motion.jerk_limited.cubic_motion import CubicMotion
from jcontour.motion.jerk_limited.derivatives import axis_jet, chained, moved, wave
from jcontour.motion.jerk_limited.limits import AxisLimits
from jcontour.motion.jerk_limited.warp import Ordinates
from jcontour.native.lanes import part

POINTS = np.array([0.0, 0.5, 1.0])  # of a cell
SIMPSON = np.array([1.0, 4.0, 1.0]) / 6.0
BERNSTEIN = np.stack([(1 - POINTS) ** 2, 2 * POINTS * (1 - POINTS), POINTS**2], axis=1)
SLOPES = np.stack([2 * (POINTS - 1), 2 - 4 * POINTS, 2 * POINTS], axis=1)
BENDS = np.tile([2.0, -4.0, 2.0], (3, 1))
SQUARE, SPEED, STILL = 1, 4, 7  # first rows: of u, of the speed, and of the axes


class Cells(NamedTuple):
    """Cells of a mesh: what they lie on.

    Attributes:
        piece: number of the path's piece.
        place: arc length at which the piece begins [m].
        elapsed: time of the old motion from its own node to the beginning of the cell [s].
        cell: number of the old motion's cell.
        length: of the cell in the old motion's time [s].
    """

    piece: Int[np.ndarray, " n"]
    place: Float[np.ndarray, " n"]
    elapsed: Float[np.ndarray, " n"]
    cell: Int[np.ndarray, " n"]
    length: Float[np.ndarray, " n"]

    def taken(self, some: Bool[np.ndarray, " n"]) -> "Cells":
        """Some of the cells."""
        return Cells(*(values[some] for values in self))


class Conditions(NamedTuple):
    """Conditions of every cell on its window of three unknowns.

    Attributes:
        rows: (n, 7 + 6 m, 3): the middle ordinate of u, which is kept above zero, and u with it;
            `SQUARE`, u at the three points; `SPEED`, the speed there; from `STILL` on the
            acceleration of all axes at one point after the other, and so the jerk.
        weight: (n, 3) of 1 / sqrt(u) at the points in the duration [s].
        axes: number m.
    """

    rows: Float[np.ndarray, "n rows 3"]
    weight: Float[np.ndarray, "n 3"]
    axes: int

    @property
    def limited(self) -> Float[np.ndarray, "n rows 3"]:
        """Rows of acceleration and jerk."""
        return self.rows[:, STILL:]


def conditions(
    pieces: Piece,
    feed: Float[np.ndarray, " P"],
    limits: AxisLimits,
    old: CubicMotion,
    cells: Cells,
    ordinates: Ordinates,
) -> Conditions:
    """Conditions at the beginning, the middle and the end of every cell."""
    axes = pieces.cosine.shape[1]
    rows = np.empty((cells.length.size, STILL + 2 * POINTS.size * axes, 3))
    rows[:, 0] = ordinates.weights[:, 1]
    _fill(pieces, feed, limits, old, cells, ordinates.weights, rows)
    return Conditions(rows, cells.length[:, None] * SIMPSON, axes)


@part
def _fill_window(weights, i, p, length, u, du, ddu):
    """u and its derivatives at a point of cell i, as rows that take the three unknowns."""
    for b in range(3):
        u[b], du[b], ddu[b] = 0.0, 0.0, 0.0
        for q in range(3):
            u[b] += BERNSTEIN[p, q] * weights[i, q, b]
            du[b] += SLOPES[p, q] * weights[i, q, b] / length
            ddu[b] += BENDS[p, q] * weights[i, q, b] / (length * length)


@compiled
def _fill(
    pieces: Piece,
    feed: np.ndarray,
    limits: AxisLimits,
    old: CubicMotion,
    cells: Cells,
    weights: np.ndarray,
    rows: np.ndarray,
) -> None:
    """Write the conditions of the axes, and what they hang on."""
    axes, u, du, ddu = pieces.cosine.shape[1], np.empty(3), np.empty(3), np.empty(3)
    for i in range(cells.length.size):
        k, length = cells.piece[i], cells.length[i]
        for p in range(POINTS.size):
            place, v, a, j = moved(old, cells, i, POINTS[p] * length)
            cos, sin = wave(pieces, k, place)
            _fill_window(weights, i, p, length, u, du, ddu)
            fastest, square = 0.0, 0.0
            for axis in range(axes):
                one, two, three = axis_jet(pieces, k, axis, place, cos, sin)
                first, second, third = chained(one, two, three, v, a, j)
                fastest = max(fastest, abs(first) / limits.speed[axis])
                square += first * first
                r = STILL + p * axes + axis
                for b in range(3):
                    pushed = second * u[b] + 0.5 * first * du[b]
                    jerked = third * u[b] + 1.5 * second * du[b] + 0.5 * first * ddu[b]
                    rows[i, r, b] = pushed / limits.acceleration[axis]
                    rows[i, r + POINTS.size * axes, b] = jerked / limits.jerk[axis]
            fastest = max(fastest, np.sqrt(square) / feed[k])
            for b in range(3):
                rows[i, SQUARE + p, b] = u[b]
                rows[i, SPEED + p, b] = fastest * fastest * u[b]
