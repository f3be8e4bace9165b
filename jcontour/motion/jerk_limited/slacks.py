"""Slacks g of a warp's conditions, their multipliers z and Newton's equations, compiled.

The conditions of a cell are 1 + 3 + 12 m for m axes: the middle ordinate, the speed at three
points, and there the two sides of the acceleration and of the jerk of every axis, side by side.
Eight neighbouring cells are the lanes of one value; the last one fills what is left of eight. A
block of them has its entries side by side in two flat arrays:

    cells   the blocks of `Conditions`
    point   u at the points; then for every g its inverse, and z

Little is kept, and what follows from it is computed again: a long path does not fit into the
processor's caches, and waits for its memory.
"""

from typing import NamedTuple

import numpy as np

from jcontour._native.lanes import (
    WIDTH,
    fma,
    load,
    most,
    part,
    root,
    spread,
    store,
    where_less,
)
from jcontour.motion.jerk_limited.conditions import POINTS, SPEED, SQUARE, STILL

PER_SLACK, DUAL = 2, 1  # entries of `point`: the inverse of a slack, and its multiplier beside it
ROUNDING = 1e-15  # of a diagonal element: a smaller pivot is lost
# numbers of an unknown's equation, side by side: the pull g' / g of all slacks, the slope of T,
# and the diagonals: the main one, the first above it, the second
PER_UNKNOWN, SLOPE, MAIN, NEAR, FAR = 5, 1, 2, 3, 4


class Going(NamedTuple):
    """How multipliers go on: z becomes keep z + far dz + anew / g, where g (z + dz) + z dg = mu."""

    mu: float | np.ndarray
    keep: float | np.ndarray
    far: float | np.ndarray
    anew: float | np.ndarray


class Tally(NamedTuple):
    """Of eight cells: 1 where every slack is above zero, sum of g z [s], duration [s]."""

    within: np.ndarray
    gap: np.ndarray
    duration: np.ndarray


@part
def slacks_of(axes):
    """Slacks of a cell."""
    return 1 + POINTS + 4 * POINTS * axes


@part
def _starts(axes, block):
    """Where a block begins in `cells` and in `point`, and where its slacks of the axes do."""
    rows = STILL + 2 * POINTS * axes
    at = block * (POINTS + PER_SLACK * slacks_of(axes))
    return block * (3 * rows + POINTS + 1), at, at + POINTS + PER_SLACK * (1 + POINTS)


@part
def _three(cells, row):
    return load(cells, row), load(cells, row + 1), load(cells, row + 2)


@part
def _times(row, window):
    """A row of three numbers times a window."""
    return fma(row[0], window[0], fma(row[1], window[1], row[2] * window[2]))


@part
def _window(block, unknowns, scratch):
    """The three unknowns of eight cells."""
    for lane in range(WIDTH):
        i = _first(block * WIDTH + lane, unknowns.size)
        scratch[lane] = unknowns[i]
        scratch[WIDTH + lane] = unknowns[i + 1]
        scratch[2 * WIDTH + lane] = unknowns[i + 2]
    return load(scratch, 0), load(scratch, 1), load(scratch, 2)


@part
def _first(cell, n):
    """Number of the first unknown of a cell's window."""
    return 0 if cell < 2 else n - 3 if cell > n - 3 else cell - 1


@part
def _inverses(point, mu, slack, changed, near, dual):
    """Inverses of how much of a step slack and multiplier can take, the larger of all so far."""
    over, z = load(point, slack), load(point, slack + DUAL)
    ahead = (mu - z * changed) * over
    return most(near, spread(0.0) - changed * over), most(dual, spread(1.0) - ahead / z)


