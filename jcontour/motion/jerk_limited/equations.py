"""Newton's equations of a warp, compiled: sums over rows of eight cells, a band, its factors."""

from typing import NamedTuple

import numpy as np

from jcontour.native.lanes import WIDTH, fma, part, spread

ROUNDING = 1e-15  # of a diagonal element: a smaller pivot is lost


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


class Equations(NamedTuple):
    """Newton's equations: three diagonals, the right side (then the step), and T's slope."""

    band: np.ndarray
    right: np.ndarray
    slope: np.ndarray


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
def scatter(sums, lane, at, equations):
    """Add the sums of one cell to the equations of its window."""
    band, right, slope = equations.band, equations.right, equations.slope
    band[2, at] += sums[lane]
    band[1, at + 1] += sums[WIDTH + lane]
    band[0, at + 2] += sums[2 * WIDTH + lane]
    band[2, at + 1] += sums[3 * WIDTH + lane]
    band[1, at + 2] += sums[4 * WIDTH + lane]
    band[2, at + 2] += sums[5 * WIDTH + lane]
    for b in range(3):
        right[at + b] += sums[(6 + b) * WIDTH + lane]
        slope[at + b] -= sums[(9 + b) * WIDTH + lane]


@part
def solve_equations(equations):
    """Solve Newton's equations in place by their factors L D L': the right side becomes the step.

    The rows of the band are the second diagonal above the main one, the first, and the main one,
    which becomes the inverse of D. An unknown whose pivot is lost to rounding stays where it is.
    """
    (far_off, near_off, over), right = equations.band, equations.right
    n = right.size
    for i in range(n):
        far = far_off[i] * over[i - 2] if i > 1 else 0.0
        near = near_off[i] - (far * near_off[i - 1] if i > 1 else 0.0)
        pivot = over[i] - far * far_off[i]
        if i > 0:
            pivot -= near * near * over[i - 1]
        kept = pivot > ROUNDING * over[i]
        near_off[i], over[i] = near, 1.0 / pivot if kept else 0.0
        if i > 0:
            right[i] -= near * over[i - 1] * right[i - 1]
        if i > 1:
            right[i] -= far * right[i - 2]
    for i in range(n - 1, -1, -1):
        pushed = right[i]
        if i + 1 < n:
            pushed -= near_off[i + 1] * right[i + 1]
        if i + 2 < n:
            pushed -= far_off[i + 2] * right[i + 2]
        right[i] = pushed * over[i]
