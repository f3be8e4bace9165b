"""DXF entities as segments of the plane: lines, circles, ellipses, polylines with bulges, splines.

Entities of `ezdxf` in their own systems (OCS) are placed by a matrix; z is left out: a circle that
leans is seen as the ellipse that it looks like.
"""

import cmath
import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float

from jcontour.geometry.drawings.affine import Planar
from jcontour.geometry.drawings.drawing import at_line
from jcontour.geometry.drawings.segments import Arc, Curve, Line, Segment
from jcontour.geometry.toolpath_rules import ToolpathError

if TYPE_CHECKING:
    from ezdxf.math import Matrix44

REQUIRED = {  # of each kind that is taken: without them ezdxf puts zeros
    "LINE": ("start", "end"),
    "CIRCLE": ("center", "radius"),
    "ARC": ("center", "radius", "start_angle", "end_angle"),
    "ELLIPSE": ("center", "major_axis", "ratio"),
    "LWPOLYLINE": (),
    "POLYLINE": (),
    "SPLINE": (),
}
FLATTEST = 1e-9  # of a bulge: what bends less is a line
WHOLE = 1e-9  # [rad] turns this close to a whole one, or to none, are whole
FRAME = 16  # flag of a vertex that is only a control point
HIGHEST_DEGREE = 25  # of a spline, as drawing programs allow


def segments(entity: Any, place: "Matrix44", line: int) -> list[Segment] | None:
    """Segments of an entity, placed in the drawing [m].

    None where it is of a kind that is not taken, as a mesh, or a circle without a radius.

    Raises:
        ToolpathError: an entity that lacks what it needs.
    """
    kind = entity.dxftype()
    missing = [name for name in REQUIRED.get(kind, ()) if not entity.dxf.hasattr(name)]
    if missing:
        raise ToolpathError(f"{at_line(line)}{kind} without {missing[0]}")
    match kind:
        case "LINE":
            return [Line(_seen(place, entity.dxf.start), _seen(place, entity.dxf.end))]
        case "CIRCLE":
            return _turn(entity, place, 0.0, math.tau)
        case "ARC":
            angles = entity.dxf.start_angle, entity.dxf.end_angle
            begin, end = (math.radians(math.fmod(angle, 360.0)) for angle in angles)
            return _turn(entity, place, begin, _sweep(begin, end))
        case "ELLIPSE":
            return _ellipse(entity, place, line)
        case "LWPOLYLINE":
            vertices = [(complex(x, y), float(b)) for x, y, b in entity.get_points("xyb")]
            return _bulged(
                vertices, entity.closed, _own(entity, place), float(entity.dxf.elevation)
            )
        case "POLYLINE":
            return _polyline(entity, place)
        case "SPLINE":
            return _spline(entity, place, line)
    return None


def _seen(place: "Matrix44", point: Any) -> Planar:
    """Where a point is seen from above."""
    x, y, _ = place.transform(point)
    return complex(x, y)


def _seen_direction(place: "Matrix44", direction: Any) -> Planar:
    """How a difference of two points is seen from above."""
    x, y, _ = place.transform_direction(direction)
    return complex(x, y)


def _own(entity: Any, place: "Matrix44") -> "Matrix44":
    """Place of an entity's own system, by its extrusion."""
    system = entity.ocs()
    return system.matrix * place if system.transform else place


def _turn(entity: Any, place: "Matrix44", begin: float, sweep: float) -> list[Segment] | None:
    own, radius = _own(entity, place), entity.dxf.radius
    first, second = (_seen_direction(own, axis) for axis in ((radius, 0, 0), (0, radius, 0)))
    return [Arc(_seen(own, entity.dxf.center), first, second, begin, sweep)] if radius > 0 else None


def _ellipse(entity: Any, place: "Matrix44", line: int) -> list[Segment]:
    """Ellipse whose minor axis is at right angles to the extrusion and to the major one."""
    major, normal = entity.dxf.major_axis, entity.dxf.extrusion
    if major.is_null or normal.is_null:
        raise ToolpathError(f"{at_line(line)}ELLIPSE without an axis")
    minor = entity.dxf.ratio * normal.normalize().cross(major)
    begin, end = float(entity.dxf.start_param), float(entity.dxf.end_param)
    sweep, begin = _sweep(begin, end), math.fmod(begin, math.tau)
    first, second = (_seen_direction(place, axis) for axis in (major, minor))
    return [Arc(_seen(place, entity.dxf.center), first, second, begin, sweep)]


