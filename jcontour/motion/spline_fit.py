"""Quintic splines with the least mean square distance from paths, ends and directions given.

Many splines are one problem: they lie one behind the other on one parameter, and the knots at the
begin and at the end of each are sixfold, so that none meets the next. The normal equations of
B-splines have six diagonals. They are summed interval by interval: on one interval the same six
B-splines are not zero. So a fit is arithmetic of long arrays, however short the splines are.
"""

from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Bool, Float, Int

if TYPE_CHECKING:
    from scipy.interpolate import BSpline

DEGREE = 5
SIX = np.arange(DEGREE + 1)  # B-splines that are not zero in an interval


def fitted_splines(
    knots: Float[np.ndarray, " K"],
    sizes: Int[np.ndarray, " R"],
    arc: Float[np.ndarray, " S"],
    points: Float[np.ndarray, "S m"],
    weight: Float[np.ndarray, " S"],
    tangents: Float[np.ndarray, "2 R m"],
) -> tuple["BSpline", Bool[np.ndarray, " R"]]:
    """Splines through the first and the last of their points, and which of them are determined.

    Where one ends and the next begins, the value is that of the next: an end is asked for just
    before. A spline that its points do not determine is zero but at its ends.

    Args:
        knots: those of each spline, from its begin to its end [m], increasing in each.
        sizes: how many each has, two at least.
        arc: parameter of the points [m], increasing. The first of a spline is at its begin, the
            last just before its end.
        points: what is fitted [m].
        weight: how much each counts.
        tangents: derivatives at the begin and at the end of each [1]; NaN where any will do.
    """
    # imported here: it takes longer than the rest of the library
    from scipy.interpolate import BSpline
    from scipy.linalg import get_lapack_funcs

    last = np.cumsum(sizes) - 1
    first = last - sizes + 1
    repeats = np.ones(knots.size, int)
    repeats[first] = repeats[last] = SIX.size
    whole = np.repeat(knots, repeats)
    begin = first + 2 * DEGREE * np.arange(sizes.size)  # B-splines of each, from the first
    end = begin + sizes + DEGREE - 2  # to the last
    count = whole.size - SIX.size
    one = np.searchsorted(arc, knots[first])
    other = np.append(one[1:], arc.size) - 1
    coefficients = np.zeros((count, points.shape[1]))
    coefficients[begin], coefficients[end] = points[one], points[other]
    inside = np.zeros(count + 1, int)
    inside[begin + 1], inside[end] = 1, -1
    free = np.cumsum(inside[:-1]) > 0
    for beside, at, near, far, way in (
        (begin + 1, one, first, first + 1, tangents[0]),
        (end - 1, other, last, last - 1, tangents[1]),
    ):
        given = ~np.isnan(way).any(axis=1)
        step = (knots[far] - knots[near])[:, None] / DEGREE
        coefficients[beside[given]] = (points[at] + way * step)[given]
        free[beside[given]] = False
    design = BSpline.design_matrix(arc, whole, DEGREE)
    values, column = design.data.reshape(-1, SIX.size), design.indices[:: SIX.size]
    left = points - np.einsum("rk,rkm->rm", values, coefficients[column[:, None] + SIX])
    root = np.sqrt(weight)[:, None]
    bands, right = _normal_equations(root * values, column, root * left, count)
    _hold(~free, bands, right)
    (solve,) = get_lapack_funcs(("pbsv",), (bands, right))
    determined = np.ones(sizes.size, bool)
    while True:
        _, solution, lost = solve(bands, right)
        if lost == 0:
            break
        k = np.searchsorted(begin, lost - 1, side="right") - 1
        determined[k] = False
        _hold((np.arange(count) >= begin[k]) & (np.arange(count) <= end[k]), bands, right)
    return BSpline(whole, coefficients + solution, DEGREE), determined


def _hold(
    fixed: Bool[np.ndarray, " n"],
    bands: Float[np.ndarray, "6 n"],
    right: Float[np.ndarray, "n m"],
) -> None:
    """Change equations so that some unknowns are zero."""
    right[fixed] = 0.0
    for k in SIX[1:]:
        bands[DEGREE - k, k:][fixed[k:] | fixed[:-k]] = 0.0
    bands[DEGREE, fixed] = 1.0


def _normal_equations(
    values: Float[np.ndarray, "S 6"],
    column: Int[np.ndarray, " S"],
    left: Float[np.ndarray, "S m"],
    count: int,
) -> tuple[Float[np.ndarray, "6 n"], Float[np.ndarray, "n m"]]:
    """Upper diagonals of N' N, the main one last, and N' left.

    Args:
        values: of the B-splines that are not zero at each point.
        column: number of the first of them.
        left: what is fitted.
        count: number n of B-splines.
    """
    begins = np.flatnonzero(np.diff(column, prepend=-1))  # points of one interval follow each other
    at = column[begins]
    bands, right = np.zeros((SIX.size, count)), np.zeros((count, left.shape[1]))
    for k in SIX:
        right[at + k] += np.add.reduceat(values[:, k, None] * left, begins)
        products = np.add.reduceat(values[:, k:] * values[:, k, None], begins)
        apart = SIX[: SIX.size - k, None]
        bands[DEGREE - apart, at + k + apart] += products.T
    return bands, right
