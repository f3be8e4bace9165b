"""Quintic spline with the least mean square distance from a path, its ends and directions given.

The mean is one over the arc length, by the trapezoidal rule between points: it hardly depends on
where they are.

The normal equations of B-splines have six diagonals. They are summed interval by interval: on one
interval the same six B-splines are not zero. So a fit of some hundred points is mostly arithmetic;
with sparse matrices it is mostly bookkeeping.
"""

import numpy as np
from jaxtyping import Float, Int

DEGREE = 5
SIX = np.arange(DEGREE + 1)  # B-splines that are not zero in an interval
Tangents = tuple[Float[np.ndarray, " m"] | None, Float[np.ndarray, " m"] | None]


def fitted_spline(
    knots: Float[np.ndarray, " k"],
    arc: Float[np.ndarray, " S"],
    points: Float[np.ndarray, "S m"],
    tangents: Tangents,
):
    """`scipy.interpolate.BSpline` through the first and the last of the points.

    Args:
        knots: from the first arc length to the last [m], increasing.
        arc: arc lengths of the points [m], increasing.
        points: what it is fitted to [m].
        tangents: its derivative at both ends [1]; None where any will do.

    Raises:
        LinAlgError: the points do not determine it.
    """
    # imported here: it takes longer than the rest of the library
    from scipy.interpolate import BSpline
    from scipy.linalg import solveh_banded

    whole = np.concatenate([np.full(DEGREE, knots[0]), knots, np.full(DEGREE, knots[-1])])
    count = whole.size - DEGREE - 1
    coefficients = np.zeros((count, points.shape[1]))
    coefficients[0], coefficients[-1] = points[0], points[-1]
    first, last = 1, count - 1
    before, after = tangents
    if before is not None:
        coefficients[1] = points[0] + before * (knots[1] - knots[0]) / DEGREE
        first = 2
    if after is not None:
        coefficients[-2] = points[-1] - after * (knots[-1] - knots[-2]) / DEGREE
        last = count - 2
    design = BSpline.design_matrix(arc, whole, DEGREE)
    step = np.diff(arc, prepend=arc[0], append=arc[-1])
    weight = np.sqrt(step[:-1] + step[1:])[:, None]
    values, column = design.data.reshape(-1, SIX.size), design.indices[:: SIX.size]
    left = points - np.einsum("rk,rkm->rm", values, coefficients[column[:, None] + SIX])
    values, left = weight * values, weight * left
    bands, right = _normal_equations(values, column, left, count)
    coefficients[first:last] = solveh_banded(bands[:, first:last], right[first:last])
    return BSpline(whole, coefficients, DEGREE)


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