def _polyline(entity: Any, place: "Matrix44") -> list[Segment] | None:
    """Polyline of two dimensions or three; None for meshes."""
    if not (entity.is_2d_polyline or entity.is_3d_polyline):
        return None
    corners = [vertex.dxf for vertex in entity.vertices if not vertex.dxf.flags & FRAME]
    if entity.is_3d_polyline:
        points = [_seen(place, corner.location) for corner in corners]
        return [Line(*ends) for ends in _pairs(points, entity.is_closed)]
    plane = [(complex(c.location.x, c.location.y), c.get("bulge", 0.0)) for c in corners]
    height = entity.dxf.elevation.z if entity.dxf.hasattr("elevation") else 0.0
    return _bulged(plane, entity.is_closed, _own(entity, place), height)


def _spline(entity: Any, place: "Matrix44", line: int) -> list[Segment]:
    """NURBS of any degree, or a cubic through fit points; a curve for each interval."""
    control = [_seen(place, point) for point in entity.control_points]
    if not control:
        return _through_points(entity, place, line)
    degree, knots = entity.dxf.degree, np.array(entity.knots)
    weights = np.array(list(entity.weights) or [1.0] * len(control))
    fault = _spline_fault(degree, knots, len(control), weights)
    if fault:
        raise ToolpathError(f"{at_line(line)}SPLINE {fault}")
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


def _through_points(entity: Any, place: "Matrix44", line: int) -> list[Segment]:
    """Cubic spline over the chord length through the fit points, with the end tangents given."""
    fit = [_seen(place, point) for point in entity.fit_points]
    points = np.array([p for i, p in enumerate(fit) if i == 0 or p != fit[i - 1]])
    if points.size < 2:
        raise ToolpathError(f"{at_line(line)}SPLINE without control points and fit points")
    if points.size == 2:
        return [Line(points[0], points[1])]
    # imported here: it takes longer than the rest of the library
    from scipy.interpolate import CubicSpline

    chord = np.append(0.0, np.cumsum(np.abs(np.diff(points))))
    ends = []
    for name in ("start_tangent", "end_tangent"):
        tangent = _seen_direction(place, entity.dxf.get(name, (0.0, 0.0, 0.0)))
        unit = tangent / abs(tangent) if tangent else 0.0
        ends.append((1, np.array([unit.real, unit.imag])) if tangent else (2, np.zeros(2)))
    pairs = np.stack([np.real(points), np.imag(points)], axis=1)
    conditions: Any = "periodic" if points[0] == points[-1] and entity.closed else ends
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
    vertices: Sequence[tuple[Planar, float]], closed: bool, own: "Matrix44", height: float
) -> list[Segment]:
    """Lines and arcs between vertices; a bulge is the tangent of a quarter of the arc's angle."""
    stroke: list[Segment] = []
    points = [_seen(own, (p.real, p.imag, height)) for p, _ in vertices]
    places = zip(_pairs([p for p, _ in vertices], closed), _pairs(points, closed), strict=True)
    for ((start, end), seen), (_, bulge) in zip(places, vertices, strict=False):
        if start == end:
            continue
        if abs(bulge) < FLATTEST:
            stroke.append(Line(*seen))
            continue
        centre = 0.5 * (start + end) + 1j * (end - start) * (1 - bulge**2) / (4 * bulge)
        radial = start - centre
        first, second = (
            _seen_direction(own, (side.real, side.imag, 0.0)) for side in (radial, 1j * radial)
        )
        seen_centre = _seen(own, (centre.real, centre.imag, height))
        stroke.append(Arc(seen_centre, first, second, 0.0, 4 * math.atan(bulge)))
    return stroke


def _pairs(points: Sequence[Planar], closed: bool) -> list[tuple[Planar, Planar]]:
    following = [*points[1:], *points[:1]] if closed else points[1:]
    return list(zip(points, following, strict=False))


def _sweep(begin: float, end: float) -> float:
    if not cmath.isfinite(end - begin):
        return math.nan
    sweep = (end - begin) % math.tau
    return math.tau if min(sweep, math.tau - sweep) <= WHOLE else sweep
