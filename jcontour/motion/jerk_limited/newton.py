"""The quickest warp of time between two stops, by a primal-dual interior point method, compiled.

Every step solves Newton's equations for
    minimise T(c) = sum weight / sqrt(u)    subject to    g(c) >= 0,    g_i z_i = mu,
with mu sent to zero (Nocedal & Wright, Numerical Optimization, chapter 19). The curvature of g is
left out: it is that of 1 / sqrt(u), whose tangent lies below it, so that a step along which the
tangents stay positive stays within the limits. Unknowns of neighbouring cells alone meet, so that
the equations have two diagonals beside the main one.

The conditions g of a cell are 1 + 3 + 12 m for m axes: the middle ordinate, the speed at three
points, and there the two sides of the acceleration and of the jerk of every axis, side by side.
Eight neighbouring cells are the lanes of one value; the last one fills what is left of eight. Such
a block has its entries side by side in two flat arrays, since every array that one compiled part
hands to another takes time to compile:

    cells   the blocks of `Conditions`
    point   u at the points; then for every g the room g, its inverse, its z and the change of z
"""

from pathlib import Path

import numpy as np
from jaxtyping import Float

from jcontour.compiled import compiled
from jcontour.geometry import along_pieces
from jcontour.motion.jerk_limited.conditions import POINTS, SPEED, SQUARE, STILL
from jcontour.motion.jerk_limited.equations import (
    PER_UNKNOWN,
    SLOPE,
    Sums,
    added,
    crossed,
    scatter,
    solve_equations,
)
from jcontour.native import lanes
from jcontour.native.lanes import (
    WIDTH,
    drop_stale,
    fma,
    load,
    most,
    part,
    root,
    spread,
    store,
    where_less,
)

_HERE = Path(__file__).parent
drop_stale(_HERE, *_HERE.glob("*.py"), Path(along_pieces.__file__), Path(lanes.__file__))

PER_ROOM = 4  # entries of `point`: the room, its inverse, the multiplier z and how it changes
OVER, DUAL, CHANGE = 1, 2, 3  # entries of `point` beside a room
GAP = 1e-4  # of the duration: by so much at most it may be longer than the optimum
TO_THE_BOUND = 0.95  # of the way at which a condition would be met
JAMMED = 0.1  # of a step: less was possible, and the multipliers begin anew


def solve(
    blocks: Float[np.ndarray, "b entries lanes"],
    axes: int,
    c: Float[np.ndarray, " n"],
    steps: int,
) -> float:
    """Improve the unknowns of one stretch in place; they begin within every condition.

    The sum of g_i z_i is returned [s]: at the optimum it is zero, and away from it about the time
    that is left to gain. There are so many steps at most; forty are usual.

    Args:
        blocks: those of `Conditions`.
        axes: number m.
        c: unknowns.
        steps: of Newton's method.

    Raises:
        ValueError: the unknowns break a condition.
    """
    point = np.zeros(len(blocks) * _point_size(axes) * WIDTH)
    equations, scratch = np.empty(PER_UNKNOWN * c.size), np.empty(12 * WIDTH)
    step, ahead = np.empty(c.size), np.empty(c.size)
    gap = _solved(blocks.ravel(), axes, c, steps, point, equations, step, ahead, scratch)
    if gap < 0:
        raise ValueError("start: needs to be within every condition")
    return gap


def _point_size(axes):
    """Entries of a block in `point`."""
    return POINTS + PER_ROOM * (1 + POINTS + 4 * POINTS * axes)


@part
def _starts(axes, block):
    """Where a block begins in `cells` and in `point`, and where its rooms of the axes do."""
    rows = STILL + 2 * POINTS * axes
    rooms = 1 + POINTS + 4 * POINTS * axes
    at = block * (POINTS + PER_ROOM * rooms)
    return block * (3 * rows + POINTS + 1), at, at + POINTS + PER_ROOM * (1 + POINTS)


@part
def _three(cells, row):
    return load(cells, row), load(cells, row + 1), load(cells, row + 2)


