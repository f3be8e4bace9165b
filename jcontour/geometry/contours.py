"""Constructors of contours: lines, arcs, helices and smooth curves.

A `chain` joins several into one path; a `stack` batches several for vmap. Numbers come in on the
host and are checked first, so that nothing needs to be checked inside jit.
"""

from collections.abc import Sequence
from itertools import pairwise

import jax
import numpy as np
from jaxtyping import Float

from jcontour.geometry.contour import Contour, unpadded
from jcontour.geometry.coordinates import (
    ANY_AXES,
    SMALLEST,
    Numbers,
    distinct_points,
    number,
    positive,
    vector,
)
from jcontour.geometry.pieces import Piece
from jcontour.geometry.quintics import fitted

__all__ = [
    "Contour",
    "arc",
    "chain",
    "circle",
    "ellipse",
    "from_pieces",
    "lemniscate",
    "line",
    "polygon",
    "polyline",
    "spline",
    "stack",
]

# of the nearest point on helices and quintics; distances are then good to 1e-10 of the size, at
# centres of curvature too
NEWTON_STEPS = 4
FIT_TOLERANCE = 1e-10  # [m] a tenth of a nanometre, far below any encoder
MEETING = 1e-9  # of the contour's size: ends closer than this meet
BOX_SAMPLES = 9  # points of a piece that measure the bounding box
TURN_SAMPLES = 257  # points of a piece that turns: the box is good to 1e-4 for a whole turn too
PIECES_AT_ONCE = 10_000  # each is kilobytes while its box is measured
SLIGHT_TURN = 0.2  # [rad] up to which the few samples suffice


def line(start: Numbers, end: Numbers) -> Contour:
    """Straight line between two points (m,) [m], of one axis or more.

    >>> path = line([0.0, 0.0], [30e-3, 40e-3])
    >>> round(float(path.length), 9)
    0.05

    Raises:
        ValueError: wrong shape, not finite, or both points are the same.
    """
    return polyline([vector("line start", start, ANY_AXES), vector("line end", end, ANY_AXES)])


def polyline(points: Numbers) -> Contour:
    """Straight segments through points (n, m) [m]; closed when the last is the first.

    Repeated points are dropped. On one axis the path is the travel itself: a tool off its time has
    no contour error until it leaves the ends of the travel.

    Raises:
        ValueError: wrong shape, not finite, or fewer than two distinct points.
    """
    points = distinct_points("polyline", points, least=2, axes=ANY_AXES)
    delta = np.diff(points, axis=0)
    extent = np.linalg.norm(delta, axis=1)
    polynomial = np.zeros((extent.size, 6, points.shape[1]))
    polynomial[:, 0], polynomial[:, 1] = points[:-1], delta / extent[:, None]
    return from_pieces(Piece.polynomials(polynomial, extent))


def polygon(points: Numbers) -> Contour:
    """Closed polyline through points (n, m) [m], the first of which need not be repeated.

    >>> square = polygon([(0, 0), (20e-3, 0), (20e-3, 20e-3), (0, 20e-3)])
    >>> bool(square.closed), round(float(square.length), 9)
    (True, 0.08)

    Raises:
        ValueError: wrong shape, not finite, or fewer than two distinct points.
    """
    points = distinct_points("polygon", points, least=2)
    return polyline(np.vstack([points, points[:1]]))


