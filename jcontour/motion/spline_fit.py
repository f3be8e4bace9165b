"""Quintic splines with the least mean square distance from paths, ends and directions given.

Many splines are one problem: they lie one behind the other on one parameter, and the knots at the
begin and at the end of each are sixfold, so that none meets the next. The normal equations of
B-splines have six diagonals. In an interval the same six B-splines are polynomials, so that its
moments, the sums of w u^p and of w u^p x over its points, are all that the equations need.
"""

import numpy as np
from jaxtyping import Bool, Float, Int

DEGREE = 5
SIX = np.arange(DEGREE + 1)  # B-splines that are not zero in an interval


def fitted_splines(
    knots: Float[np.ndarray, " K"],
    sizes: Int[np.ndarray, " R"],
    arc: Float[np.ndarray, " S"],
    points: Float[np.ndarray, "S m"],
    weight: Float[np.ndarray, " S"],
    tangents: Float[np.ndarray, "2 R m"],
) -> tuple[Float[np.ndarray, "K 6 m"], Bool[np.ndarray, " R"]]:
    """Splines through the first and the last of their points, and which of them are determined.

    Each is a polynomial in the distance from every knot but its last, lowest power first. One that
    its points do not determine is zero but at its ends.

    Args:
        knots: those of each spline, from its begin to its end [m], increasing in each.
        sizes: how many each has, two at least.
        arc: parameter of the points [m], increasing. The first of a spline is at its begin, the
            last just before its end.
        points: what is fitted [m].
        weight: how much each counts.
        tangents: derivatives at the begin and at the end of each [1]; NaN where any will do.
    """
    from scipy.linalg import get_lapack_funcs  # takes long to import

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
    inner = np.delete(np.arange(knots.size), last)  # knots before intervals
    column = inner + 2 * DEGREE * np.repeat(np.arange(sizes.size), sizes - 1)  # first B-spline
    windows = whole[column[:, None] + np.arange(1, 2 * SIX.size - 1)]
    bands, right = _normal_equations(windows, column, arc, points, weight, coefficients)
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
    powers = np.zeros((knots.size, SIX.size, points.shape[1]))
    basis = _polynomials(windows, knots[inner], np.ones(inner.size))
    powers[inner] = basis.swapaxes(1, 2) @ (coefficients + solution)[column[:, None] + SIX]
    return powers, determined


def _polynomials(
    windows: Float[np.ndarray, "k 10"],
    origin: Float[np.ndarray, " k"],
    unit: Float[np.ndarray, " k"],
) -> Float[np.ndarray, "k 6 6"]:
    """Six B-splines of intervals as polynomials in u = (s - origin) / unit, lowest power first.

    An interval is the middle one of the ten knots in its window. By the rule of Cox and de Boor.
    """
    basis = np.zeros((SIX.size, SIX.size, origin.size))  # (B-spline, power, interval)
    basis[0, 0] = 1.0
    apart = (windows - origin[:, None]).T
    for degree in range(1, SIX.size):
        before = np.zeros_like(basis[0])
        for k in range(degree):
            low, high = apart[DEGREE + k - degree], apart[DEGREE + k]
            share = basis[k] / (high - low)
            rising = -low * share
            rising[1:] += unit * share[:-1]
            basis[k] = before + (high - low) * share - rising
            before = rising
        basis[degree] = before
    return np.moveaxis(basis, 2, 0)


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
    windows: Float[np.ndarray, "k 10"],
    column: Int[np.ndarray, " k"],
    arc: Float[np.ndarray, " S"],
    points: Float[np.ndarray, "S m"],
    weight: Float[np.ndarray, " S"],
    coefficients: Float[np.ndarray, "n m"],
) -> tuple[Float[np.ndarray, "6 n"], Float[np.ndarray, "n m"]]:
    """Upper diagonals of N' W N, the main one last, and N' W (points - N coefficients).

    Windows are five knots before the end of every interval and five behind its begin, columns the
    numbers of the first B-splines that are not zero in them, coefficients what is known already.
    """
    begins = np.searchsorted(arc, windows[:, DEGREE - 1])
    some = np.diff(begins, append=arc.size) > 0
    windows, column, begins = windows[some], column[some], begins[some]
    unit = 0.5 * (windows[:, DEGREE] - windows[:, DEGREE - 1])
    middle = windows[:, DEGREE - 1] + unit
    basis = _polynomials(windows, middle, unit)
    count = np.diff(begins, append=arc.size)
    u = (arc - np.repeat(middle, count)) / np.repeat(unit, count)
    moments = np.empty((2 * SIX.size - 1, begins.size))
    pulled = np.empty((SIX.size, points.shape[1], begins.size))
    power, rows = weight, np.ascontiguousarray(points.T)
    for k in range(len(moments)):
        moments[k] = np.add.reduceat(power, begins)
        if k < SIX.size:
            pulled[k] = np.add.reduceat(power * rows, begins, axis=1)
        power = power * u
    held = np.moveaxis(moments[SIX[:, None] + SIX], 2, 0) @ basis.swapaxes(1, 2)
    squares = basis @ held
    known = squares @ coefficients[column[:, None] + SIX]
    left = basis @ np.moveaxis(pulled, 2, 0) - known
    bands, right = np.zeros((SIX.size, len(coefficients))), np.zeros(coefficients.shape)
    for k in SIX:
        right[column + k] += left[:, k]
        apart = SIX[: SIX.size - k, None]
        bands[DEGREE - apart, column + k + apart] += squares[:, k, k:].T
    return bands, right
