"""What limits mean for the unknowns of a warp, at three points of every cell.

A condition is linear in u, u' and u'' at a point, and so in the window of three unknowns of a cell:
for the speed `speed @ c <= 1`, for the acceleration `|acceleration @ c| <= 1`, and for the jerk
`|jerk @ c| <= 1 / sqrt(u)`.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from jcontour.geometry.along_pieces import moved
from jcontour.geometry.pieces import Piece
from jcontour.motion.jerk_limited.cubic_motion import CubicMotion, MotionSamples
from jcontour.motion.jerk_limited.limits import AxisLimits
from jcontour.motion.jerk_limited.warp import Ordinates

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

    def taken(self, some: Bool[np.ndarray, " n"] | slice) -> "Cells":
        """Some of the cells."""
        return Cells(*(values[some] for values in self))

    def old_motion(self, old: CubicMotion, fraction: Float[np.ndarray, " k"]) -> MotionSamples:
        """The old motion at fractions of all cells, (k, n); arc lengths are those of the pieces."""
        found = old.on_cell(self.cell, self.elapsed + fraction[:, None] * self.length)
        return found._replace(arc=found.arc - self.place)

    def moved(self, pieces: Piece, motion: MotionSamples) -> Float[np.ndarray, "3 k n m"]:
        """Speed, acceleration and jerk of the axes in a motion along the pieces."""
        piece = np.broadcast_to(self.piece, motion.arc.shape)
        return moved(pieces, piece, np.stack(motion))[1:]


class Conditions(NamedTuple):
    """Conditions of every cell on its window of three unknowns.

    Attributes:
        rows: (7 + 6 m, 3, n): the middle ordinate of u, which is kept above zero, and u with it;
            `SQUARE`, u at the three points; `SPEED`, the speed there; from `STILL` on the
            acceleration of all axes at one point after the other, and so the jerk.
        weight: (3, n) of 1 / sqrt(u) at the points in the duration [s].
        axes: number m.
    """

    rows: Float[np.ndarray, "rows 3 n"]
    weight: Float[np.ndarray, "3 n"]
    axes: int

    @property
    def limited(self) -> Float[np.ndarray, "rows 3 n"]:
        """Rows of acceleration and jerk."""
        return self.rows[STILL:]

    def taken(self, some: slice) -> "Conditions":
        """Those of some cells."""
        return Conditions(self.rows[..., some], self.weight[:, some], self.axes)


def conditions(
    pieces: Piece,
    feed: Float[np.ndarray, " P"],
    limits: AxisLimits,
    old: CubicMotion,
    cells: Cells,
    ordinates: Ordinates,
) -> Conditions:
    """Conditions at the beginning, the middle and the end of every cell."""
    jets = cells.moved(pieces, cells.old_motion(old, POINTS))
    first, second, third = (values.swapaxes(1, 2).copy()[:, :, None] for values in jets)
    fastest = np.abs(first[:, :, 0] / limits.speed[:, None]).max(axis=1)
    at_feed = np.sqrt(np.square(first[:, :, 0]).sum(axis=1)) / feed[cells.piece]
    weights = np.ascontiguousarray(ordinates.weights.transpose(1, 2, 0))
    u, du, ddu = (
        np.tensordot(values, weights, 1) / cells.length**power
        for power, values in enumerate((BERNSTEIN, SLOPES, BENDS))
    )
    speed = np.maximum(fastest, at_feed)[:, None] ** 2 * u
    w, dw, ddw = u[:, None], du[:, None], ddu[:, None]
    pushed = (second * w + 0.5 * first * dw) / limits.acceleration[:, None, None]
    jerked = (third * w + 1.5 * second * dw + 0.5 * first * ddw) / limits.jerk[:, None, None]
    rows = [
        weights[1:2],
        u,
        speed,
        *(values.reshape(-1, *u.shape[1:]) for values in (pushed, jerked)),
    ]
    weight = SIMPSON[:, None] * cells.length
    return Conditions(np.concatenate(rows), weight, pieces.cosine.shape[1])
