"""Drawings in DXF, text or binary, of any version, as `ezdxf` reads them.

    taken      LINE, ARC, CIRCLE, ELLIPSE, LWPOLYLINE and POLYLINE with bulges, SPLINE, and INSERT
               of blocks, in blocks too, in arrays, with any scale; in model space, seen from above
    left out   all other kinds, as TEXT, DIMENSION, HATCH and POINT; paper space; what is invisible,
               or on a layer that is off, frozen or never plotted (DEFPOINTS); blocks in other
               files; the clipping of blocks. They are counted by layer. A block on a frozen layer
               is left out as a whole; on one that is off, what it has on other layers is seen, as
               in AutoCAD
    unit       $INSUNITS, or the one that is given; it is asked for where neither says

Line types and widths mean nothing here: the tool follows the middle of each line. Entities in their
own systems (OCS) are placed by a matrix; z is left out: a circle that leans is seen as the ellipse
that it looks like.
"""

import cmath
import io
import logging
import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from os import PathLike
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float

from jcontour.geometry.drawings.drawing import Drawing, at_line
from jcontour.geometry.drawings.segments import Arc, Curve, Line, Planar, Segment
from jcontour.geometry.toolpath_rules import (
    INCH,
    MM,
    MOST_MOVES,
    ToolpathError,
    lines_of,
    read_program,
    shown,
)

if TYPE_CHECKING:
    from ezdxf.document import Drawing as Document
    from ezdxf.entities.dxfgfx import DXFGraphic
    from ezdxf.math import Matrix44

UNITS = {  # [m] by $INSUNITS
    1: INCH,
    2: 12 * INCH,
    4: MM,
    5: 10 * MM,
    6: 1.0,
    8: 1e-6 * INCH,
    9: 1e-3 * INCH,
    10: 36 * INCH,
    13: 1e-6,
    14: 0.1,
}
BINARY = "AutoCAD Binary DXF"
UNIT = "$INSUNITS"  # ezdxf takes metres where a file does not say
# ahead of a file that states no version, but has the marks of R13 and later
VERSION = "0\nSECTION\n2\nHEADER\n9\n$ACADVER\n1\nAC1015\n0\nENDSEC\n"
MARK = "AcDbEntity"
END = re.compile(r"\n\s*0\s*\n\s*EOF\s*(\n|$)")
NEVER_PLOTTED = "DEFPOINTS"
DEEPEST = 32  # blocks in blocks
MOST_CELLS = 10_000  # of an array of blocks: more take longer than ten seconds
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


def read_dxf(path: str | PathLike[str], unit: float | None = None) -> Drawing:
    """Drawing of a DXF file.

    Args:
        path: of the file.
        unit: of the drawing [m], whatever the file says; None for the file's own.

    Raises:
        ToolpathError: the file or an entity cannot be read; a file without a unit where none is
            given.
    """
    text = read_program(path)
    document = _document(path, text)
    code = document.header.get(UNIT, 0) if UNIT in text else 0
    unit = unit or UNITS.get(code)
    if unit is None:
        stated = f"is in unit {code} of {UNIT}" if code else f"does not say its unit ({UNIT})"
        raise ToolpathError(f"the drawing {stated}: give it, as --drawing-unit mm")
    from ezdxf.math import Matrix44

    # Lines of a text file at which entities begin, by their handles
    lines, begun, line_of = lines_of(text), 0, {}
    for i in range(0, len(lines) - 1, 2):
        code = lines[i].strip()
        if code == "0":
            begun = i + 2
        elif code == "5":
            line_of.setdefault(lines[i + 1].strip().upper(), begun)
    reader = _Reader(document, line_of)
    reader.draw(document.modelspace(), Matrix44.scale(unit), "0", 0)
    for layout in document.layouts:
        if not layout.is_modelspace:
            for entity in layout:
                reader.leave_out(entity, _stated(entity, "layer", "0"), "in paper space")
    return reader.drawing


