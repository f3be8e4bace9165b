"""What limits mean for the unknowns of a warp, at three points of every cell.

A condition is linear in u, u' and u'' at a point, and so in the window of three unknowns of a cell:
for the speed `speed @ c <= 1`, for the acceleration `|acceleration @ c| <= 1`, and for the jerk
`|jerk @ c| <= 1 / sqrt(u)`.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from jcontour.compiled import compiled
from jcontour.geometry.along_pieces import in_rows, moved_axis, wave
from jcontour.geometry.pieces import Piece
from jcontour.motion.jerk_limited.cubic_motion import CubicMotion
from jcontour.motion.jerk_limited.limits import AxisLimits
from jcontour.motion.jerk_limited.warp import Ordinates
from jcontour.native.lanes import WIDTH, part

POINTS = 3  # of a cell: its beginning, its middle and its end
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

    def in_columns(self, old: CubicMotion) -> list[Float[np.ndarray, "n _"]]:
        """The old motion's cubics, and `place`, `elapsed` and `length` of the cells."""
        numbers = (self.place, self.elapsed, self.length)
        return [old.coefficients[self.cell], *(values[:, None] for values in numbers)]


class Conditions(NamedTuple):
    """Conditions of every cell on its window of three unknowns; eight cells side by side.

    A stretch begins a block of eight cells; its last cell fills what is left of its last block.

    Attributes:
        blocks: (b, 3 rows + 4, 8). Rows of three numbers: the middle ordinate of u, which is kept
            above zero, and u with it; from `SQUARE` on u at the three points; from `SPEED` on the
            speed there; from `STILL` on the acceleration of all axes at one point after the other,
            and so the jerk. Then the weights of 1 / sqrt(u) at the points in the duration [s]; and
            1, but 0 in lanes that only fill.
        cell: (b, 8) number of the cell of every lane.
        first: (stretches + 1,) first block of every stretch.
        window: (b, 8) first unknown of the window of every lane.
        axes: number m.
    """

    blocks: Float[np.ndarray, "b entries lanes"]
    cell: Int[np.ndarray, "b lanes"]
    first: Int[np.ndarray, " ends"]
    window: Int[np.ndarray, "b lanes"]
    axes: int

    def values(self, unknowns: Float[np.ndarray, " n"]) -> Float[np.ndarray, "rows b lanes"]:
        """Every row times its window of the unknowns."""
        x, y, z = (unknowns[self.window + k] for k in range(3))
        rows = np.moveaxis(self.blocks[:, :-4], 1, 0)
        return rows[::3] * x + rows[1::3] * y + rows[2::3] * z

    def tighten(self, factor: Float[np.ndarray, " n"]) -> None:
        """Make acceleration and jerk of every cell count so many times as much."""
        self.blocks[:, 3 * STILL : -4] *= factor[self.cell][:, None]


def conditions(
    pieces: Piece,
    feed: Float[np.ndarray, " P"],
    limits: AxisLimits,
    old: CubicMotion,
    cells: Cells,
    ordinates: Ordinates,
    stretch: Int[np.ndarray, " n"],
) -> Conditions:
    """Conditions at the beginning, the middle and the end of every cell.

    Args:
        pieces: of the path.
        feed: greatest speed on every piece [m/s].
        limits: of the axes.
        old: motion that is warped.
        cells: of the mesh.
        ordinates: of the cells.
        stretch: number of the stretch of every cell.
    """
    axes, ends = pieces.cosine.shape[1], np.flatnonzero(np.diff(stretch, prepend=-1, append=-1))
    first = np.append(0, np.cumsum(-(-np.diff(ends) // WIDTH)))
    of = np.repeat(np.arange(ends.size - 1), np.diff(first))  # stretch of every block
    lane = np.arange(WIDTH) + WIDTH * (np.arange(of.size) - first[of])[:, None]
    cell = np.minimum(ends[of, None] + lane, ends[of + 1, None] - 1)
    blocks = np.empty((of.size, 3 * (STILL + 2 * POINTS * axes) + POINTS + 1, WIDTH))
    weights = ordinates.weights.reshape(-1, 9)
    columns = [*cells.in_columns(old), feed[cells.piece, None], weights]
    numbers = np.concatenate(columns, axis=1)
    _fill(in_rows(pieces), cells.piece, np.stack(limits), numbers, cell, blocks)
    return Conditions(blocks, cell, first, ordinates.first[cell], axes)


@part
def _fill_point(row, limits, numbers, p, out):
    """Write the conditions of a cell at a point."""
    axes, x, length = limits.shape[1], 0.5 * p, numbers[6]
    t, s, v, a, j = numbers[5] + x * length, numbers[0], numbers[1], numbers[2], numbers[3]
    place = s + t * (v + t * (a + t * j)) - numbers[4]
    v, a, j = v + t * (2 * a + 3 * t * j), 2 * a + 6 * t * j, 6 * j
    cos, sin = wave(row, place)
    for k in range(3):
        w0, w1, w2 = numbers[8 + k], numbers[11 + k], numbers[14 + k]
        out[3 * (SQUARE + p) + k] = (1 - x) * (1 - x) * w0 + 2 * x * (1 - x) * w1 + x * x * w2
    fastest, fed = 0.0, 0.0
    for axis in range(axes):
        _, first, second, third = moved_axis(row, axes, axis, place, v, a, j, cos, sin)
        fastest, fed = max(fastest, abs(first) / limits[0, axis]), fed + first * first
        at = 3 * (STILL + p * axes + axis)
        for k in range(3):
            w0, w1, w2 = numbers[8 + k], numbers[11 + k], numbers[14 + k]
            u = out[3 * (SQUARE + p) + k]
            du = ((2 * x - 2) * w0 + (2 - 4 * x) * w1 + 2 * x * w2) / length
            ddu = (2 * w0 - 4 * w1 + 2 * w2) / (length * length)
            out[at + k] = (second * u + 0.5 * first * du) / limits[1, axis]
            jerk = third * u + 1.5 * second * du + 0.5 * first * ddu
            out[at + 3 * POINTS * axes + k] = jerk / limits[2, axis]
    fastest = max(fastest, np.sqrt(fed) / numbers[7])
    for k in range(3):
        out[3 * (SPEED + p) + k] = fastest * fastest * out[3 * (SQUARE + p) + k]
    out[3 * (STILL + 2 * POINTS * axes) + p] = length * (4.0 if p == 1 else 1.0) / 6.0


@compiled
def _fill(
    rows: np.ndarray,
    piece: np.ndarray,
    limits: np.ndarray,
    numbers: np.ndarray,
    cell: np.ndarray,
    blocks: np.ndarray,
) -> None:
    """Write the blocks; `numbers` has the old cubic, the cell, the feed and the weights."""
    before = -1
    for b in range(cell.shape[0]):
        for lane in range(WIDTH):
            i = cell[b, lane]
            out = blocks[b, :, lane]
            for k in range(3):
                out[k] = numbers[i, 11 + k]
            for p in range(POINTS):
                _fill_point(rows[piece[i]], limits, numbers[i], p, out)
            out[out.size - 1] = 0.0 if i == before else 1.0
            before = i
