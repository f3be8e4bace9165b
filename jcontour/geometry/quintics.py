"""Quintic pieces through a smooth curve r(t).

Each piece takes position, unit tangent and curvature vector from the curve at both its ends. It is
a polynomial in the curve's own arc length, s(t) = integral |r'| dt by Gauss quadrature. The fit
error is measured as |p(s(t)) - r(t)| between the ends: it bounds the distance and holds the error
of the arc-length parametrisation as well.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from jcontour.geometry.pieces import Piece

# parameter (...,) -> position, first, second derivative (..., m)
Curve = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray, np.ndarray]]

Frame = tuple[np.ndarray, np.ndarray, np.ndarray]  # point, unit tangent, curvature vector


class Fit(NamedTuple):
    """Quintic pieces of a curve."""

    polynomial: Float[np.ndarray, "P 6 m"]  # coefficients in the arc length
    extent: Float[np.ndarray, " P"]  # lengths [m]
    begin: Float[np.ndarray, " P"]  # the curve's parameter at which each begins
    error: float  # measured fit error [m]

    def pieces(self) -> Piece:
        """Pieces of a contour that does not turn."""
        return Piece.polynomials(self.polynomial, self.extent)


MOST_PIECES = 20_000  # 10 m of path in pieces of 0.5 mm; a fit that needs more has met a cusp
MOST_HALVINGS = 40  # of one piece; reaches rounding on any curve
AT_ONCE = 2048  # pieces: each takes some kilobytes while it is fitted
# 8 points integrate a piece that a quintic fits to 1e-9 to rounding
QUADRATURE, QUADRATURE_WEIGHT = np.polynomial.legendre.leggauss(8)
SAMPLES = np.arange(1, 8) / 8  # fractions of a piece at which the fit is measured
BETWEEN_SAMPLES = 1.1  # the error may peak between two of them


def fitted(
    name: str,
    curve: Curve,
    frame: Callable[[np.ndarray, Frame], Frame],
    begin: Float[np.ndarray, " K"],
    end: Float[np.ndarray, " K"],
    tolerance: float | Float[np.ndarray, " K"],
) -> Fit:
    """Pieces of a curve over intervals, which need not meet, in the order of the parameter.

    The tolerance [m] may be one for every interval.

    `frame` may put other points, tangents and curvature vectors in the place of the curve's own,
    where a piece has to meet something else to the last bit.

    Raises:
        ValueError: the tolerance is out of reach.
    """
    most = MOST_PIECES + 64 * begin.size
    within = np.broadcast_to(np.asarray(tolerance, float), begin.shape)
    fine: list[tuple[np.ndarray, ...]] = []  # pieces that fit, of every round
    count, error = 0, np.full(begin.size, np.inf)
    for _ in range(MOST_HALVINGS):
        parts = [slice(k, k + AT_ONCE) for k in range(0, begin.size, AT_ONCE)]
        rows = [_fitted_part(curve, frame, begin[some], end[some]) for some in parts]
        polynomial, extent, error = (np.concatenate(row) for row in zip(*rows, strict=True))
        fits = error <= within
        fine.append((begin[fits], polynomial[fits], extent[fits], error[fits]))
        count += int(fits.sum())
        coarse = ~fits
        if not coarse.any():
            begin, polynomial, extent, error = map(np.concatenate, zip(*fine, strict=True))
            order = np.argsort(begin, kind="stable")
            return Fit(polynomial[order], extent[order], begin[order], float(error.max()))
        begin, end, within, error = begin[coarse], end[coarse], within[coarse], error[coarse]
        if count + 2 * begin.size > most:
            break
        middle = 0.5 * (begin + end)
        begin, end = (np.stack(pair, axis=1).ravel() for pair in ((begin, middle), (middle, end)))
        within = np.repeat(within, 2)
    raise ValueError(
        f"{name}: {count + error.size} pieces fit within {np.nanmax(error, initial=0.0):.1e} m at "
        f"best; needs a tolerance above that (received {within.min():.1e} m) or a curve without "
        "cusps"
    )


def _fitted_part(curve, frame, begin, end):
    """Polynomials, lengths [m] and errors [m] of some pieces."""
    # a curve that stops or overflows makes NaN, which never fits
    with np.errstate(all="ignore"):
        polynomial, extent = _hermite(curve, frame, begin, end)
        t = begin[:, None] + (end - begin)[:, None] * SAMPLES
        s = _arc_length(curve, np.broadcast_to(begin[:, None], t.shape), t)
        pieces = Piece.polynomials(polynomial[:, None], extent[:, None])
        error = BETWEEN_SAMPLES * np.linalg.norm(pieces.jet(s)[0] - curve(t)[0], axis=-1).max(
            axis=-1
        )
    return polynomial, extent, error


def _hermite(curve, frame, a, b):
    start, tangent, curvature = frame(a, _frame(curve, a))
    end, end_tangent, end_curvature = frame(b, _frame(curve, b))
    extent = _arc_length(curve, a, b)
    h = extent[:, None]
    position_gap = end - start - tangent * h - curvature * h**2 / 2
    tangent_gap = (end_tangent - tangent - curvature * h) * h
    curvature_gap = (end_curvature - curvature) * h**2
    cubic = (10 * position_gap - 4 * tangent_gap + curvature_gap / 2) / h**3
    quartic = (-15 * position_gap + 7 * tangent_gap - curvature_gap) / h**4
    quintic = (6 * position_gap - 3 * tangent_gap + curvature_gap / 2) / h**5
    return np.stack([start, tangent, curvature / 2, cubic, quartic, quintic], axis=1), extent


def _frame(curve, t):
    position, first, second = curve(t)
    speed = np.linalg.norm(first, axis=-1, keepdims=True)
    tangent = first / speed
    along = np.sum(second * tangent, axis=-1, keepdims=True)
    return position, tangent, (second - along * tangent) / speed**2


def _arc_length(curve, a, b):
    half = 0.5 * (b - a)
    t = 0.5 * (a + b)[..., None] + half[..., None] * QUADRATURE
    return half * (np.linalg.norm(curve(t)[1], axis=-1) @ QUADRATURE_WEIGHT)
