"""The quickest warp of time between two stops, by a primal-dual interior point method, compiled.

Every step solves Newton's equations for
    minimise T(c) = sum weight / sqrt(u)    subject to    g(c) >= 0,    g_i z_i = mu,
with mu sent to zero (Nocedal & Wright, Numerical Optimization, chapter 19). The curvature of g is
left out: it is that of 1 / sqrt(u), whose tangent lies below it, so that a step along which the
tangents stay positive stays within the limits. Unknowns of neighbouring cells alone meet, so that
the equations have two diagonals beside the main one.

The conditions g of a cell are 1 + 3 + 12 m for m axes: the middle ordinate, the speed at three
points, and there the two sides of the acceleration and of the jerk of every axis, side by side.
Eight neighbouring cells are the lanes of one value; the last one fills what is left of eight.
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Int

from jcontour.compiled import compiled
from jcontour.motion.jerk_limited.conditions import Conditions
from jcontour.motion.jerk_limited.equations import (
    Equations,
    Sums,
    added,
    crossed,
    scatter,
    solve_equations,
)
from jcontour.native import lanes
from jcontour.native.calls import drop_stale
from jcontour.native.lanes import WIDTH, fma, load, most, part, root, spread, store, where_less

_HERE = Path(__file__).parent
drop_stale(_HERE, *_HERE.glob("*.py"), Path(lanes.__file__))

POINTS = 3  # of a cell
SIDES = 4  # of an axis at a point: two of the acceleration, two of the jerk
GAP = 1e-4  # of the duration: by so much at most it may be longer than the optimum
TO_THE_BOUND = 0.95  # of the way at which a condition would be met
JAMMED = 0.1  # of a step: less was possible, and the multipliers begin anew


class _Cells(NamedTuple):
    """Conditions of all cells as arrays of lanes, eight cells after the other.

    The first unknown of every cell and what counts (1, and 0 for lanes that only fill) come first.
    """

    first: np.ndarray
    there: np.ndarray
    middle: np.ndarray
    square: np.ndarray
    weight: np.ndarray
    speed: np.ndarray
    acceleration: np.ndarray
    jerk: np.ndarray


class _Point(NamedTuple):
    """u at the points, the rooms g, their inverses, the multipliers z and how these change."""

    u: np.ndarray
    room: np.ndarray
    over: np.ndarray
    z: np.ndarray
    dual: np.ndarray


@part
def _packed(rows):
    """Numbers of cells (n, r, b) as an array of lanes."""
    n, r, b = rows.shape
    blocks = (n + WIDTH - 1) // WIDTH
    out = np.empty(blocks * r * b * WIDTH)
    for i in range(blocks * WIDTH):
        at = i // WIDTH * r * b * WIDTH + i % WIDTH
        for k in range(r):
            for j in range(b):
                out[at + (k * b + j) * WIDTH] = rows[min(i, n - 1), k, j]
    return out


@part
def _cells(parts, first):
    n = first.size
    blocks = (n + WIDTH - 1) // WIDTH
    whole, there = np.empty(blocks * WIDTH, np.int64), np.empty(blocks * WIDTH)
    for i in range(whole.size):
        whole[i] = first[min(i, n - 1)]
        there[i] = 1.0 if i < n else 0.0
    return _Cells(
        whole,
        there,
        _packed(parts.middle),
        _packed(parts.square),
        _packed(parts.weight),
        _packed(parts.speed),
        _packed(parts.acceleration),
        _packed(parts.jerk),
    )


@part
def _window(cells, block, c, window):
    """The three unknowns of eight cells."""
    for lane in range(WIDTH):
        i = cells.first[block * WIDTH + lane]
        window[lane] = c[i]
        window[WIDTH + lane] = c[i + 1]
        window[2 * WIDTH + lane] = c[i + 2]
    return load(window, 0), load(window, 1), load(window, 2)


@part
def _row(rows, k, x, y, z):
    """Row k of three numbers times a window."""
    return fma(load(rows, 3 * k), x, fma(load(rows, 3 * k + 1), y, load(rows, 3 * k + 2) * z))


@part
def _fill_rooms(cells, axes, block, x, y, z, point):
    """Write u and the rooms of eight cells with a window; 1 where all of them are above zero."""
    zero, one = spread(0.0), spread(1.0)
    k = block * (1 + POINTS + SIDES * POINTS * axes)
    middle = _row(cells.middle, block, x, y, z)
    store(point.room, k, middle)
    within = where_less(zero, middle, one, zero)
    for p in range(POINTS):
        u = _row(cells.square, POINTS * block + p, x, y, z)
        store(point.u, POINTS * block + p, u)
        room = one - _row(cells.speed, POINTS * block + p, x, y, z)
        store(point.room, k + 1 + p, room)
        within = where_less(zero, room, within, zero)
        bound = one / root(u)
        for axis in range(axes):
            r = p * axes + axis
            pushed = _row(cells.acceleration, block * POINTS * axes + r, x, y, z)
            jerked = _row(cells.jerk, block * POINTS * axes + r, x, y, z)
            at = k + 1 + POINTS + SIDES * r
            store(point.room, at, one - pushed)
            store(point.room, at + 1, one + pushed)
            store(point.room, at + 2, bound - jerked)
            store(point.room, at + 3, bound + jerked)
            for side in range(SIDES):
                within = where_less(zero, load(point.room, at + side), within, zero)
    return within


@part
def _held(point, mu, k):
    """A room's weight z / g in the equations, and its pull mu / g; the inverse is kept."""
    over = spread(1.0) / load(point.room, k)
    store(point.over, k, over)
    return load(point.z, k) * over, mu * over