def _document(path: str | PathLike[str], text: str) -> "Document":
    """Content of a file; one with faults that move no point is mended."""
    # it warns of handles, which move nothing, and as it is imported of a cache of fonts
    logging.getLogger("ezdxf").setLevel(logging.CRITICAL)
    # imported here: it takes longer than the rest of the library
    from ezdxf import recover
    from ezdxf.filemanagement import read, readfile

    if not text.strip():
        raise ToolpathError("not a DXF file: it is empty")
    try:
        if text.startswith(BINARY):
            return readfile(str(path))
        stated = MARK not in text or "HEADER" in text
        return read(io.StringIO(text if stated else VERSION + text, newline=None))
    except Exception as error:  # of any kind, for a file that is anything
        fault = shown(str(error), 200)[1:-1]
    refusal = ToolpathError(f"the DXF file cannot be read: {fault}")
    if text.startswith(BINARY):
        raise refusal
    if not re.match(r"\s*(0|999)\s*\n", text):
        raise ToolpathError("line 1: not a DXF file, which begins with 0 and SECTION")
    if not END.search(text):
        raise ToolpathError("the file is cut off: there is no EOF")
    try:
        document, auditor = recover.read(io.BytesIO(text.encode("utf-8", "replace")))
    except Exception:
        raise refusal from None
    if auditor.errors:
        raise refusal
    return document


def _stated(entity: "DXFGraphic", name: str, default: Any) -> Any:
    """Attribute of an entity of any kind, known to ezdxf or not."""
    return entity.dxf.get(name, default) if entity.dxf.is_supported(name) else default


