"""What limits mean for the unknowns of a warp, at three points of every cell.

A condition is linear in u, u' and u'' at a point, and so in the window of three unknowns of a cell:
for the speed `speed @ c <= 1`, for the acceleration `|acceleration @ c| <= 1`, and for the jerk
`|jerk @ c| <= 1 / sqrt(u)`.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from jcontour._compiled import compiled
from jcontour._native.lanes import WIDTH, fma, load, most, part, root, size_of, spread, store
from jcontour.geometry.along_pieces import in_lanes, moved_axis, wave
from jcontour.geometry.pieces import Piece
from jcontour.motion.jerk_limited.cells import LENGTH, NUMBERS, Cells, old_motion
from jcontour.motion.jerk_limited.cubic_motion import CubicMotion
from jcontour.motion.jerk_limited.limits import AxisLimits
from jcontour.motion.jerk_limited.warp import Ordinates

POINTS = 3  # of a cell: its beginning, its middle and its end
SQUARE, SPEED, STILL = 1, 4, 7  # first rows: of u, of the speed, and of the axes


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
    more = np.column_stack([ordinates.weights.reshape(-1, 9), 1 / feed[cells.piece]])
    numbers, over = cells.in_rows(old, more), (1 / np.stack(limits)).ravel()
    lanes = in_lanes(numbers, pieces, cells.piece, cell.ravel())
    at, scratch = numbers.shape[1], np.empty(2 * WIDTH)
    blocks = np.empty((of.size, 3 * (STILL + 2 * POINTS * axes) + POINTS + 1, WIDTH))
    blocks[:, -1] = lane < (ends[of + 1] - ends[of])[:, None]
    _fill(lanes.ravel(), at, lanes.shape[1] - at, axes, over, scratch, blocks.ravel())
    return Conditions(blocks, cell, first, ordinates.first[cell], axes)


@part
def _fill_point(cells, begin, at, size, axes, over, p, blocks, out, scratch):
    """Write the conditions of eight cells at a point."""
    x = 0.5 * p
    place, v, a, j = old_motion(cells, begin, spread(x))
    cos, sin = wave(cells, begin + at, place, scratch)
    inverse = spread(1.0) / load(cells, begin + LENGTH)
    fastest, fed, half = spread(0.0), spread(0.0), spread(0.5)
    for axis in range(axes):
        _, first, second, third = moved_axis(
            cells, begin + at, size, axes, axis, place, v, a, j, cos, sin
        )
        fastest, fed = most(fastest, size_of(first) * spread(over[axis])), fma(first, first, fed)
        pushed, jerked = spread(over[axes + axis]), spread(over[2 * axes + axis])
        row = out + 3 * (STILL + p * axes + axis)
        for k in range(3):
            w0, w1, w2 = _weights(cells, begin, k)
            u = _three(w0, w1, w2, (1 - x) * (1 - x), 2 * x * (1 - x), x * x)
            du = _three(w0, w1, w2, 2 * x - 2, 2 - 4 * x, 2 * x) * inverse
            ddu = _three(w0, w1, w2, 2.0, -4.0, 2.0) * inverse * inverse
            push = fma(second, u, half * first * du) * pushed
            jerk = fma(third, u, fma(spread(1.5) * second, du, half * first * ddu)) * jerked
            store(blocks, row + k, push)
            store(blocks, row + 3 * POINTS * axes + k, jerk)
    fastest = most(fastest, root(fed) * load(cells, begin + NUMBERS + 9))
    for k in range(3):
        w0, w1, w2 = _weights(cells, begin, k)
        u = _three(w0, w1, w2, (1 - x) * (1 - x), 2 * x * (1 - x), x * x)
        store(blocks, out + 3 * (SQUARE + p) + k, u)
        store(blocks, out + 3 * (SPEED + p) + k, fastest * fastest * u)
    weight = load(cells, begin + LENGTH) * spread((4.0 if p == 1 else 1.0) / 6.0)
    store(blocks, out + 3 * (STILL + 2 * POINTS * axes) + p, weight)


@part
def _weights(cells, begin, k):
    """What an unknown counts in the three ordinates of u."""
    at = begin + NUMBERS + k
    return load(cells, at), load(cells, at + 3), load(cells, at + 6)


@part
def _three(x, y, z, by_x, by_y, by_z):
    return fma(spread(by_x), x, fma(spread(by_y), y, spread(by_z) * z))


@compiled
def _fill(cells, at, size, axes, over, scratch, blocks):
    """Write all blocks but what counts in them; `over` inverts the limits."""
    entries = at + size
    after = 3 * (STILL + 2 * POINTS * axes) + POINTS + 1
    for block in range(cells.size // (WIDTH * entries)):
        begin, out = block * entries, block * after
        for k in range(3):
            store(blocks, out + k, load(cells, begin + NUMBERS + 3 + k))
        for p in range(POINTS):
            _fill_point(cells, begin, at, size, axes, over, p, blocks, out, scratch)
