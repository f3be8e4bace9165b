"""DXF entities as segments of the plane: lines, circles, ellipses, polylines with bulges, splines.

The reference is Autodesk's "DXF Reference", section ENTITIES. Lengths are in metres once placed.
"""

import cmath
import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from jcontour.geometry.drawings.affine import Planar
from jcontour.geometry.drawings.dxf_placing import EXTRUSION, Placement, own_system
from jcontour.geometry.drawings.dxf_tags import Entity, Point
from jcontour.geometry.drawings.segments import Arc, Curve, Line, Segment
from jcontour.geometry.toolpath_rules import ToolpathError

X, Y = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)
FLATTEST = 1e-9  # of a bulge: what bends less is a line
WHOLE = 1e-9  # [rad] turns this close to a whole one, or to none, are whole
CLOSED, CURVE_FIT, THREE_D, MESH, FACES = 1, 2, 8, 16, 64  # flags of a POLYLINE
FRAME = 16  # flag of a vertex that is only a control point
HIGHEST_DEGREE = 25  # of a spline, as drawing programs allow


def line(entity: Entity, place: Placement) -> list[Segment]:
    """LINE."""
    return [Line(place.seen(entity.point(10)), place.seen(entity.point(11)))]


def circle(entity: Entity, place: Placement) -> list[Segment] | None:
    """CIRCLE, from its angle 0; None where it has no radius."""
    return _turn(entity, place, 0.0, math.tau)


def arc(entity: Entity, place: Placement) -> list[Segment] | None:
    """ARC: counter-clockwise from one angle to the other, in degrees; None without a radius."""
    begin, end = (math.radians(math.fmod(entity.number(code), 360.0)) for code in (50, 51))
    return _turn(entity, place, begin, _sweep(begin, end))


def _turn(entity: Entity, place: Placement, begin: float, sweep: float) -> list[Segment] | None:
    own, radius = place.of(own_system(entity)), entity.number(40)
    first, second = (radius * own.seen_direction(axis) for axis in (X, Y))
    centre = own.seen(entity.point(10))
    return [Arc(centre, first, second, begin, sweep)] if radius > 0 else None


def ellipse(entity: Entity, place: Placement) -> list[Segment]:
    """ELLIPSE: its minor axis is at right angles to the extrusion and to the major one."""
    major, normal = np.array(entity.point(11)), np.array(entity.point(EXTRUSION, (0.0, 0.0, 1.0)))
    if not (major.any() and normal.any()):
        raise ToolpathError(f"line {entity.line}: ELLIPSE without an axis")
    minor = entity.number(40) * np.cross(normal / np.linalg.norm(normal), major)
    begin, end = entity.number(41, 0.0), entity.number(42, math.tau)
    sweep, begin = _sweep(begin, end), math.fmod(begin, math.tau)
    first, second = (place.seen_direction(tuple(axis.tolist())) for axis in (major, minor))
    return [Arc(place.seen(entity.point(10)), first, second, begin, sweep)]


def light_polyline(entity: Entity, place: Placement) -> list[Segment]:
    """LWPOLYLINE: points and bulges in its own system."""
    vertices: list[tuple[Planar, float]] = []
    for tag in entity.tags:
        if tag.code == 10:
            vertices.append((complex(tag.number()), 0.0))
        elif tag.code == 20 and vertices:
            vertices[-1] = complex(vertices[-1][0].real, tag.number()), vertices[-1][1]
        elif tag.code == 42 and vertices:
            vertices[-1] = vertices[-1][0], tag.number()
    own, height = place.of(own_system(entity)), entity.number(38, 0.0)
    return _bulged(vertices, bool(entity.flags() & CLOSED), own, height)


def polyline(entity: Entity, vertices: Sequence[Entity], place: Placement) -> list[Segment] | None:
    """POLYLINE with its vertices, of two dimensions or three; None for meshes."""
    flags = entity.flags()
    if flags & (MESH | FACES):
        return None
    corners = [vertex for vertex in vertices if not vertex.flags() & FRAME]
    closed = bool(flags & CLOSED)
    if flags & THREE_D:
        points = [place.seen(vertex.point(10)) for vertex in corners]
        return [Line(*ends) for ends in _pairs(points, closed)]
    own = place.of(own_system(entity))
    plane = [(complex(*vertex.point(10)[:2]), vertex.number(42, 0.0)) for vertex in corners]
    return _bulged(plane, closed, own, entity.number(30, 0.0))