@part
def _three(rows, k):
    return load(rows, 3 * k), load(rows, 3 * k + 1), load(rows, 3 * k + 2)


@part
def _at_point(cells, axes, block, p, point, mu, sums):
    """Sums with the acceleration and the jerk at a point, where the bound of the jerk falls by f.

    The rooms of the jerk are f - j and f + j: what both have of f is added once for all axes.
    """
    zero = spread(0.0)
    sx, sy, sz = _three(cells.square, POINTS * block + p)
    u = load(point.u, POINTS * block + p)
    over_cube = spread(1.0) / (u * root(u))
    falls = spread(-0.5) * over_cube
    both, pulled, qx, qy, qz = zero, zero, zero, zero, zero
    for r in range(p * axes, (p + 1) * axes):
        k = block * (1 + POINTS + SIDES * POINTS * axes) + 1 + POINTS + SIDES * r
        held, pull = _held(point, mu, k)
        held_below, pull_below = _held(point, mu, k + 1)
        x, y, z = _three(cells.acceleration, block * POINTS * axes + r)
        sums = added(sums, held + held_below, pull_below - pull, x, y, z)
        held, pull = _held(point, mu, k + 2)
        held_below, pull_below = _held(point, mu, k + 3)
        x, y, z = _three(cells.jerk, block * POINTS * axes + r)
        sums = added(sums, held + held_below, pull_below - pull, x, y, z)
        both, pulled = both + held + held_below, pulled + pull + pull_below
        apart = (held_below - held) * falls
        qx, qy, qz = fma(apart, x, qx), fma(apart, y, qy), fma(apart, z, qz)
    speeding = spread(0.5) * load(cells.weight, POINTS * block + p) * over_cube
    bend = spread(1.5) * speeding / u
    sums = added(sums, fma(both, falls * falls, bend), fma(pulled, falls, speeding), sx, sy, sz)
    return crossed(sums, qx, qy, qz, sx, sy, sz), speeding * sx, speeding * sy, speeding * sz