@part
def _times(cells, row, x, y, z):
    """A row of three numbers times a window."""
    return fma(load(cells, row), x, fma(load(cells, row + 1), y, load(cells, row + 2) * z))


@part
def _window(block, c, scratch):
    """The three unknowns of eight cells."""
    for lane in range(WIDTH):
        i = _first(block * WIDTH + lane, c.size)
        scratch[lane] = c[i]
        scratch[WIDTH + lane] = c[i + 1]
        scratch[2 * WIDTH + lane] = c[i + 2]
    return load(scratch, 0), load(scratch, 1), load(scratch, 2)


@part
def _first(cell, n):
    """Number of the first unknown of a cell's window."""
    return 0 if cell < 2 else n - 3 if cell > n - 3 else cell - 1


@part
def _fill_rooms(cells, axes, block, x, y, z, point):
    """Write u and the rooms of eight cells with a window; 1 where all of them are above zero."""
    zero, one = spread(0.0), spread(1.0)
    row, at, k = _starts(axes, block)
    middle = _times(cells, row, x, y, z)
    store(point, at + POINTS, middle)
    within = where_less(zero, middle, one, zero)
    for p in range(POINTS):
        u = _times(cells, row + 3 * (SQUARE + p), x, y, z)
        store(point, at + p, u)
        room = one - _times(cells, row + 3 * (SPEED + p), x, y, z)
        store(point, at + POINTS + PER_ROOM * (1 + p), room)
        within = where_less(zero, room, within, zero)
        bound = one / root(u)
        for r in range(p * axes, (p + 1) * axes):
            pushed = _times(cells, row + 3 * (STILL + r), x, y, z)
            jerked = _times(cells, row + 3 * (STILL + POINTS * axes + r), x, y, z)
            room, below = one - pushed, one + pushed
            bounded, bounded_below = bound - jerked, bound + jerked
            side = k + 4 * PER_ROOM * r
            store(point, side, room)
            store(point, side + PER_ROOM, below)
            store(point, side + 2 * PER_ROOM, bounded)
            store(point, side + 3 * PER_ROOM, bounded_below)
            within = where_less(zero, room, within, zero)
            within = where_less(zero, below, within, zero)
            within = where_less(zero, bounded, within, zero)
            within = where_less(zero, bounded_below, within, zero)
    return within


@part
def _held(point, mu, room):
    """A room's weight z / g in the equations, and its pull mu / g; the inverse is kept."""
    over = spread(1.0) / load(point, room)
    store(point, room + OVER, over)
    return load(point, room + DUAL) * over, mu * over


@part
def _both(point, mu, room):
    """Weights of both sides of a limit, their pulls, and how both pull together."""
    held, pull = _held(point, mu, room)
    held_below, pull_below = _held(point, mu, room + PER_ROOM)
    return held, held_below, pull + pull_below, pull_below - pull


@part
def _at_point(cells, axes, block, p, point, mu, sums):
    """Sums with the acceleration and the jerk at a point, where the bound of the jerk falls by f.

    The rooms of the jerk are f - j and f + j: what both have of f is added once for all axes.
    """
    zero = spread(0.0)
    row, at, k = _starts(axes, block)
    sx, sy, sz = _three(cells, row + 3 * (SQUARE + p))
    u = load(point, at + p)
    over_cube = spread(1.0) / (u * root(u))
    falls = spread(-0.5) * over_cube
    both, pulled, qx, qy, qz = zero, zero, zero, zero, zero
    for r in range(p * axes, (p + 1) * axes):
        side = k + 4 * PER_ROOM * r
        held, held_below, _, pull = _both(point, mu, side)
        x, y, z = _three(cells, row + 3 * (STILL + r))
        sums = added(sums, held + held_below, pull, x, y, z)
        held, held_below, drawn, pull = _both(point, mu, side + 2 * PER_ROOM)
        x, y, z = _three(cells, row + 3 * (STILL + POINTS * axes + r))
        sums = added(sums, held + held_below, pull, x, y, z)
        both, pulled = both + held + held_below, pulled + drawn
        apart = (held_below - held) * falls
        qx, qy, qz = fma(apart, x, qx), fma(apart, y, qy), fma(apart, z, qz)
    weight = load(cells, row + 3 * (STILL + 2 * POINTS * axes) + p)
    speeding = spread(0.5) * weight * over_cube
    bend = spread(1.5) * speeding / u
    sums = added(sums, fma(both, falls * falls, bend), fma(pulled, falls, speeding), sx, sy, sz)
    return crossed(sums, qx, qy, qz, sx, sy, sz), speeding * sx, speeding * sy, speeding * sz