def spline(entity: Entity, place: Placement) -> list[Segment]:
    """SPLINE: NURBS of any degree, or a cubic through fit points; a curve for each interval."""
    control = [place.seen(point) for point in entity.points(10)]
    if not control:
        return _through_points(entity, place)
    degree, knots = entity.flags(71), np.array(entity.numbers(40))
    weights = np.array(entity.numbers(41) or [1.0] * len(control))
    fault = _spline_fault(degree, knots, len(control), weights)
    if fault:
        raise ToolpathError(f"line {entity.line}: SPLINE {fault}")
    # imported here: it takes longer than the rest of the library
    from scipy.interpolate import BSpline

    points = np.array(control)
    homogeneous = np.stack([weights * np.real(points), weights * np.imag(points), weights], axis=1)
    spans = np.unique(knots[degree : len(control) + 1])
    return _intervals(BSpline(knots, homogeneous, degree), spans, degree)


def _spline_fault(degree: int, knots: np.ndarray, points: int, weights: np.ndarray) -> str:
    if not 1 <= degree <= HIGHEST_DEGREE:
        return f"of degree {degree}"
    if knots.size != points + degree + 1 or points <= degree:
        return f"of degree {degree} with {points} control points and {knots.size} knots"
    if weights.size != points or not (weights > 0).all():
        return "with weights that are not one above zero for each control point"
    if not (np.diff(knots) >= 0).all() or not knots[degree] < knots[points]:
        return "with knots that do not rise"
    return ""


def _through_points(entity: Entity, place: Placement) -> list[Segment]:
    """Cubic spline over the chord length through the fit points, with the end tangents given."""
    fit = [place.seen(point) for point in entity.points(11)]
    points = np.array([p for i, p in enumerate(fit) if i == 0 or p != fit[i - 1]])
    if points.size < 2:
        raise ToolpathError(f"line {entity.line}: SPLINE without control points and fit points")
    if points.size == 2:
        return [Line(points[0], points[1])]
    # imported here: it takes longer than the rest of the library
    from scipy.interpolate import CubicSpline

    chord = np.append(0.0, np.cumsum(np.abs(np.diff(points))))
    ends = []
    for code in (12, 13):
        tangent = place.seen_direction(entity.point(code, (0.0, 0.0, 0.0)))
        unit = tangent / abs(tangent) if tangent else 0.0
        ends.append((1, np.array([unit.real, unit.imag])) if tangent else (2, np.zeros(2)))
    pairs = np.stack([np.real(points), np.imag(points)], axis=1)
    periodic = points[0] == points[-1] and entity.flags() & CLOSED
    conditions: Any = "periodic" if periodic else ends
    cubic = CubicSpline(chord, pairs, bc_type=conditions)

    def homogeneous(t: np.ndarray, nu: int = 0) -> np.ndarray:
        weight = np.full((t.size, 1), 0.0 if nu else 1.0)
        return np.concatenate([cubic(t, nu), weight], axis=1)

    return _intervals(homogeneous, chord, 3)


def _intervals(
    homogeneous: Callable[..., np.ndarray], knots: Float[np.ndarray, " k"], degree: int
) -> list[Segment]:
    """Rational curves between the knots, by the derivatives at the beginning of each interval."""
    begin, width = knots[:-1], np.diff(knots)
    powers = np.stack(
        [
            homogeneous(begin, nu=i) * width[:, None] ** i / math.factorial(i)
            for i in range(degree + 1)
        ],
        axis=1,
    )  # (interval, power, x y w)
    top, bottom = powers[..., 0] + 1j * powers[..., 1], powers[..., 2]
    return [Curve(tuple(t), tuple(b)) for t, b in zip(top.tolist(), bottom.tolist(), strict=True)]


def _bulged(
    vertices: list[tuple[Planar, float]], closed: bool, own: Placement, height: float
) -> list[Segment]:
    """Lines and arcs between vertices; a bulge is the tangent of a quarter of the arc's angle."""
    bulges = [bulge for _, bulge in vertices]
    found: list[Segment] = []
    for (start, end), bulge in zip(
        _pairs([point for point, _ in vertices], closed), bulges, strict=False
    ):
        if start == end:
            continue
        if abs(bulge) < FLATTEST:
            found.append(Line(own.seen(_at(start, height)), own.seen(_at(end, height))))
            continue
        centre = 0.5 * (start + end) + 1j * (end - start) * (1 - bulge**2) / (4 * bulge)
        radial = start - centre
        first, second = (own.seen_direction(_at(side, 0.0)) for side in (radial, 1j * radial))
        found.append(Arc(own.seen(_at(centre, height)), first, second, 0.0, 4 * math.atan(bulge)))
    return found


def _pairs(points: list[Planar], closed: bool) -> list[tuple[Planar, Planar]]:
    following = points[1:] + points[:1] if closed else points[1:]
    return list(zip(points, following, strict=False))


def _at(point: Planar, height: float) -> Point:
    return point.real, point.imag, height


def _sweep(begin: float, end: float) -> float:
    if not cmath.isfinite(end - begin):
        return math.nan
    sweep = (end - begin) % math.tau
    return math.tau if min(sweep, math.tau - sweep) <= WHOLE else sweep