@part
def nearest_bounds(cells, axes, point, mu, step, scratch):
    """Inverses of how much of the step meets a zero of a slack, and of a multiplier."""
    zero, mu = spread(0.0), spread(mu)
    near, dual = zero, zero
    for block in range((step.size + WIDTH - 1) // WIDTH):
        window = _window(block, step, scratch)
        row, at, side = _starts(axes, block)
        slack = at + POINTS
        near, dual = _inverses(point, mu, slack, _times(_three(cells, row), window), near, dual)
        for p in range(POINTS):
            slack += PER_SLACK
            changed = zero - _times(_three(cells, row + 3 * (SPEED + p)), window)
            near, dual = _inverses(point, mu, slack, changed, near, dual)
            falling = _falling(point, at + p, _three(cells, row + 3 * (SQUARE + p)), window)
            for r in range(p * axes, (p + 1) * axes):
                pushed = _times(_three(cells, row + 3 * (STILL + r)), window)
                jerked = _times(_three(cells, row + 3 * (STILL + POINTS * axes + r)), window)
                near, dual = _inverses(point, mu, side, zero - pushed, near, dual)
                near, dual = _inverses(point, mu, side + PER_SLACK, pushed, near, dual)
                side += 2 * PER_SLACK
                near, dual = _inverses(point, mu, side, falling - jerked, near, dual)
                near, dual = _inverses(point, mu, side + PER_SLACK, falling + jerked, near, dual)
                side += 2 * PER_SLACK
    return _largest(near, scratch), _largest(dual, scratch)


@part
def _falling(point, at, row, step):
    """Change of the jerk's bound 1 / sqrt(u) with a step."""
    u = load(point, at)
    return spread(-0.5) * _times(row, step) / (u * root(u))


@part
def _gone(point, going, slack, changed, value, tally):
    """Move a multiplier to a new value of its slack: weight z / g in the equations, pull 1 / g."""
    over, z = load(point, slack), load(point, slack + DUAL)
    z = fma(going.far, (going.mu - z * changed) * over - z, going.keep * z)
    over = spread(1.0) / value
    z = fma(going.anew, over, z)
    store(point, slack, over)
    store(point, slack + DUAL, z)
    zero = spread(0.0)
    within = where_less(zero, value, tally.within, zero)
    return z * over, over, Tally(within, fma(z, value, tally.gap), tally.duration)


@part
def _both(point, going, slack, limit, windows, row, sums, tally):
    """Both sides of a limit: sums with them, their weights, and how both pull together.

    Of the limit there is its bound, and how much that falls with the step.
    """
    (bound, falling), (here, step) = limit, windows
    value, changed = _times(row, here), _times(row, step)
    held, over, tally = _gone(point, going, slack, falling - changed, bound - value, tally)
    slack += PER_SLACK
    below, over_below, tally = _gone(point, going, slack, falling + changed, bound + value, tally)
    sums = added(sums, held + below, over_below - over, row[0], row[1], row[2])
    return sums, held, below, over + over_below, tally


@part
def _at_point(cells, axes, cell, point, going, windows, sums, tally):
    """Sums with the acceleration and the jerk at a point, where the bound of the jerk falls by f.

    The slacks of the jerk are f - j and f + j: what both have of f is added once for all axes.
    `cell` is the number of the block, and that of the point.
    """
    zero, one = spread(0.0), spread(1.0)
    block, p = cell
    row, at, side = _starts(axes, block)
    square = _three(cells, row + 3 * (SQUARE + p))
    falling = _falling(point, at + p, square, windows[1])
    u = _times(square, windows[0])
    store(point, at + p, u)
    bound = one / root(u)
    over_cube = bound / u
    falls = spread(-0.5) * over_cube
    both, pulled, qx, qy, qz = zero, zero, zero, zero, zero
    side += 4 * PER_SLACK * p * axes
    for r in range(p * axes, (p + 1) * axes):
        pushed = _three(cells, row + 3 * (STILL + r))
        sums, _, _, _, tally = _both(point, going, side, (one, zero), windows, pushed, sums, tally)
        side += 2 * PER_SLACK
        jerked = _three(cells, row + 3 * (STILL + POINTS * axes + r))
        sums, held, below, drawn, tally = _both(
            point, going, side, (bound, falling), windows, jerked, sums, tally
        )
        side += 2 * PER_SLACK
        both, pulled = both + held + below, pulled + drawn
        apart = (below - held) * falls
        qx, qy, qz = fma(apart, jerked[0], qx), fma(apart, jerked[1], qy), fma(apart, jerked[2], qz)
    weight = load(cells, row + 3 * (STILL + 2 * POINTS * axes) + p)
    speeding = spread(0.5) * weight * over_cube
    bend = spread(1.5) * speeding / u
    x, y, z = square
    sums = added(sums, fma(both, falls * falls, bend), pulled * falls, x, y, z)
    sums = crossed(sums, qx, qy, qz, x, y, z)
    tally = Tally(tally.within, tally.gap, fma(weight, bound, tally.duration))
    return sums, speeding * x, speeding * y, speeding * z, tally


@part
def _cell(cells, axes, block, point, going, here, step, scratch):
    """Move eight cells, and write their sums into the scratch."""
    zero, one = spread(0.0), spread(1.0)
    tally = Tally(one, zero, zero)
    sums = Sums(zero, zero, zero, zero, zero, zero, zero, zero, zero)
    slope_x, slope_y, slope_z = zero, zero, zero
    row, at, _ = _starts(axes, block)
    slack = at + POINTS
    x, y, z = _three(cells, row)
    value, changed = _times((x, y, z), here), _times((x, y, z), step)
    held, over, tally = _gone(point, going, slack, changed, value, tally)
    sums = added(sums, held, over, x, y, z)
    for p in range(POINTS):
        slack += PER_SLACK
        x, y, z = _three(cells, row + 3 * (SPEED + p))
        value, changed = one - _times((x, y, z), here), zero - _times((x, y, z), step)
        held, over, tally = _gone(point, going, slack, changed, value, tally)
        sums = added(sums, held, zero - over, x, y, z)
        sums, x, y, z, tally = _at_point(
            cells, axes, (block, p), point, going, (here, step), sums, tally
        )
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
    return tally


@part
def go(cells, axes, point, unknowns, step, going, equations, scratch):
    """Move to unknowns, and fill the equations there: whether it is within, sum of g z, and T.

    The unknowns may have taken a part of the step only; `point` is what the call before has left.
    """
    n = unknowns.size
    for k in range(equations.size):
        equations[k] = 0.0
    mu, keep, far, anew = going
    going = Going(spread(mu), spread(keep), spread(far), spread(anew))
    within, gap, duration = spread(1.0), spread(0.0), spread(0.0)
    for block in range((n + WIDTH - 1) // WIDTH):
        here = _window(block, unknowns, scratch)
        change = _window(block, step, scratch)
        tally = _cell(cells, axes, block, point, going, here, change, scratch)
        for lane in range(min(WIDTH, n - block * WIDTH)):
            scatter(scratch, lane, _first(block * WIDTH + lane, n), equations)
        end, _, _ = _starts(axes, block + 1)
        there = load(cells, end - 1)
        within = within * tally.within
        gap, duration = fma(there, tally.gap, gap), fma(there, tally.duration, duration)
    inside = _total(within, scratch) == WIDTH
    return inside, _total(gap, scratch), _total(duration, scratch)


@part
def _largest(value, scratch):
    store(scratch, 0, value)
    maximum = scratch[0]
    for lane in range(1, WIDTH):
        maximum = scratch[lane] if scratch[lane] > maximum else maximum
    return maximum


@part
def _total(value, scratch):
    store(scratch, 0, value)
    total = 0.0
    for lane in range(WIDTH):
        total += scratch[lane]
    return total


class Sums(NamedTuple):
    """Sums of held g g' and of pull g over rows g of eight cells: xx is of the first unknown."""

    xx: np.ndarray
    xy: np.ndarray
    xz: np.ndarray
    yy: np.ndarray
    yz: np.ndarray
    zz: np.ndarray
    x: np.ndarray
    y: np.ndarray
    z: np.ndarray


@part
def added(sums, held, pull, x, y, z):
    """Sums with held g g' and pull g of a row g."""
    return Sums(
        fma(held * x, x, sums.xx),
        fma(held * x, y, sums.xy),
        fma(held * x, z, sums.xz),
        fma(held * y, y, sums.yy),
        fma(held * y, z, sums.yz),
        fma(held * z, z, sums.zz),
        fma(pull, x, sums.x),
        fma(pull, y, sums.y),
        fma(pull, z, sums.z),
    )


@part
def crossed(sums, x, y, z, fx, fy, fz):
    """Sums with f q' + q f' of two rows q and f."""
    two = spread(2.0)
    return Sums(
        fma(two * fx, x, sums.xx),
        fma(fx, y, fma(fy, x, sums.xy)),
        fma(fx, z, fma(fz, x, sums.xz)),
        fma(two * fy, y, sums.yy),
        fma(fy, z, fma(fz, y, sums.yz)),
        fma(two * fz, z, sums.zz),
        sums.x,
        sums.y,
        sums.z,
    )


@part
def scatter(sums, lane, first, equations):
    """Add the sums of one cell to the equations of its window."""
    at = PER_UNKNOWN * first
    equations[at + MAIN] += sums[lane]
    for k in range(3):
        equations[at + PER_UNKNOWN * k] += sums[(6 + k) * WIDTH + lane]
        equations[at + PER_UNKNOWN * k + SLOPE] -= sums[(9 + k) * WIDTH + lane]
    at += PER_UNKNOWN
    equations[at + NEAR] += sums[WIDTH + lane]
    equations[at + MAIN] += sums[3 * WIDTH + lane]
    at += PER_UNKNOWN
    equations[at + FAR] += sums[2 * WIDTH + lane]
    equations[at + NEAR] += sums[4 * WIDTH + lane]
    equations[at + MAIN] += sums[5 * WIDTH + lane]


@part
def solve_equations(equations, mu, step):
    """Solve Newton's equations by their factors L D L', which take the place of the diagonals.

    On the right is mu times the pull, less the slope. The main diagonal becomes the inverse of D.
    An unknown whose pivot is lost to rounding stays where it is.
    """
    # of the two unknowns before: inverse of D, right side, and what couples them
    over, over_before, right, right_before, near_before = 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(step.size):
        at = PER_UNKNOWN * i
        off, main = equations[at + FAR], equations[at + MAIN]
        far = off * over_before
        near = equations[at + NEAR] - far * near_before
        pivot = main - far * off - near * near * over
        new = mu * equations[at] - equations[at + SLOPE]
        new -= near * over * right + far * right_before
        right_before, right, near_before, over_before = right, new, near, over
        over = 1.0 / pivot if pivot > ROUNDING * main else 0.0
        step[i], equations[at + NEAR], equations[at + MAIN] = new, near, over
    # of the two unknowns behind: their steps, and what couples them to this one
    behind, far_behind, near, far, off = 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(step.size - 1, -1, -1):
        at = PER_UNKNOWN * i
        moved = (step[i] - near * behind - off * far_behind) * equations[at + MAIN]
        behind, far_behind, step[i] = moved, behind, moved
        near, off, far = equations[at + NEAR], far, equations[at + FAR]