@part
def _fill_equations(cells, axes, n, point, mu, equations, scratch):
    zero = spread(0.0)
    for k in range(equations.size):
        equations[k] = 0.0
    mu = spread(mu)
    for block in range((n + WIDTH - 1) // WIDTH):
        row, at, _ = _starts(axes, block)
        sums = Sums(zero, zero, zero, zero, zero, zero, zero, zero, zero)
        slope_x, slope_y, slope_z = zero, zero, zero
        held, pull = _held(point, mu, at + POINTS)
        x, y, z = _three(cells, row)
        sums = added(sums, held, pull, x, y, z)
        for p in range(POINTS):
            held, pull = _held(point, mu, at + POINTS + PER_ROOM * (1 + p))
            x, y, z = _three(cells, row + 3 * (SPEED + p))
            sums = added(sums, held, zero - pull, x, y, z)
            sums, x, y, z = _at_point(cells, axes, block, p, point, mu, sums)
            slope_x, slope_y, slope_z = slope_x + x, slope_y + y, slope_z + z
        store(scratch, 0, sums.xx)
        store(scratch, 1, sums.xy)
        store(scratch, 2, sums.xz)
        store(scratch, 3, sums.yy)
        store(scratch, 4, sums.yz)
        store(scratch, 5, sums.zz)
        store(scratch, 6, sums.x)
        store(scratch, 7, sums.y)
        store(scratch, 8, sums.z)
        store(scratch, 9, slope_x)
        store(scratch, 10, slope_y)
        store(scratch, 11, slope_z)
        for lane in range(min(WIDTH, n - block * WIDTH)):
            scatter(scratch, lane, _first(block * WIDTH + lane, n), equations)


@part
def _change(point, mu, room, changed, nearest, nearest_dual):
    """Write the change of a multiplier; inverses of how far room and multiplier can go."""
    over, z = load(point, room + OVER), load(point, room + DUAL)
    change = (mu - z * changed) * over - z
    store(point, room + CHANGE, change)
    zero = spread(0.0)
    return most(nearest, zero - changed * over), most(nearest_dual, zero - change / z)


@part
def _fill_changes(cells, axes, n, point, mu, step, scratch):
    """Write the changes of the multipliers; inverses of how much of both steps meets a zero."""
    zero, mu = spread(0.0), spread(mu)
    near, dual = zero, zero
    for block in range((n + WIDTH - 1) // WIDTH):
        x, y, z = _window(block, step, scratch)
        row, at, k = _starts(axes, block)
        near, dual = _change(point, mu, at + POINTS, _times(cells, row, x, y, z), near, dual)
        for p in range(POINTS):
            changed = zero - _times(cells, row + 3 * (SPEED + p), x, y, z)
            room = at + POINTS + PER_ROOM * (1 + p)
            near, dual = _change(point, mu, room, changed, near, dual)
            u = load(point, at + p)
            falling = _times(cells, row + 3 * (SQUARE + p), x, y, z)
            falling = spread(-0.5) * falling / (u * root(u))
            for r in range(p * axes, (p + 1) * axes):
                pushed = _times(cells, row + 3 * (STILL + r), x, y, z)
                jerked = _times(cells, row + 3 * (STILL + POINTS * axes + r), x, y, z)
                side = k + 4 * PER_ROOM * r
                near, dual = _change(point, mu, side, zero - pushed, near, dual)
                near, dual = _change(point, mu, side + PER_ROOM, pushed, near, dual)
                side += 2 * PER_ROOM
                near, dual = _change(point, mu, side, falling - jerked, near, dual)
                near, dual = _change(point, mu, side + PER_ROOM, falling + jerked, near, dual)
    return _largest(near, scratch), _largest(dual, scratch)


@part
def _largest(value, scratch):
    store(scratch, 0, value)
    found = scratch[0]
    for lane in range(1, WIDTH):
        found = scratch[lane] if scratch[lane] > found else found
    return found


@part
def _total(value, scratch):
    store(scratch, 0, value)
    found = 0.0
    for lane in range(WIDTH):
        found += scratch[lane]
    return found


@part
def _go(cells, axes, point, c, far_dual, scratch):
    """Move to unknowns and along the multipliers: whether it is within, sum g z, and T."""
    one, far, gap, duration = spread(1.0), spread(far_dual), spread(0.0), spread(0.0)
    within = one
    for block in range((c.size + WIDTH - 1) // WIDTH):
        x, y, z = _window(block, c, scratch)
        within = within * _fill_rooms(cells, axes, block, x, y, z, point)
        _, at, _ = _starts(axes, block)
        end, after, _ = _starts(axes, block + 1)
        there = load(cells, end - 1)
        for room in range(at + POINTS, after, PER_ROOM):
            multiplier = fma(far, load(point, room + CHANGE), load(point, room + DUAL))
            store(point, room + DUAL, multiplier)
            gap = fma(there * multiplier, load(point, room), gap)
        for p in range(POINTS):
            weight = load(cells, end - 1 - POINTS + p)
            duration = duration + there * weight / root(load(point, at + p))
    inside = _total(within, scratch) == WIDTH
    return inside, _total(gap, scratch), _total(duration, scratch)


@part
def _begin_multipliers(axes, n, point, mu):
    for block in range((n + WIDTH - 1) // WIDTH):
        _, at, _ = _starts(axes, block)
        _, after, _ = _starts(axes, block + 1)
        for room in range(at + POINTS, after, PER_ROOM):
            store(point, room + DUAL, spread(mu) / load(point, room))


@part
def _centring(moved, gain):
    """Factor on mu: small where Newton's step was taken whole, near one while far from the path."""
    if gain > 0.3:
        return 0.9
    return 0.1 if moved > 0.9 else 0.2 if moved > 0.5 else 0.5 if moved > 0.2 else 0.9


@part
def _ahead(c, far, step, equations, ahead):
    """Write the unknowns after so much of the step; how much sooner its end is expected [s]."""
    gain = 0.0
    for i in range(c.size):
        gain -= equations[PER_UNKNOWN * i + SLOPE] * step[i]
        ahead[i] = c[i] + far * step[i]
    return gain


@compiled
def _solved(cells, axes, c, steps, point, equations, step, ahead, scratch):
    n = c.size
    count = n * (1 + POINTS + 4 * POINTS * axes)
    inside, _, duration = _go(cells, axes, point, c, 0.0, scratch)
    if not inside:
        return -1.0
    mu = 0.1 * duration / count
    _begin_multipliers(axes, n, point, mu)
    gap = mu * count
    for _ in range(steps):
        _fill_equations(cells, axes, n, point, mu, equations, scratch)
        solve_equations(equations, step)
        nearest, nearest_dual = _fill_changes(cells, axes, n, point, mu, step, scratch)
        moved = TO_THE_BOUND / max(nearest, TO_THE_BOUND)
        moved_dual = TO_THE_BOUND / max(nearest_dual, TO_THE_BOUND)
        gain = _ahead(c, moved, step, equations, ahead)
        inside, gap_ahead, duration_ahead = _go(cells, axes, point, ahead, moved_dual, scratch)
        if not inside:  # at rounding: what was found is within all conditions
            return gap
        for i in range(n):  # all at once would be compiled with the words of an error of shapes
            c[i] = ahead[i]
        gap, before, duration = gap_ahead, duration, duration_ahead
        if gap < GAP * duration and before - duration < 0.3 * GAP * duration:
            return gap
        mu = gap / count * _centring(moved, gain / duration)
        if moved < JAMMED:
            mu = gap / count
            _begin_multipliers(axes, n, point, mu)
    return gap
