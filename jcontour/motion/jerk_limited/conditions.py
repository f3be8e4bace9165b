"""What limits mean for the unknowns of a warp, in cells of a mesh; eight cells are one value.

The rate's square u has one ordinate c_i for every cell; a node between two cells lies on the
straight line between theirs. A condition is linear in u, u' and u'' at a point, and so in the
window of three unknowns of a cell: for the speed `speed @ c <= 1`, for the acceleration
`|acceleration @ c| <= 1`, and for the jerk `|jerk @ c| <= 1 / sqrt(u)`. The search looks at three
points of every cell. What a motion exceeds between them is measured afterwards.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from jcontour._compiled import compiled
from jcontour._native.lanes import WIDTH, fma, load, most, part, root, size_of, spread, store
from jcontour.geometry.along_pieces import filling, in_lanes, moved_axis, wave
from jcontour.geometry.pieces import Piece
from jcontour.motion.jerk_limited.cubic_motion import CubicMotion
from jcontour.motion.jerk_limited.limits import AxisLimits

# numbers of a cell: the old motion's cubic, where the piece begins, the cell's own begin and length
PLACE, ELAPSED, LENGTH, NUMBERS = 4, 5, 6, 7
POINTS = 3  # of a cell: its beginning, its middle and its end
SQUARE, SPEED, STILL = 1, 4, 7  # first rows: of u, of the speed, and of the axes
STEPS = 12  # of a cell: the limits are checked at their ends
MARGIN = 2e-4  # of every limit: what may pass between two of them
THIRD = 1 / (9 * 3**0.5)  # most of |t (t - 1) (t - 2)| / 6 between two samples


class Cells(NamedTuple):
    """Cells of a mesh: what they lie on."""

    piece: Int[np.ndarray, " n"]  # number of the path's piece
    place: Float[np.ndarray, " n"]  # arc length at which the piece begins [m]
    # time of the old motion from its own node to the beginning of the cell [s]
    elapsed: Float[np.ndarray, " n"]
    cell: Int[np.ndarray, " n"]  # number of the old motion's cell
    length: Float[np.ndarray, " n"]  # of the cell in the old motion's time [s]

    def taken(self, some: Int[np.ndarray, " k"] | Bool[np.ndarray, " n"] | slice) -> "Cells":
        """Some of the cells."""
        return Cells(*(values[some] for values in self))

    def in_rows(
        self, old: CubicMotion, more: Float[np.ndarray, "n k"]
    ) -> Float[np.ndarray, "n 7+k"]:
        """The numbers of every cell, and others after them."""
        rows = np.empty((self.length.size, NUMBERS + more.shape[1]))
        rows[:, :PLACE] = old.coefficients[self.cell]
        rows[:, PLACE], rows[:, ELAPSED], rows[:, LENGTH] = (
            self.place,
            self.elapsed,
            self.length,
        )
        rows[:, NUMBERS:] = more
        return rows


@part
def old_motion(cells, at, x):
    """Place on the piece, speed, acceleration and jerk of the old motion at fractions of cells."""
    two, three, six = spread(2.0), spread(3.0), spread(6.0)
    s, v = load(cells, at), load(cells, at + 1)
    a, j = load(cells, at + 2), load(cells, at + 3)
    t = fma(x, load(cells, at + LENGTH), load(cells, at + ELAPSED))
    place = fma(t, fma(t, fma(t, j, a), v), s) - load(cells, at + PLACE)
    return place, fma(t, fma(three * t, j, two * a), v), fma(six * t, j, two * a), six * j


class Ordinates(NamedTuple):
    """How the Bernstein ordinates of a cell follow from the unknowns: a window of three of them."""

    first: Int[np.ndarray, " n"]  # number of the first unknown of the window
    weights: Float[np.ndarray, "n 3 3"]  # (n, ordinate, unknown)

    def of(self, unknowns: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n 3"]:
        """Ordinates of all cells."""
        return np.einsum("nbk,nk->nb", self.weights, self.window(unknowns))

    def window(self, unknowns: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n 3"]:
        """The three unknowns of every cell."""
        return unknowns[self.first[:, None] + np.arange(3)]


def ordinates(length: Float[np.ndarray, " n"], begins: Bool[np.ndarray, " n"]) -> Ordinates:
    """Bernstein ordinates of cells [s]; `begins` says which come after a stop.

    Raises:
        ValueError: fewer than three cells between two stops.
    """
    n = length.size
    stops = np.append(np.flatnonzero(begins), n)
    count = np.diff(stops)
    if count.min() < 3:
        raise ValueError(f"cells: needs at least three between stops, received {count.min()}")
    ends = np.append(begins[1:], True)
    before, after = np.append(0.0, length[:-1]), np.append(length[1:], 0.0)
    weights = np.zeros((n, 3, 5))  # unknowns i-2 .. i+2
    share = np.where(begins, 0.0, length / (length + before))
    weights[:, 0, 1], weights[:, 0, 2] = share, 1.0 - share
    weights[:, 1, 2] = 1.0
    share = np.where(ends, 0.0, length / (length + after))
    weights[:, 2, 3], weights[:, 2, 2] = share, 1.0 - share
    low, high = np.repeat(stops[:-1], count), np.repeat(stops[1:] - 3, count)
    first = np.clip(np.arange(n) - 1, low, high)
    shift = first - np.arange(n) + 2  # 1, but 2 after a stop and 0 before one
    columns = shift[:, None] + np.arange(3)
    return Ordinates(first, np.take_along_axis(weights, columns[:, None, :], axis=2))


class Conditions(NamedTuple):
    """Conditions of every cell on its window of three unknowns; eight cells side by side.

    A stretch begins a block of eight cells; its last cell fills what is left of its last block.
    """

    # (b, 3 rows + 4, 8). Rows of three numbers: the middle ordinate of u, which is kept above zero,
    # and u with it; from `SQUARE` on u at the three points; from `SPEED` on the speed there; from
    # `STILL` on the acceleration of all axes at one point after the other, and so the jerk. Then
    # the weights of 1 / sqrt(u) at the points in the duration [s]; and 1, but 0 in lanes that only
    # fill.
    blocks: Float[np.ndarray, "b entries lanes"]
    cell: Int[np.ndarray, "b lanes"]  # (b, 8) number of the cell of every lane
    first: Int[np.ndarray, " ends"]  # (stretches + 1,) first block of every stretch
    window: Int[np.ndarray, "b lanes"]  # (b, 8) first unknown of the window of every lane
    axes: int  # number m

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
    packed = in_lanes(numbers, pieces, cells.piece, cell.ravel())
    at, scratch = numbers.shape[1], np.empty(2 * WIDTH)
    blocks = np.empty((of.size, 3 * (STILL + 2 * POINTS * axes) + POINTS + 1, WIDTH))
    blocks[:, -1] = lane < (ends[of + 1] - ends[of])[:, None]
    _fill(packed.ravel(), at, packed.shape[1] - at, axes, over, scratch, blocks.ravel())
    return Conditions(blocks, cell, first, ordinates.first[cell], axes)


@part
def _fill_point(cells, begin, layout, over, p, blocks, out, scratch):
    """Write the conditions of eight cells at a point."""
    at, size, axes = layout
    x = 0.5 * p
    motion = old_motion(cells, begin, spread(x))
    waves = wave(cells, begin + at, motion[0], scratch)
    inverse = spread(1.0) / load(cells, begin + LENGTH)
    fastest, fed, half = spread(0.0), spread(0.0), spread(0.5)
    for axis in range(axes):
        _, first, second, third = moved_axis(cells, begin + at, size, axes, axis, motion, waves)
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
            _fill_point(cells, begin, (at, size, axes), over, p, blocks, out, scratch)


def slower(
    pieces: Piece,
    feed: Float[np.ndarray, " P"],
    limits: AxisLimits,
    old: CubicMotion,
    cells: Cells,
    square: Float[np.ndarray, "n 3"],
) -> Float[np.ndarray, " n"]:
    """Factor on the square of the rate of every cell that brings it within all limits."""
    numbers = cells.in_rows(old, np.column_stack([square, 1 / feed[cells.piece]]))
    count, axes, at = len(numbers), limits.jerk.size, numbers.shape[1]
    packed = in_lanes(numbers, pieces, cells.piece, filling(count))
    over, seen = (1 / np.stack(limits)).ravel(), np.empty(4 * (1 + 3 * axes) * WIDTH)
    peak, scratch = np.empty((len(packed), 3, WIDTH)), np.empty(2 * WIDTH)
    size = packed.shape[1] - at
    _fill_peaks(packed.ravel(), at, size, axes, over, seen, scratch, peak.ravel())
    speed, acceleration, jerk = peak.swapaxes(0, 1).reshape(3, -1)[:, :count]
    largest = np.maximum(np.maximum(speed**2, acceleration), np.cbrt(jerk) ** 2)
    return (1 - MARGIN) / np.maximum(largest, 1 - MARGIN)


@part
def _warped(cells, at, x):
    """Place on the piece and derivatives of the warped motion at a fraction of cells."""
    one, two, three = spread(1.0), spread(2.0), spread(3.0)
    first, middle, end = (
        load(cells, at + NUMBERS),
        load(cells, at + NUMBERS + 1),
        load(cells, at + NUMBERS + 2),
    )
    y, length = one - x, load(cells, at + LENGTH)
    u = first * y * y + two * middle * x * y + end * x * x
    half_slope = ((middle - first) * y + (end - middle) * x) / length
    half_bend = (first - two * middle + end) / (length * length)
    place, v, a, j = old_motion(cells, at, x)
    rate = root(u)
    jerk = fma(j, u, fma(three * a, half_slope, v * half_bend))
    return place, v * rate, fma(a, u, v * half_slope), jerk * rate


@part
def _seen(seen, curve, value, x):
    """Take a value of a curve: its last three, and the peak of what it has been.

    A cubic through four samples exceeds the largest by an eighth of the second difference d and by
    max |t (t - 1) (t - 2)| / 6 of the third at most:

        peak <= max |f| + max |d2 f| / 8 + |d3 f| / (9 sqrt 3)
    """
    at = 4 * curve
    last, before, oldest = load(seen, at), load(seen, at + 1), load(seen, at + 2)
    store(seen, at, value)
    store(seen, at + 1, last)
    store(seen, at + 2, before)
    if x > 2:
        bend = value - spread(2.0) * last + before
        earlier = last - spread(2.0) * before + oldest
        largest = most(most(size_of(value), size_of(last)), most(size_of(before), size_of(oldest)))
        peak = fma(spread(0.125), most(size_of(bend), size_of(earlier)), largest)
        peak = fma(spread(THIRD), size_of(bend - earlier), peak)
        store(seen, at + 3, most(load(seen, at + 3), peak))


@part
def _peak(seen, curve):
    """Greatest magnitude of a curve, that between the samples included."""
    return load(seen, 4 * curve + 3)


@compiled
def _fill_peaks(cells, at, size, axes, over, seen, scratch, peak):
    """Write the peaks of speed, acceleration and jerk; `over` inverts the limits."""
    entries = at + size
    for block in range(cells.size // (WIDTH * entries)):
        for k in range(4 * (1 + 3 * axes)):
            store(seen, k, spread(0.0))
        for x in range(STEPS + 1):
            motion = _warped(cells, block * entries, spread(x / STEPS))
            waves = wave(cells, block * entries + at, motion[0], scratch)
            fed = spread(0.0)
            for axis in range(axes):
                row = block * entries + at
                _, speed, push, jerk = moved_axis(cells, row, size, axes, axis, motion, waves)
                fed = fma(speed, speed, fed)
                _seen(seen, axis, speed * spread(over[axis]), x)
                _seen(seen, axes + axis, push * spread(over[axes + axis]), x)
                _seen(seen, 2 * axes + axis, jerk * spread(over[2 * axes + axis]), x)
            _seen(seen, 3 * axes, root(fed) * load(cells, block * entries + NUMBERS + 3), x)
        for kind in range(3):
            largest = _peak(seen, 3 * axes) if kind < 1 else spread(0.0)
            for axis in range(axes):
                largest = most(largest, _peak(seen, kind * axes + axis))
            store(peak, 3 * block + kind, largest)