@part
def _fill_equations(cells, axes, point, mu, equations):
    zero = spread(0.0)
    equations.band.fill(0.0)
    equations.right.fill(0.0)
    equations.slope.fill(0.0)
    found, mu, n = np.empty(12 * WIDTH), spread(mu), equations.right.size
    for block in range(cells.there.size // WIDTH):
        k = block * (1 + POINTS + SIDES * POINTS * axes)
        sums = Sums(zero, zero, zero, zero, zero, zero, zero, zero, zero)
        slope_x, slope_y, slope_z = zero, zero, zero
        held, pull = _held(point, mu, k)
        x, y, z = _three(cells.middle, block)
        sums = added(sums, held, pull, x, y, z)
        for p in range(POINTS):
            held, pull = _held(point, mu, k + 1 + p)
            x, y, z = _three(cells.speed, POINTS * block + p)
            sums = added(sums, held, zero - pull, x, y, z)
            sums, x, y, z = _at_point(cells, axes, block, p, point, mu, sums)
            slope_x, slope_y, slope_z = slope_x + x, slope_y + y, slope_z + z
        store(found, 0, sums.xx)
        store(found, 1, sums.xy)
        store(found, 2, sums.xz)
        store(found, 3, sums.yy)
        store(found, 4, sums.yz)
        store(found, 5, sums.zz)
        store(found, 6, sums.x)
        store(found, 7, sums.y)
        store(found, 8, sums.z)
        store(found, 9, slope_x)
        store(found, 10, slope_y)
        store(found, 11, slope_z)
        for lane in range(min(WIDTH, n - block * WIDTH)):
            scatter(found, lane, cells.first[block * WIDTH + lane], equations)


@part
def _change(point, mu, k, changed, nearest, nearest_dual):
    """Write the change of a multiplier; inverses of how far room and multiplier can go."""
    over, z = load(point.over, k), load(point.z, k)
    dual = (mu - z * changed) * over - z
    store(point.dual, k, dual)
    zero = spread(0.0)
    return most(nearest, zero - changed * over), most(nearest_dual, zero - dual / z)


@part
def _fill_duals(cells, axes, point, mu, step, window):
    """Write the changes of the multipliers; inverses of how much of both steps meets a zero."""
    zero, mu = spread(0.0), spread(mu)
    one_side, dual_side = zero, zero
    for block in range(cells.there.size // WIDTH):
        x, y, z = _window(cells, block, step, window)
        k = block * (1 + POINTS + SIDES * POINTS * axes)
        changed = _row(cells.middle, block, x, y, z)
        one_side, dual_side = _change(point, mu, k, changed, one_side, dual_side)
        for p in range(POINTS):
            at = POINTS * block + p
            changed = zero - _row(cells.speed, at, x, y, z)
            one_side, dual_side = _change(point, mu, k + 1 + p, changed, one_side, dual_side)
            u = load(point.u, at)
            falling = spread(-0.5) * _row(cells.square, at, x, y, z) / (u * root(u))
            for r in range(p * axes, (p + 1) * axes):
                pushed = _row(cells.acceleration, block * POINTS * axes + r, x, y, z)
                jerked = _row(cells.jerk, block * POINTS * axes + r, x, y, z)
                to = k + 1 + POINTS + SIDES * r
                one_side, dual_side = _change(point, mu, to, zero - pushed, one_side, dual_side)
                one_side, dual_side = _change(point, mu, to + 1, pushed, one_side, dual_side)
                down, up = falling - jerked, falling + jerked
                one_side, dual_side = _change(point, mu, to + 2, down, one_side, dual_side)
                one_side, dual_side = _change(point, mu, to + 3, up, one_side, dual_side)
    return _largest(one_side, window), _largest(dual_side, window)


@part
def _largest(value, numbers):
    store(numbers, 0, value)
    found = numbers[0]
    for lane in range(1, WIDTH):
        found = max(found, numbers[lane])
    return found


@part
def _total(value, numbers):
    store(numbers, 0, value)
    found = 0.0
    for lane in range(WIDTH):
        found += numbers[lane]
    return found


@part
def _go(cells, axes, point, c, far_dual, window):
    """Move to unknowns and along the multipliers: whether it is within, sum g z, and T."""
    zero, one = spread(0.0), spread(1.0)
    far, within, gap, duration = spread(far_dual), one, zero, zero
    rooms = 1 + POINTS + SIDES * POINTS * axes
    for block in range(cells.there.size // WIDTH):
        x, y, z = _window(cells, block, c, window)
        within = within * _fill_rooms(cells, axes, block, x, y, z, point)
        there = load(cells.there, block)
        for k in range(block * rooms, (block + 1) * rooms):
            multiplier = fma(far, load(point.dual, k), load(point.z, k))
            store(point.z, k, multiplier)
            gap = fma(there * multiplier, load(point.room, k), gap)
        for at in range(POINTS * block, POINTS * (block + 1)):
            duration = duration + there * load(cells.weight, at) / root(load(point.u, at))
    inside = _total(within, window) == WIDTH
    return inside, _total(gap, window), _total(duration, window)


@part
def _begin_multipliers(point, mu):
    for k in range(point.z.size // WIDTH):
        store(point.z, k, spread(mu) / load(point.room, k))


@part
def _centring(moved, gain):
    """Factor on mu: small where Newton's step was taken whole, near one while far from the path."""
    if gain > 0.3:
        return 0.9
    return 0.1 if moved > 0.9 else 0.2 if moved > 0.5 else 0.5 if moved > 0.2 else 0.9


@part
def _solved(parts, first, c, steps):
    n, axes = first.size, parts.jerk.shape[1] // POINTS
    cells, window = _cells(parts, first), np.empty(3 * WIDTH)
    blocks = cells.there.size // WIDTH
    size = blocks * (1 + POINTS + SIDES * POINTS * axes) * WIDTH
    u = np.empty(blocks * POINTS * WIDTH)
    point = _Point(u, np.empty(size), np.empty(size), np.zeros(size), np.zeros(size))
    equations, ahead = Equations(np.empty((3, n)), np.empty(n), np.empty(n)), np.empty(n)
    count = n * (1 + POINTS + SIDES * POINTS * axes)
    _, _, duration = _go(cells, axes, point, c, 0.0, window)
    mu = 0.1 * duration / count
    _begin_multipliers(point, mu)
    gap = mu * count
    for _ in range(steps):
        _fill_equations(cells, axes, point, mu, equations)
        solve_equations(equations)
        step = equations.right
        gain = 0.0
        for i in range(n):
            gain -= equations.slope[i] * step[i]
        nearest, nearest_dual = _fill_duals(cells, axes, point, mu, step, window)
        moved = TO_THE_BOUND / max(nearest, TO_THE_BOUND)
        moved_dual = TO_THE_BOUND / max(nearest_dual, TO_THE_BOUND)
        for i in range(n):
            ahead[i] = c[i] + moved * step[i]
        inside, gap_ahead, duration_ahead = _go(cells, axes, point, ahead, moved_dual, window)
        if not inside:  # at rounding: what was found is within all conditions
            return gap
        for i in range(n):
            c[i] = ahead[i]
        gap, before, duration = gap_ahead, duration, duration_ahead
        if gap < GAP * duration and before - duration < 0.3 * GAP * duration:
            return gap
        mu = gap / count * _centring(moved, gain / duration)
        if moved < JAMMED:
            mu = gap / count
            _begin_multipliers(point, mu)
    return gap


@compiled
def solve(
    parts: Conditions,
    first: Int[np.ndarray, " n"],
    c: np.ndarray,
    steps: int,
) -> float:
    """Improve the unknowns of one stretch in place; they begin within every condition.

    The sum of g_i z_i is returned [s]: at the optimum it is zero, and away from it about the time
    that is left to gain. There are so many steps at most; forty are usual.
    """
    return _solved(parts, first, c, steps)
