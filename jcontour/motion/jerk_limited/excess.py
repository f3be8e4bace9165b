"""How far a warped motion is beyond its limits between the points that the search looks at."""

import numpy as np
from jaxtyping import Float

from jcontour._compiled import compiled
from jcontour._native.lanes import WIDTH, fma, load, most, part, root, size_of, spread, store
from jcontour.geometry.along_pieces import filling, in_lanes, moved_axis, wave
from jcontour.geometry.pieces import Piece
from jcontour.motion.jerk_limited.cells import LENGTH, NUMBERS, Cells, old_motion
from jcontour.motion.jerk_limited.cubic_motion import CubicMotion
from jcontour.motion.jerk_limited.limits import AxisLimits

STEPS = 12  # of a cell: the limits are checked at their ends
MARGIN = 2e-4  # of every limit: what may pass between two of them
THIRD = 1 / (9 * 3**0.5)  # most of |t (t - 1) (t - 2)| / 6 between two samples


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
    lanes = in_lanes(numbers, pieces, cells.piece, filling(count))
    over, seen = (1 / np.stack(limits)).ravel(), np.empty(4 * (1 + 3 * axes) * WIDTH)
    peak, scratch = np.empty((len(lanes), 3, WIDTH)), np.empty(2 * WIDTH)
    size = lanes.shape[1] - at
    _fill_peaks(lanes.ravel(), at, size, axes, over, seen, scratch, peak.ravel())
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
            place, v, a, j = _warped(cells, block * entries, spread(x / STEPS))
            cos, sin = wave(cells, block * entries + at, place, scratch)
            fed = spread(0.0)
            for axis in range(axes):
                _, speed, push, jerk = moved_axis(
                    cells, block * entries + at, size, axes, axis, place, v, a, j, cos, sin
                )
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
