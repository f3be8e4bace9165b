"""The contours one can make: lines, arcs, helices, smooth curves, a `chain` of these in one path, and a `stack` of paths for vmap.

Numbers come in on the host and are checked here, so that nothing needs to be inside jit.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import jax
import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

from jcontour.geometry.contour import Contour
from jcontour.geometry.pieces import Piece
from jcontour.geometry.quintics import quintic_pieces

# of the nearest point on helices and quintics; distances are then good to 1e-10 of the size, at
# centres of curvature too
NEWTON_STEPS = 4
FIT_TOLERANCE = 1e-10  # [m] a tenth of a nanometre, far below any encoder
MEETING = 1e-9  # of the contour's size: ends closer than this meet
BOX_SAMPLES, TURN_SAMPLES = (
    9,
    257,
)  # of any piece, of one that turns: the bounding box is then good to 1e-4, for a whole turn too
SLIGHT_TURN = 0.2  # [rad] up to which the few samples suffice
PLANE_OR_SPACE, ANY_AXES = (2, 3), (1, 2, 3)  # numbers of axes
SMALLEST, LARGEST = (
    1e-100,
    1e100,
)  # lengths [m] and angles [rad] between: their squares neither vanish nor overflow


def line(start: ArrayLike, end: ArrayLike) -> Contour:
    """Straight line between two points (m,) [m], of one axis or more.

    Raises:
        ValueError: wrong shape, not finite, or both points are the same.
    """
    return polyline([_vector("line start", start, ANY_AXES), _vector("line end", end, ANY_AXES)])


def polyline(points: ArrayLike) -> Contour:
    """Straight segments through points (n, m) [m]; closed when the last is the first. Repeated points are dropped.

    On one axis the path is the travel itself: a tool off its time has no contour error until it
    leaves the ends of the travel.

    Raises:
        ValueError: wrong shape, not finite, or fewer than two distinct points.
    """
    points = _distinct_points("polyline", points, least=2, axes=ANY_AXES)
    delta = np.diff(points, axis=0)
    extent = np.linalg.norm(delta, axis=1)
    polynomial = np.zeros((extent.size, 6, points.shape[1]))
    polynomial[:, 0], polynomial[:, 1] = points[:-1], delta / extent[:, None]
    return from_pieces(_polynomial_pieces(polynomial, extent))


def polygon(points: ArrayLike) -> Contour:
    """Closed polyline through points (n, m) [m], the first of which need not be repeated.

    Raises:
        ValueError: wrong shape, not finite, or fewer than two distinct points.
    """
    points = _distinct_points("polygon", points, least=2)
    return polyline(np.vstack([points, points[:1]]))


def arc(
    start: ArrayLike,
    centre: ArrayLike,
    angle: float,
    normal: ArrayLike = (0.0, 0.0, 1.0),
    rise: float = 0.0,
) -> Contour:
    """Circular arc around `centre`, or a helix when it rises along the normal meanwhile.

    Args:
        start: first point (2,) or (3,) [m].
        centre: of the circle in the plane of the start [m].
        angle: turned angle [rad], positive counter-clockwise seen from the tip of the normal; whole
            turns and more are allowed.
        normal: axis of the turn, of any length; in two dimensions along z.
        rise: displacement along the normal [m].

    Raises:
        ValueError: wrong shape, not finite, zero radius or angle, a normal that is not at right
            angles to the radius, a rise in 2-D.
    """
    start, centre, normal = (
        _vector("arc start", start),
        _vector("arc centre", centre),
        _vector("arc normal", normal),
    )
    angle, rise = _number("arc angle", angle), _number("arc rise", rise)
    if start.shape != centre.shape:
        raise ValueError(
            f"arc: start and centre need the same number of axes, received {start.shape} and {centre.shape}"
        )
    if normal.size != 3 or not normal.any():
        raise ValueError(
            f"arc: the normal needs three entries, not all zero, received {normal.tolist()}"
        )
    if start.size == 2 and (normal[:2].any() or rise):
        raise ValueError(
            f"arc: two axes need a normal along z and no rise, received {normal.tolist()} and {rise} m"
        )
    normal = normal / np.linalg.norm(normal)
    radial = np.append(start - centre, np.zeros(3 - start.size))
    radius, height = np.linalg.norm(radial), radial @ normal
    if abs(angle) <= SMALLEST or radius <= SMALLEST:
        raise ValueError(
            f"arc: needs an angle and a radius other than zero, received {angle} rad and {radius} m"
        )
    if abs(height) > MEETING * radius:
        raise ValueError(
            f"arc: the radius needs to be at right angles to the normal, received {height} m of {radius} m along it"
        )
    return _turn(start, radial - height * normal, normal, angle, rise)


def circle(
    radius: float, centre: ArrayLike = (0.0, 0.0), start_angle: float = 0.0, clockwise: bool = False
) -> Contour:
    """Full circle in the x-y plane: one piece.

    Args:
        radius: [m].
        centre: (2,) or (3,) [m].
        start_angle: polar angle of the first point [rad].
        clockwise: direction of the motion.

    Raises:
        ValueError: radius not above zero, wrong shape or not finite.
    """
    radius, angle, centre = (
        _positive("circle radius", radius),
        _number("circle start_angle", start_angle),
        _vector("circle centre", centre),
    )
    radial = radius * np.array([np.cos(angle), np.sin(angle), 0.0])
    normal = np.array([0.0, 0.0, -1.0 if clockwise else 1.0])
    return _turn(centre + radial[: centre.size], radial, normal, 2.0 * np.pi, 0.0)


def ellipse(a: float, b: float, *, tolerance: float = FIT_TOLERANCE) -> Contour:
    """Ellipse x = a cos t, y = b sin t, counter-clockwise from (a, 0); half axes and fit tolerance in metres.

    Raises:
        ValueError: a half axis is not above zero, or the tolerance is out of reach.
    """
    half_axes = np.array([_positive("ellipse a", a), _positive("ellipse b", b)])

    def curve(t):
        direction, normal = (
            np.stack([np.cos(t), np.sin(t)], axis=-1),
            np.stack([-np.sin(t), np.cos(t)], axis=-1),
        )
        return half_axes * direction, half_axes * normal, -half_axes * direction

    return _smooth("ellipse", curve, np.linspace(0.0, 2.0 * np.pi, 9), tolerance)


def lemniscate(half_width: float, *, tolerance: float = FIT_TOLERANCE) -> Contour:
    """Bernoulli's lemniscate x = a cos t / (1 + sin^2 t), y = x sin t from (a, 0); half width a and fit tolerance in metres.

    As a complex number it is a cos t / (1 - i sin t). It crosses itself at the origin, at a quarter
    and at three quarters of its length.

    Raises:
        ValueError: the half width is not above zero, or the tolerance is out of reach.
    """
    half_width = _positive("lemniscate half_width", half_width)

    def curve(t):
        cos, sin = np.cos(t), np.sin(t)
        q = 1 - 1j * sin
        complex_jet = cos / q, (1j - sin) / q**2, -cos * (3 + 1j * sin) / q**3
        return tuple(half_width * np.stack([z.real, z.imag], axis=-1) for z in complex_jet)

    return _smooth("lemniscate", curve, np.linspace(0.0, 2.0 * np.pi, 9), tolerance)


def spline(points: ArrayLike, closed: bool = False, *, tolerance: float = FIT_TOLERANCE) -> Contour:
    """Cubic spline through points (n, m) [m] over their chord length, with continuous curvature; this spline is the true curve.

    Open ends are not-a-knot; a closed spline is periodic and its first point need not be repeated.

    Raises:
        ValueError: wrong shape, not finite, fewer than two distinct points (closed: three), or the
            fit tolerance [m] is out of reach.
    """
    from scipy.interpolate import (
        CubicSpline,
    )  # here, because it takes longer to import than the rest of the library

    points = _distinct_points("spline", points, least=3 if closed else 2)
    if closed:
        points = _distinct_points("spline", np.vstack([points, points[:1]]), least=3)
        points[-1] = points[0]  # to the last bit
    chord = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    cubic = CubicSpline(chord, points, bc_type="periodic" if closed else "not-a-knot")
    return _smooth("spline", lambda t: (cubic(t), cubic(t, 1), cubic(t, 2)), chord, tolerance)


def chain(contours: Sequence[Contour]) -> Contour:
    """One contour through several, in order; closed when the end of the last meets the start of the first, gaps of rounding are left.

    Raises:
        ValueError: nothing to chain, 2-D mixed with 3-D, a stack among them, or a gap wider than
            1e-9 of the size of the whole.
    """
    _check_alike("chain", contours)
    members = [
        jax.tree.map(lambda rows, c=c: np.asarray(rows)[np.asarray(c.mask)], c.pieces)
        for c in contours
    ]
    whole = from_pieces(
        jax.tree.map(lambda *rows: np.concatenate(rows), *members),
        fit_error=max(float(c.fit_error) for c in contours),
        newton_steps=max(c.newton_steps for c in contours),
    )
    widest = MEETING * float(whole.size)
    for i, (before, after) in enumerate(pairwise(members)):
        end, start = _ends(before)[1], _ends(after)[0]
        gap = np.linalg.norm(start - end)
        if gap > widest:
            raise ValueError(
                f"chain: contour {i} ends at {end.tolist()} but contour {i + 1} starts at {start.tolist()}, "
                f"{gap:.3g} m apart; they need to meet within {widest:.1g} m"
            )
    return whole


def stack(contours: Sequence[Contour]) -> Contour:
    """Contours along a new leading axis for vmap, padded to the largest number of pieces.

    Raises:
        ValueError: nothing to stack, 2-D mixed with 3-D, or a stack among them.
    """
    _check_alike("stack", contours)
    most, newton_steps, turns = (
        max(c.rate.size for c in contours),
        max(c.newton_steps for c in contours),
        any(c.turns for c in contours),
    )
    alike = [replace(_padded(c, most), newton_steps=newton_steps, turns=turns) for c in contours]
    return jax.device_put(jax.tree.map(lambda *leaves: np.stack(leaves), *alike))


def _padded(contour: Contour, count: int) -> Contour:
    def pad(rows, **how):
        return np.pad(
            np.asarray(rows), [(0, count - len(rows))] + [(0, 0)] * (rows.ndim - 1), **how
        )

    pieces = jax.tree.map(
        lambda rows: pad(rows, mode="edge"), contour.pieces
    )  # the last over again: finite wherever it is evaluated
    extent = pad(contour.extent)
    start = np.where(extent > 0, pieces.start, pieces.start[-1] + np.asarray(contour.extent)[-1])
    return replace(
        contour, **pieces._replace(start=start, extent=extent)._asdict(), mask=pad(contour.mask)
    )


def from_pieces(pieces: Piece, fit_error: float = 0.0, newton_steps: int = 0) -> Contour:
    """Contour of NumPy pieces in order; where each starts, the size, and whether the whole is closed follow from them."""
    if pieces.extent.min() <= SMALLEST:
        raise ValueError(
            f"contour: needs pieces of a length above zero, received one of {pieces.extent.min()} m"
        )
    pieces = pieces._replace(start=np.append(0.0, np.cumsum(pieces.extent)[:-1]))
    turning = jax.tree.map(lambda rows: rows[pieces.rate * pieces.extent > SLIGHT_TURN], pieces)
    points = np.concatenate([_samples(pieces, BOX_SAMPLES), _samples(turning, TURN_SAMPLES)])
    size = np.linalg.norm(np.ptp(points, axis=0))
    start, end = _ends(pieces)
    closed = np.linalg.norm(end - start) <= MEETING * size
    arrays = (
        *pieces,
        np.ones(pieces.rate.size, bool),
        closed,
        size,
        np.float64(fit_error),
    )  # in the order of the fields
    placed = jax.device_put(arrays)  # jnp.asarray would compile a copy for every shape
    return Contour(*placed, newton_steps=newton_steps, turns=bool(pieces.rate.any()))


def _samples(pieces: Piece, count: int) -> Float[np.ndarray, "n m"]:
    points = pieces.jet(np.linspace(0.0, 1.0, count)[:, None] * pieces.extent)[0]
    return points.reshape(-1, points.shape[-1])


def _ends(pieces: Piece) -> Float[np.ndarray, "2 m"]:
    first, last = (jax.tree.map(lambda rows, i=i: rows[i], pieces) for i in (0, -1))
    return np.stack([first.jet(np.zeros(()))[0], last.jet(last.extent)[0]])


def _polynomial_pieces(polynomial, extent) -> Piece:
    still, zero = np.zeros((extent.size, polynomial.shape[-1])), np.zeros(extent.size)
    return Piece(polynomial, still, still, zero, zero, extent)


def _turn(start, radial, normal, angle: float, rise: float) -> Contour:
    """Arc or helix around the axis through start - radial along the unit normal; `start` in two or three axes, the others in three."""
    axes, extent = start.size, np.hypot(np.linalg.norm(radial) * angle, rise)
    polynomial = np.zeros((1, 6, axes))
    polynomial[0, 0], polynomial[0, 1] = start - radial[:axes], (rise / extent * normal)[:axes]
    sine = np.sign(angle) * np.cross(normal, radial)
    rate = np.array([abs(angle) / extent])
    pieces = Piece(
        polynomial, radial[None, :axes], sine[None, :axes], rate, 0.0 * rate, np.array([extent])
    )
    return from_pieces(pieces, newton_steps=NEWTON_STEPS if rise else 0)


def _smooth(name: str, curve, knots, tolerance: float) -> Contour:
    polynomial, extent, fit_error = quintic_pieces(
        name, curve, knots, _positive(f"{name} tolerance", tolerance)
    )
    return from_pieces(_polynomial_pieces(polynomial, extent), fit_error, NEWTON_STEPS)


def _check_alike(name: str, contours: Sequence[Contour]) -> None:
    shapes = [c.polynomial.shape for c in contours]
    if (
        not shapes
        or any(len(shape) != 3 for shape in shapes)
        or len({shape[-1] for shape in shapes}) != 1
    ):
        raise ValueError(
            f"{name}: needs single contours, at least one, with the same number of axes, received pieces of shape {shapes}"
        )


def _distinct_points(
    name: str, points: ArrayLike, least: int, axes: tuple[int, ...] = PLANE_OR_SPACE
) -> Float[np.ndarray, "n m"]:
    points = _finite(name, points)
    if points.ndim != 2 or points.shape[1] not in axes:
        wanted = " or ".join(f"(n, {m})" for m in axes)
        raise ValueError(f"{name}: needs points of shape {wanted}, received shape {points.shape}")
    rounding = 4.0 * np.spacing(
        np.abs(points).max(initial=0.0)
    )  # a step this short has no direction
    points = points[
        np.append(True, np.linalg.norm(np.diff(points, axis=0), axis=1) > rounding)[: len(points)]
    ]
    distinct = len(np.unique(points, axis=0))
    if distinct < least:
        raise ValueError(f"{name}: needs at least {least} distinct points, received {distinct}")
    return points


def _vector(
    name: str, value: ArrayLike, axes: tuple[int, ...] = PLANE_OR_SPACE
) -> Float[np.ndarray, " m"]:
    value = _finite(name, value)
    if value.ndim != 1 or value.size not in axes:
        raise ValueError(
            f"{name}: needs shape {' or '.join(f'({m},)' for m in axes)}, received shape {value.shape}"
        )
    return value


def _number(name: str, value: float) -> float:
    number = _finite(name, value)
    if number.ndim:
        raise ValueError(f"{name}: needs one number, received shape {number.shape}")
    return float(number)


def _positive(name: str, value: float) -> float:
    value = _number(name, value)
    if value <= SMALLEST:
        raise ValueError(f"{name}: needs to be above zero, received {value}")
    return value


def _finite(name: str, value: ArrayLike) -> np.ndarray:
    try:
        value = np.asarray(value, float)
    except (TypeError, ValueError):
        raise ValueError(f"{name}: needs numbers in a regular array, received {value!r}") from None
    if not (np.abs(value) < LARGEST).all():
        raise ValueError(
            f"{name}: every entry needs to be finite (below {LARGEST:g}), received NaN, inf or more"
        )
    return value
