"""Closed contours through points by a periodic quintic spline.

The knots are at equal spacing of its parameter. Where the points lie at equal arc length, the
parameter is arc length to a few parts in ten thousand, and four derivatives are continuous: a path
of nearly constant parameter speed (after Erkorkmaz & Altintas 2005). The parameter stands where
other contours have arc length. Positions, tangents, curvatures and nearest points are exact; feeds
along the path ripple by the few parts.
"""

from math import factorial

import numpy as np
from jaxtyping import Float

from jcontour._arrays import whole_number
from jcontour.geometry.contour import Contour
from jcontour.geometry.contours import NEWTON_STEPS, from_pieces
from jcontour.geometry.coordinates import Numbers, finite, positive
from jcontour.geometry.pieces import Piece

LEAST_POINTS = 6  # a periodic quintic needs as many
QUADRATURE, QUADRATURE_WEIGHT = np.polynomial.legendre.leggauss(16)
# of the quadrature, per lobe: arc lengths are then exact to rounding where the lobes stay clear of
# the origin
POLAR_CELLS = 64
NEWTON_SEARCH = 8  # steps for equal arc lengths; from within a cell they are at rounding after four


def periodic_spline(points: Numbers, length: float | None = None) -> Contour:
    """Quintic periodic spline through points (n, m) [m], the first of which is not repeated.

    Knot i has the parameter i length / n.

    Args:
        points: positions of the knots; equal arc length between them makes the parameter arc
            length.
        length: range of the parameter [m]; the arc length of the spline when not given.

    Raises:
        ValueError: wrong shape, fewer than 6 points, not finite, repeated points, or a length that
            is not above zero.
    """
    # imported here: it takes longer than the rest of the library
    from scipy.interpolate import make_interp_spline

    points = _knots(points)
    if length is not None:
        length = positive("length", length)
    count = len(points)
    # scipy fits t = 0..n: the fit is the same for every length, and its cardinal scale keeps it
    # well conditioned
    around = np.vstack([points, points[:1]])
    fitted = make_interp_spline(np.arange(count + 1.0), around, k=5, bc_type="periodic")
    if length is None:
        t = np.arange(count)[:, None] + 0.5 + 0.5 * QUADRATURE
        length = float(np.sum(0.5 * np.linalg.norm(fitted(t, 1), axis=-1) @ QUADRATURE_WEIGHT))
    spacing = length / count
    knots = np.arange(count, dtype=float)
    power = [fitted(knots, i) / factorial(i) / spacing**i for i in range(6)]
    pieces = Piece.polynomials(np.stack(power, axis=1), np.full(count, spacing))
    return from_pieces(pieces, newton_steps=NEWTON_STEPS)


def polar_lobes(
    base: float, amplitude: float, lobes: float | int, phase: float = 0.0, knots: float | int = 320
) -> Contour:
    """Periodic quintic spline through the polar curve r(a) = base + amplitude cos(lobes a).

    The curve is turned by `phase`; the knots are at its equal arc lengths.

    Args:
        base: mean radius [m].
        amplitude: of the lobes [m], smaller than the base.
        lobes: how many, at least one.
        phase: angle of the first lobe, where the path begins [rad].
        knots: of the spline; 320 leave 4e-4 of ripple on four lobes of a quarter of the diameter.

    Raises:
        ValueError: the radius does not stay above zero, or lobes or knots are too few or not whole
            numbers.
    """
    if not (np.isfinite([base, amplitude, phase]).all() and base > abs(amplitude)):
        raise ValueError(
            "base: needs to be above the amplitude and finite, "
            f"received {base} m and {amplitude} m, phase {phase}"
        )
    for name, value, least in (("lobes", lobes, 1), ("knots", knots, LEAST_POINTS)):
        whole_number(name, value, least)
    edges = np.linspace(0.0, 2 * np.pi, POLAR_CELLS * int(lobes) + 1)

    def speed(a):
        return np.hypot(base + amplitude * np.cos(lobes * a), lobes * amplitude * np.sin(lobes * a))

    arcs = np.append(0.0, np.cumsum(_integral(speed, edges[:-1], edges[1:])))
    target = arcs[-1] / knots * np.arange(knots)
    cell = np.searchsorted(arcs, target, side="right") - 1
    angle = edges[cell]
    for _ in range(NEWTON_SEARCH):
        angle = angle - (arcs[cell] + _integral(speed, edges[cell], angle) - target) / speed(angle)
    radius = base + amplitude * np.cos(lobes * angle)
    direction = np.stack([np.cos(angle + phase), np.sin(angle + phase)], axis=1)
    return periodic_spline(radius[:, None] * direction, arcs[-1])


def _integral(function, low, high) -> Float[np.ndarray, " n"]:
    half = 0.5 * (high - low)
    place = 0.5 * (low + high)[:, None] + half[:, None] * QUADRATURE
    return half * (function(place) @ QUADRATURE_WEIGHT)


def _knots(points: Numbers) -> Float[np.ndarray, "n m"]:
    points = finite("points", points)
    if points.ndim != 2 or points.shape[1] not in (2, 3) or len(points) < LEAST_POINTS:
        raise ValueError(
            f"points: needs shape (n, 2) or (n, 3) with n at least {LEAST_POINTS}, "
            f"received {points.shape}"
        )
    gaps = np.linalg.norm(np.roll(points, -1, axis=0) - points, axis=1)
    if not gaps.min() > 0:
        raise ValueError(
            "points: neighbours need to differ, the first not repeated at the end; "
            f"point {int(gaps.argmin())} is repeated"
        )
    return points
