"""Elements of an SVG file, each with its line, and their shapes, transforms, lengths and numbers.

`svgelements` reads path data and transforms. It passes over what it does not know: the grammar is
checked first. Nothing outside the file is ever read.
"""

import math
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any
from xml.parsers import expat

from jcontour.geometry.drawings.segments import Affine, Arc, Curve, Line, Segment
from jcontour.geometry.toolpath_rules import MOST_MOVES, ToolpathError, shown

SVG = "http://www.w3.org/2000/svg"
INKSCAPE = "http://www.inkscape.org/namespaces/inkscape"
DEEPEST = 200  # elements in elements
NUMBER = r"[+-]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]+)?"
NUMBERS = re.compile(rf"(?:[\s,]*{NUMBER})*[\s,]*")
LENGTH = re.compile(rf"({NUMBER})\s*([a-zA-Z%]*)")
PATH = re.compile(rf"(?:[\s,]*(?:[MmLlHhVvCcSsQqTtAaZz]|{NUMBER}))*[\s,]*")
KINDS = "matrix|translate|scale|rotate|skewX|skewY"
TRANSFORM = re.compile(rf"(?:[\s,]*(?:{KINDS})\s*\((?:[\s,]*{NUMBER})+[\s,]*\))*[\s,]*")
PX = 25.4e-3 / 96  # [m] of CSS
IN_PX = {
    "": 1.0,
    "px": 1.0,
    "pt": 96 / 72,
    "pc": 16.0,
    "in": 96.0,
    "mm": 96 / 25.4,
    "cm": 960 / 25.4,
    "Q": 24 / 25.4,
}
FAULTS = (ValueError, TypeError, IndexError, ZeroDivisionError)  # of words that are wrong


@dataclass
class Element:
    """An element of a file."""

    name: str  # without its namespace; empty for one of another language
    line: int  # of the file
    # by name, those of other languages by their last part, those of Inkscape as `inkscape:version`
    attributes: dict[str, str]
    children: list["Element"] = field(default_factory=list)  # in order

    def text(self, name: str, default: str = "") -> str:
        """An attribute, or its property in `style`."""
        for entry in self.attributes.get("style", "").split(";"):
            key, _, value = entry.partition(":")
            if key.strip() == name:
                return value.strip()
        return self.attributes.get(name, default).strip()

    def all(self) -> Iterator["Element"]:
        """The element and all within it."""
        yield self
        for child in self.children:
            yield from child.all()


def svg_tree(text: str) -> Element:
    """Root element of a file.

    Raises:
        ToolpathError: "line 12: ..." for broken XML, an entity outside the file, elements that are
            too many or too deep, or another root.
    """
    reader = _Reader()
    # the text is decoded already, whatever encoding it states
    parser = expat.ParserCreate("UTF-8", " ")
    parser.StartElementHandler = lambda name, given: reader.start(
        name, given, parser.CurrentLineNumber
    )
    parser.EndElementHandler = lambda name: reader.open.pop()
    parser.EntityDeclHandler = lambda name, parameter, value, *_: _check_inside(
        name, value, parser.CurrentLineNumber
    )
    try:
        parser.Parse(text.encode("utf-8", "surrogatepass"), True)
    except expat.ExpatError as error:
        fault = expat.errors.messages[error.code]
        raise ToolpathError(f"line {error.lineno}: broken XML: {fault}") from None
    if reader.root is None or reader.root.name != "svg":
        raise ToolpathError("not an SVG file: its root is no svg element")
    return reader.root


class _Reader:
    def __init__(self):
        self.root: Element | None = None
        self.open: list[Element] = []
        self.count = 0

    def start(self, name: str, given: dict[str, str], line: int) -> None:
        self.count += 1
        if self.count > MOST_MOVES:
            raise ToolpathError(f"line {line}: more than {MOST_MOVES} elements")
        if len(self.open) == DEEPEST:
            raise ToolpathError(f"line {line}: elements more than {DEEPEST} deep")
        space, _, last = name.rpartition(" ")
        attributes = {}
        for key, value in given.items():
            namespace, _, own = key.rpartition(" ")
            attributes[f"inkscape:{own}" if namespace == INKSCAPE else own] = value
        element = Element(last if space in ("", SVG) else "", line, attributes)
        if self.open:
            self.open[-1].children.append(element)
        else:
            self.root = element
        self.open.append(element)


def _check_inside(name: str, value: str | None, line: int) -> None:
    if value is None:
        raise ToolpathError(
            f"line {line}: the entity {shown(name)} is outside the file and is not read"
        )


def length(element: Element, name: str, default: float = 0.0, whole: float = math.nan) -> float:
    """A length; a percentage is of `whole`.

    Raises:
        ToolpathError: it is none, or too large.
    """
    text = element.text(name)
    if not text or text == "auto":
        return default
    match = LENGTH.fullmatch(text)
    if match and match[2] in IN_PX:
        return _number(match[1], element.line, IN_PX[match[2]])
    if match and match[2] == "%" and math.isfinite(whole):
        return _number(match[1], element.line, 0.01 * whole)
    raise ToolpathError(
        f"line {element.line}: {name} needs a length in px, mm, cm, in, pt or pc, "
        f"received {shown(text)}"
    )


def numbers(element: Element, name: str) -> list[float]:
    """Numbers of an attribute, with spaces or commas between them.

    Raises:
        ToolpathError: something else is among them, or one is too large.
    """
    text = element.text(name)
    _check(NUMBERS, text, f"line {element.line}: {name} needs numbers, received")
    return [_number(number, element.line) for number in re.findall(NUMBER, text)]