@dataclass
class _Reader:
    document: "Document"
    lines: Mapping[str, int]
    drawing: Drawing = field(default_factory=Drawing)
    visited: int = 0

    def __post_init__(self):
        layers = list(self.document.layers)
        self.off = {layer.dxf.name.upper() for layer in layers if layer.is_off()}
        self.frozen = {layer.dxf.name.upper() for layer in layers if layer.is_frozen()}

    def draw(
        self, members: Iterable["DXFGraphic"], place: "Matrix44", layer: str, depth: int
    ) -> None:
        """Draw entities of the drawing, or of a block on a layer."""
        for entity in members:
            self.visited += 1
            line = self.lines.get(entity.dxf.get("handle", ""), 0)
            if self.visited > MOST_MOVES:
                raise ToolpathError(f"{at_line(line)}more than {MOST_MOVES} entities")
            own = _stated(entity, "layer", "0")
            own = layer if own == "0" else own
            reason = self._hidden(entity, own)
            if reason:
                self.leave_out(entity, own, reason)
            elif entity.dxftype() == "INSERT":
                self._insert(entity, place, own, depth, line)
            else:
                drawn = segments(entity, place, line)
                if drawn is None:
                    self.leave_out(entity, own)
                else:
                    self.drawing.add(drawn, line)

    def _insert(self, insert: Any, place: "Matrix44", layer: str, depth: int, line: int) -> None:
        from ezdxf.xclip import XClip

        block, name = insert.block(), shown(insert.dxf.get("name", ""))
        if block is None:
            raise ToolpathError(f"{at_line(line)}there is no block {name}")
        if block.block.is_xref or block.block.is_xref_overlay:
            self.leave_out(insert, layer, "in another file")
            return
        if depth == DEEPEST:
            raise ToolpathError(f"{at_line(line)}block {name} is in itself, or {DEEPEST} deep")
        if insert.mcount > MOST_CELLS:
            columns, rows = insert.dxf.column_count, insert.dxf.row_count
            raise ToolpathError(f"{at_line(line)}an array of {columns} x {rows} blocks")
        if XClip(insert).is_clipping_enabled:
            self.leave_out(insert, layer, "its clipping")
        for cell in insert.multi_insert() if insert.mcount > 1 else [insert]:
            self.draw(block, cell.matrix44() * place, layer, depth + 1)

    def _hidden(self, entity: "DXFGraphic", layer: str) -> str:
        """Why an entity is not seen; empty where it is."""
        if _stated(entity, "invisible", 0):
            return "invisible"
        layer = layer.upper()
        if layer in self.frozen:
            return "frozen"
        if entity.dxftype() == "INSERT":
            return ""
        if layer in self.off:
            return "off"
        return "never plotted" if layer == NEVER_PLOTTED else ""

    def leave_out(self, entity: "DXFGraphic", layer: str, reason: str = "") -> None:
        """Count an entity that is not taken."""
        kind, reason = shown(entity.dxftype())[1:-1], f", {reason}" if reason else ""
        self.drawing.leave_out(f"{kind} (layer {shown(layer)[1:-1]}{reason})")


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
            # Ellipse whose minor axis is at right angles to the extrusion and to the major one
            major, normal = entity.dxf.major_axis, entity.dxf.extrusion
            if major.is_null or normal.is_null:
                raise ToolpathError(f"{at_line(line)}ELLIPSE without an axis")
            minor = entity.dxf.ratio * normal.normalize().cross(major)
            begin, end = float(entity.dxf.start_param), float(entity.dxf.end_param)
            sweep, begin = _sweep(begin, end), math.fmod(begin, math.tau)
            first, second = (_seen_direction(place, axis) for axis in (major, minor))
            return [Arc(_seen(place, entity.dxf.center), first, second, begin, sweep)]
        case "LWPOLYLINE":
            vertices = [(complex(x, y), float(b)) for x, y, b in entity.get_points("xyb")]
            return _bulged(
                vertices, entity.closed, _own(entity, place), float(entity.dxf.elevation)
            )
        case "POLYLINE":
            # Polyline of two dimensions or three; None for meshes
            if not (entity.is_2d_polyline or entity.is_3d_polyline):
                return None
            corners = [vertex.dxf for vertex in entity.vertices if not vertex.dxf.flags & FRAME]
            if entity.is_3d_polyline:
                points = [_seen(place, corner.location) for corner in corners]
                return [Line(*ends) for ends in _pairs(points, entity.is_closed)]
            plane = [(complex(c.location.x, c.location.y), c.get("bulge", 0.0)) for c in corners]
            height = entity.dxf.elevation.z if entity.dxf.hasattr("elevation") else 0.0
            return _bulged(plane, entity.is_closed, _own(entity, place), height)
        case "SPLINE":
            # NURBS of any degree, or a cubic through fit points; a curve for each interval
            control = [_seen(place, point) for point in entity.control_points]
            if not control:
                return _through_points(entity, place, line)
            degree, knots = entity.dxf.degree, np.array(entity.knots)
            weights = np.array(list(entity.weights) or [1.0] * len(control))
            _check_spline(degree, knots, len(control), weights, line)
            # imported here: it takes longer than the rest of the library
            from scipy.interpolate import BSpline

            points = np.array(control)
            homogeneous = np.stack(
                [weights * np.real(points), weights * np.imag(points), weights], axis=1
            )
            spans = np.unique(knots[degree : len(control) + 1])
            return _intervals(BSpline(knots, homogeneous, degree), spans, degree)
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


def _check_spline(
    degree: int, knots: np.ndarray, points: int, weights: np.ndarray, line: int
) -> None:
    fault = ""
    if not 1 <= degree <= HIGHEST_DEGREE:
        fault = f"of degree {degree}"
    elif knots.size != points + degree + 1 or points <= degree:
        fault = f"of degree {degree} with {points} control points and {knots.size} knots"
    elif weights.size != points or not (weights > 0).all():
        fault = "with weights that are not one above zero for each control point"
    elif not (np.diff(knots) >= 0).all() or not knots[degree] < knots[points]:
        fault = "with knots that do not rise"
    if fault:
        raise ToolpathError(f"{at_line(line)}SPLINE {fault}")


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