def arc(
    start: Numbers,
    centre: Numbers,
    angle: float,
    normal: Numbers = (0.0, 0.0, 1.0),
    rise: float = 0.0,
) -> Contour:
    """Circular arc around `centre`, or a helix when it rises along the normal meanwhile.

    >>> quarter = arc(start=[10e-3, 0.0], centre=[0.0, 0.0], angle=np.pi / 2)
    >>> np.round(quarter.position(quarter.length), 9).tolist()
    [0.0, 0.01]

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
    start, centre = vector("arc start", start), vector("arc centre", centre)
    normal = vector("arc normal", normal)
    angle, rise = number("arc angle", angle), number("arc rise", rise)
    if start.shape != centre.shape:
        raise ValueError(
            "arc: start and centre need the same number of axes, "
            f"received {start.shape} and {centre.shape}"
        )
    if normal.size != 3 or not normal.any():
        raise ValueError(
            f"arc: the normal needs three entries, not all zero, received {normal.tolist()}"
        )
    if start.size == 2 and (normal[:2].any() or rise):
        raise ValueError(
            "arc: two axes need a normal along z and no rise, "
            f"received {normal.tolist()} and {rise} m"
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
            "arc: the radius needs to be at right angles to the normal, "
            f"received {height} m of {radius} m along it"
        )
    return _turn(start, radial - height * normal, normal, angle, rise)


def circle(
    radius: float, centre: Numbers = (0.0, 0.0), start_angle: float = 0.0, clockwise: bool = False
) -> Contour:
    """Full circle in the x-y plane: one piece.

    >>> path = circle(radius=10e-3)
    >>> round(float(path.length), 6), round(float(path.curvature(0.0)), 6)
    (0.062832, 100.0)

    Args:
        radius: [m].
        centre: (2,) or (3,) [m].
        start_angle: polar angle of the first point [rad].
        clockwise: direction of the motion.

    Raises:
        ValueError: radius not above zero, wrong shape or not finite.
    """
    radius, centre = positive("circle radius", radius), vector("circle centre", centre)
    angle = number("circle start_angle", start_angle)
    radial = radius * np.array([np.cos(angle), np.sin(angle), 0.0])
    normal = np.array([0.0, 0.0, -1.0 if clockwise else 1.0])
    return _turn(centre + radial[: centre.size], radial, normal, 2.0 * np.pi, 0.0)


def ellipse(a: float, b: float, *, tolerance: float = FIT_TOLERANCE) -> Contour:
    """Ellipse x = a cos t, y = b sin t, counter-clockwise from (a, 0).

    Args:
        a: half axis along x [m].
        b: half axis along y [m].
        tolerance: largest distance of the fit from the true curve [m].

    Raises:
        ValueError: a half axis is not above zero, or the tolerance is out of reach.
    """
    half_axes = np.array([positive("ellipse a", a), positive("ellipse b", b)])

    def curve(t):
        cos, sin = np.cos(t), np.sin(t)
        direction, normal = np.stack([cos, sin], axis=-1), np.stack([-sin, cos], axis=-1)
        return half_axes * direction, half_axes * normal, -half_axes * direction

    return _smooth("ellipse", curve, np.linspace(0.0, 2.0 * np.pi, 9), tolerance)


def lemniscate(half_width: float, *, tolerance: float = FIT_TOLERANCE) -> Contour:
    """Bernoulli's lemniscate x = a cos t / (1 + sin^2 t), y = x sin t from (a, 0).

    As a complex number it is a cos t / (1 - i sin t). It crosses itself at the origin, at a quarter
    and at three quarters of its length.

    Args:
        half_width: a [m].
        tolerance: largest distance of the fit from the true curve [m].

    Raises:
        ValueError: the half width is not above zero, or the tolerance is out of reach.
    """
    half_width = positive("lemniscate half_width", half_width)

    def curve(t):
        cos, sin = np.cos(t), np.sin(t)
        q = 1 - 1j * sin
        complex_jet = cos / q, (1j - sin) / q**2, -cos * (3 + 1j * sin) / q**3
        return tuple(half_width * np.stack([z.real, z.imag], axis=-1) for z in complex_jet)

    return _smooth("lemniscate", curve, np.linspace(0.0, 2.0 * np.pi, 9), tolerance)


def spline(points: Numbers, closed: bool = False, *, tolerance: float = FIT_TOLERANCE) -> Contour:
    """Cubic spline through points (n, m) [m] over their chord length, with continuous curvature.

    This spline is the true curve. Open ends are not-a-knot; a closed spline is periodic and its
    first point need not be repeated.

    Raises:
        ValueError: wrong shape, not finite, fewer than two distinct points (closed: three), or the
            fit tolerance [m] is out of reach.
    """
    # imported here: it takes longer than the rest of the library
    from scipy.interpolate import CubicSpline

    points = distinct_points("spline", points, least=3 if closed else 2)
    if closed:
        points = distinct_points("spline", np.vstack([points, points[:1]]), least=3)
        points[-1] = points[0]  # to the last bit
    chord = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    cubic = CubicSpline(chord, points, bc_type="periodic" if closed else "not-a-knot")
    return _smooth("spline", lambda t: (cubic(t), cubic(t, 1), cubic(t, 2)), chord, tolerance)


def chain(contours: Sequence[Contour]) -> Contour:
    """One contour through several, in order.

    >>> side = line([0.0, 0.0], [20e-3, 0.0])
    >>> corner = arc([20e-3, 0.0], [20e-3, 5e-3], np.pi / 2)
    >>> path = chain([side, corner])
    >>> np.round(path.position(path.length), 9).tolist()
    [0.025, 0.005]

    It is closed when the end of the last meets the start of the first; gaps of rounding are left.

    Raises:
        ValueError: nothing to chain, 2-D mixed with 3-D, a stack among them, or a gap wider than
            1e-9 of the size of the whole.
    """
    _check_alike("chain", contours)
    members = [unpadded(contour) for contour in contours]
    whole = from_pieces(
        jax.tree.map(lambda *rows: np.concatenate(rows), *members),
        fit_error=max(float(contour.fit_error) for contour in contours),
        newton_steps=max(contour.newton_steps for contour in contours),
    )
    widest = MEETING * float(whole.size)
    for i, (before, after) in enumerate(pairwise(members)):
        end, start = _ends(before)[1], _ends(after)[0]
        gap = np.linalg.norm(start - end)
        if gap > widest:
            raise ValueError(
                f"chain: contour {i} ends at {end.tolist()} "
                f"but contour {i + 1} starts at {start.tolist()}, "
                f"{gap:.3g} m apart; they need to meet within {widest:.1g} m"
            )
    return whole


def stack(contours: Sequence[Contour]) -> Contour:
    """Contours along a new leading axis for vmap, padded to the largest number of pieces.

    >>> both = stack([circle(5e-3), circle(10e-3)])
    >>> np.round(both.length, 6).tolist()
    [0.031416, 0.062832]

    Raises:
        ValueError: nothing to stack, 2-D mixed with 3-D, or a stack among them.
    """
    _check_alike("stack", contours)
    most = max(contour.rate.size for contour in contours)
    padded = [_padded(contour, most) for contour in contours]
    arrays = jax.device_put([np.stack(rows) for rows in zip(*padded, strict=True)])
    newton_steps = max(contour.newton_steps for contour in contours)
    turns = any(contour.turns for contour in contours)
    return Contour(*arrays, newton_steps=newton_steps, turns=turns)


def _padded(contour: Contour, count: int) -> tuple[np.ndarray, ...]:
    """Arrays of a contour in the order of its fields, its pieces padded to `count`."""

    def pad(rows, **how):
        rows = np.asarray(rows)
        return np.pad(rows, [(0, count - len(rows))] + [(0, 0)] * (rows.ndim - 1), **how)

    # the last piece over again: finite wherever it is evaluated
    pieces = jax.tree.map(lambda rows: pad(rows, mode="edge"), contour.pieces)
    extent = pad(contour.extent)
    end = pieces.start[-1] + np.asarray(contour.extent)[-1]
    pieces = pieces._replace(start=np.where(extent > 0, pieces.start, end), extent=extent)
    whole = (contour.closed, contour.size, contour.fit_error)
    return (*pieces, pad(contour.mask), *map(np.asarray, whole))


def from_pieces(pieces: Piece, fit_error: float = 0.0, newton_steps: int = 0) -> Contour:
    """Contour of NumPy pieces in order.

    Where each starts, the size, and whether the whole is closed follow from them.
    """
    if pieces.extent.min() <= SMALLEST:
        raise ValueError(
            f"contour: needs pieces of a length above zero, received one of {pieces.extent.min()} m"
        )
    pieces = pieces._replace(start=np.append(0.0, np.cumsum(pieces.extent)[:-1]))
    turning = jax.tree.map(lambda rows: rows[pieces.rate * pieces.extent > SLIGHT_TURN], pieces)
    corners = np.concatenate([_corners(pieces, BOX_SAMPLES), _corners(turning, TURN_SAMPLES)])
    size = np.linalg.norm(np.ptp(corners, axis=0))
    start, end = _ends(pieces)
    closed = np.linalg.norm(end - start) <= MEETING * size
    mask = np.ones(pieces.rate.size, bool)
    arrays = (*pieces, mask, closed, size, np.float64(fit_error))  # in the order of the fields
    placed = jax.device_put(arrays)  # jnp.asarray would compile a copy for every shape
    return Contour(*placed, newton_steps=newton_steps, turns=bool(pieces.rate.any()))


def _corners(pieces: Piece, count: int) -> Float[np.ndarray, "n m"]:
    """Lowest and highest coordinates of samples, of so many pieces at a time as fit in memory."""
    corners = [np.zeros((0, pieces.polynomial.shape[-1]))]
    for first in range(0, pieces.extent.size, PIECES_AT_ONCE):
        some = slice(first, first + PIECES_AT_ONCE)
        part = jax.tree.map(lambda rows, some=some: rows[some], pieces)
        points = part.jet(np.linspace(0.0, 1.0, count)[:, None] * part.extent)[0]
        corners.append(np.stack([points.min(axis=(0, 1)), points.max(axis=(0, 1))]))
    return np.concatenate(corners)


def _ends(pieces: Piece) -> Float[np.ndarray, "2 m"]:
    first, last = (jax.tree.map(lambda rows, i=i: rows[i], pieces) for i in (0, -1))
    return np.stack([first.jet(np.zeros(()))[0], last.jet(np.asarray(last.extent))[0]])


def _turn(start, radial, normal, angle: float, rise: float) -> Contour:
    """Arc or helix around the axis through start - radial along the unit normal."""
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
    within = positive(f"{name} tolerance", tolerance)
    fit = fitted(name, curve, lambda t, frame: frame, knots[:-1], knots[1:], within)
    return from_pieces(fit.pieces(), fit.error, NEWTON_STEPS)


def _check_alike(name: str, contours: Sequence[Contour]) -> None:
    shapes = [c.polynomial.shape for c in contours]
    single = all(len(shape) == 3 for shape in shapes)
    if not shapes or not single or len({shape[-1] for shape in shapes}) != 1:
        raise ValueError(
            f"{name}: needs single contours, at least one, with the same number of axes, "
            f"received pieces of shape {shapes}"
        )


def __dir__() -> list[str]:
    return __all__
