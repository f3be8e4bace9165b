"""Closed contours through points by a periodic quintic spline, with knots at equal spacing of its parameter.

Where the points lie at equal arc length, the parameter is arc length to a few parts in ten
thousand, and four derivatives are continuous: a path of nearly constant parameter speed (after
Erkorkmaz & Altintas 2005). The parameter stands where other contours have arc length: positions,
tangents, curvatures and nearest points are the spline's own, feeds along it ripple by the few
parts.
"""

from math import factorial

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

from jcontour.geometry.contour import Contour
from jcontour.geometry.contours import NEWTON_STEPS, from_pieces
from jcontour.geometry.pieces import Piece

LEAST_POINTS = 6  # a periodic quintic needs as many
QUADRATURE, QUADRATURE_WEIGHT = np.polynomial.legendre.leggauss(16)
# of the quadrature, per lobe: arc lengths are then exact to rounding where the lobes stay clear of
# the origin
POLAR_CELLS = 64
NEWTON_SEARCH = 8  # steps for equal arc lengths; from within a cell they are at rounding after four


def periodic_spline(points: ArrayLike, length: float | None = None) -> Contour:
    """Quintic periodic spline through points (n, m) [m], the first of which is not repeated; knot i has the parameter i length / n.

    Args:
        points: where the knots are; equal arc length between them makes the parameter arc length.
        length: of the parameter [m]; the spline's own arc length when not given.

    Raises:
        ValueError: wrong shape, fewer than 6 points, not finite, repeated points, or a length that
            is not above zero.
    """
    from scipy.interpolate import (
        make_interp_spline,
    )  # here, because it takes longer to import than the rest of the library

    points = _knots(points)
    if length is not None and not (np.isfinite(length) and length > 0):
        raise ValueError(f"length: needs to be above zero, received {length}")
    count = len(points)
    # scipy fits t = 0..n: the fit is the same for every length, and its cardinal scale keeps it
    # well conditioned
    fitted = make_interp_spline(
        np.arange(count + 1.0), np.vstack([points, points[:1]]), k=5, bc_type="periodic"
    )
    if length is None:
        t = np.arange(count)[:, None] + 0.5 + 0.5 * QUADRATURE
        length = float(np.sum(0.5 * np.linalg.norm(fitted(t, 1), axis=-1) @ QUADRATURE_WEIGHT))
    spacing = length / count
    power = np.stack(
        [fitted(np.arange(count, dtype=float), i) / factorial(i) / spacing**i for i in range(6)],
        axis=1,
    )
    still, zero = np.zeros((count, points.shape[1])), np.zeros(count)
    return from_pieces(
        Piece(power, still, still, zero, zero, np.full(count, spacing)), newton_steps=NEWTON_STEPS
    )


def polar_lobes(
    base: float, amplitude: float, lobes: int, phase: float = 0.0, knots: int = 320
) -> Contour:
    """Periodic quintic spline through r(a) = base + amplitude cos(lobes a), turned by `phase`; knots at its equal arc lengths.

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
            f"base: needs to be above the amplitude and finite, received {base} m and {amplitude} m, phase {phase}"
        )
    for name, value, least in (("lobes", lobes, 1), ("knots", knots, LEAST_POINTS)):
        if not (value == int(value) and value >= least):
            raise ValueError(f"{name}: needs a whole number of at least {least}, received {value}")
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
    return periodic_spline(
        radius[:, None] * np.stack([np.cos(angle + phase), np.sin(angle + phase)], axis=1), arcs[-1]
    )


def _integral(function, low, high) -> Float[np.ndarray, " n"]:
    half = 0.5 * (high - low)
    return half * (
        function(0.5 * (low + high)[:, None] + half[:, None] * QUADRATURE) @ QUADRATURE_WEIGHT
    )


def _knots(points: ArrayLike) -> Float[np.ndarray, "n m"]:
    points = np.asarray(points, float)
    if points.ndim != 2 or points.shape[1] not in (2, 3) or len(points) < LEAST_POINTS:
        raise ValueError(
            f"points: needs shape (n, 2) or (n, 3) with n at least {LEAST_POINTS}, received {points.shape}"
        )
    if not np.isfinite(points).all():
        raise ValueError("points: every entry needs to be finite, received NaN or inf")
    gaps = np.linalg.norm(np.roll(points, -1, axis=0) - points, axis=1)
    if not gaps.min() > 0:
        raise ValueError(
            f"points: neighbours need to differ, the first not repeated at the end; point {int(gaps.argmin())} is repeated"
        )
    return points
