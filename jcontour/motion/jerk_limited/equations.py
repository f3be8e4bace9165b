"""Newton's equations of a warp, compiled: sums over rows of eight cells, a band, its factors."""

from typing import NamedTuple

import numpy as np

from jcontour._native.lanes import WIDTH, fma, part, spread

ROUNDING = 1e-15  # of a diagonal element: a smaller pivot is lost
# numbers of an unknown's equation, side by side: the pull g' / g of all slacks, the slope of T,
# and the diagonals: the main one, the first above it, the second
PER_UNKNOWN, SLOPE, MAIN, NEAR, FAR = 5, 1, 2, 3, 4


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