def transform(element: Element) -> Affine:
    """The map of a transform: the last of its list acts first.

    Raises:
        ToolpathError: an unknown one, or with other numbers than it takes.
    """
    text = element.text("transform")
    if not text:
        return Affine()
    # imported here, as only drawings need it
    from svgelements import Matrix

    fault = f"line {element.line}: transform cannot be read from"
    _check(TRANSFORM, text, fault)
    try:
        m = Matrix(text)
    except FAULTS:
        raise ToolpathError(f"{fault} {shown(text)}") from None
    affine = Affine.matrix(complex(m.a, m.b), complex(m.c, m.d), complex(m.e, m.f))
    if not affine.finite():
        raise ToolpathError(f"{fault} {shown(text)}")
    return affine


def path_strokes(data: str, line: int) -> list[list[Segment]]:
    """Subpaths of path data on a line of the file.

    Raises:
        ToolpathError: letters or numbers that cannot be read.
    """
    # imported here, as only drawings need it
    from svgelements import Path

    fault = f"line {line}: path data cannot be read from"
    _check(PATH, data, fault)
    if data.strip(" \t\r\n,")[:1] not in ("", "M", "m"):
        raise ToolpathError(f"{fault} {shown(data)}")
    try:
        return _strokes(list(Path(data)))
    except FAULTS:
        raise ToolpathError(f"{fault} {shown(data)}: a letter lacks numbers") from None


def _strokes(parts: Sequence[Any]) -> list[list[Segment]]:
    """Subpaths of parts of a path as `svgelements` has them."""
    # of S and T it takes the control point of whatever curve is before; the standard takes that of
    # one of its own kind only
    strokes, lifted, before, handle = [], True, "", 0j
    for part in parts:
        kind, previous = type(part).__name__, before
        before = kind
        if kind == "Move":
            lifted = True
            continue
        if lifted:
            strokes.append([])
        lifted = kind == "Close"
        start, end = _point(part.start), _point(part.end)
        if kind in ("QuadraticBezier", "CubicBezier"):
            controls = [_point(control) for control in (*part,)[1:-1]]
            if part.smooth:
                controls[0] = 2 * start - handle if previous == kind else start
            strokes[-1].append(Curve.bezier(start, *controls, end))
            handle = controls[-1]
        elif kind == "Arc" and start != end and part.rx and part.ry:
            centre = _point(part.center)
            first, second = _point(part.prx) - centre, _point(part.pry) - centre
            strokes[-1].append(Arc(centre, first, second, part.get_start_t(), part.sweep))
        elif start != end:
            strokes[-1].append(Line(start, end))
    return [stroke for stroke in strokes if stroke]


def _point(point: Any) -> complex:
    return complex(point.x, point.y)


def _rectangle(element: Element, whole: tuple[float, float]) -> list[list[Segment]]:
    from svgelements import Rect

    x, width, rx = (
        length(element, name, default, whole[0])
        for name, default in (("x", 0.0), ("width", 0.0), ("rx", -1.0))
    )
    y, height, ry = (
        length(element, name, default, whole[1])
        for name, default in (("y", 0.0), ("height", 0.0), ("ry", -1.0))
    )
    if not (width > 0 and height > 0):
        return []
    rx, ry = (rx if rx >= 0 else max(ry, 0.0)), (ry if ry >= 0 else max(rx, 0.0))
    return _strokes(Rect(x, y, width, height, rx, ry).segments())


def _ellipse(element: Element, whole: tuple[float, float]) -> list[list[Segment]]:
    cx, cy = (length(element, n, 0.0, w) for n, w in zip(("cx", "cy"), whole, strict=True))
    if element.name == "circle":
        rx = ry = length(element, "r", 0.0, math.hypot(*whole) / math.sqrt(2))
    else:
        rx, ry = (length(element, n, -1.0, w) for n, w in zip(("rx", "ry"), whole, strict=True))
        rx, ry = (rx if rx >= 0 else ry), (ry if ry >= 0 else rx)
    if not (rx > 0 and ry > 0):
        return []
    return [[Arc(complex(cx, cy), complex(rx), 1j * ry, 0.0, math.tau)]]


def _line(element: Element, whole: tuple[float, float]) -> list[list[Segment]]:
    x1, x2 = (length(element, n, 0.0, whole[0]) for n in ("x1", "x2"))
    y1, y2 = (length(element, n, 0.0, whole[1]) for n in ("y1", "y2"))
    return [[Line(complex(x1, y1), complex(x2, y2))]]


def _polyline(element: Element, whole: tuple[float, float]) -> list[list[Segment]]:
    given = numbers(element, "points")
    points = [complex(*given[i : i + 2]) for i in range(0, len(given) - 1, 2)]
    if element.name == "polygon":
        points += points[:1]
    return [[Line(*ends) for ends in zip(points, points[1:], strict=False)]]


# strokes of each shape within a viewport of a size
SHAPES: dict[str, Callable[[Element, tuple[float, float]], list[list[Segment]]]] = {
    "path": lambda element, _: path_strokes(element.attributes.get("d", ""), element.line),
    "rect": _rectangle,
    "circle": _ellipse,
    "ellipse": _ellipse,
    "line": _line,
    "polyline": _polyline,
    "polygon": _polyline,
}


def _check(grammar: re.Pattern[str], text: str, fault: str) -> None:
    """Refuse a text from where it leaves its grammar."""
    match = grammar.match(text)
    rest = text[match.end() :] if match else text
    if rest:
        raise ToolpathError(f"{fault} {shown(rest)}")


def _number(text: str, line: int, unit: float = 1.0) -> float:
    value = float(text) * unit
    if not math.isfinite(value):
        raise ToolpathError(f"line {line}: the number {shown(text)} is too large")
    return value
