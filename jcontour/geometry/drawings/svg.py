"""Drawings in SVG: paths and basic shapes, with groups, transforms, viewports and `use`.

    taken      path, rect, circle, ellipse, line, polyline, polygon; g, a, svg, switch, symbol, use
    left out   text, image, foreignObject; what is hidden by display or visibility; all of a switch
               but the first child whose conditions hold, and other languages than English;
               clipping and masks are not looked at. All these are listed with their count. Style
               sheets are not read
    unit       that of width and height with the viewBox, or the one that is given: the length of a
               user unit. Where the size is in px, of which programs have 72, 90 or 96 in an inch,
               it is that of Inkscape, whose version stands in its files: 90 before 0.92, then 96.
               It is asked for where none of these says it
    axes       y of SVG points down: the drawing is mirrored, its lower left corner is the origin

The tool follows outlines, whatever their stroke and fill. Nothing outside the file is read.
"""

import math
import re
from dataclasses import dataclass, field
from os import PathLike
from typing import NamedTuple

from jcontour.geometry.drawings.drawing import Drawing
from jcontour.geometry.drawings.segments import Affine
from jcontour.geometry.drawings.svg_shapes import (
    PX,
    SHAPES,
    Element,
    length,
    numbers,
    svg_tree,
    transform,
)
from jcontour.geometry.toolpath_rules import INCH, MOST_MOVES, ToolpathError, read_program, shown

VERSION = "inkscape:version"
LANGUAGE = "en"
GROUPS = ("svg", "g", "a", "switch")
LEFT_OUT = ("text", "flowRoot", "image", "foreignObject")  # flowRoot: text of Inkscape
DEEPEST_USE = 32
LENGTH_SAID = re.compile("(mm|cm|Q|in|pt|pc)$")  # units that are no px, whose size differs


def read_svg(path: str | PathLike[str], unit: float | None = None) -> Drawing:
    """Drawing of an SVG file.

    Args:
        path: of the file.
        unit: of a user unit [m], whatever the file says; None for the file's own.

    Raises:
        ToolpathError: "line 12: ..." for whatever cannot be read; a file without a unit where none
            is given.
    """
    root = svg_tree(read_program(path))  # in UTF-8 or one byte a letter: both hold its numbers
    box = _box(root)
    inner = (box[2], box[3]) if box else (math.nan, math.nan)
    size = _size(root, "width", inner[0]), _size(root, "height", inner[1])
    is_said = box is not None and bool(LENGTH_SAID.search(root.text("width")))
    version = re.match(r"([0-9]+)\.([0-9]+)", root.text(VERSION))
    pixels = PX if is_said else None  # length of a px [m]
    if version and not is_said:
        pixels = INCH / 90 if (int(version[1]), int(version[2])) < (0, 92) else PX
    if unit is None and pixels is None:
        raise ToolpathError(
            "the drawing does not say its unit (a width in mm, cm, in, pt or pc, and a viewBox): "
            "give it, as --drawing-unit mm, or px for 1/96 inch"
        )
    by_program = not is_said and pixels is not None and unit in (None, PX)
    if unit is None or by_program:
        view, unit = _viewport(root, *size), pixels or PX
        height = size[1] * (PX / unit if LENGTH_SAID.search(root.text("height")) else 1.0)
    else:
        view = Affine(shift=-complex(box[0], box[1]) if box else 0.0)
        height = inner[1] if box else size[1]
    height = height if math.isfinite(height) else 0.0
    upright = Affine(0.0, unit, 1j * unit * height)
    reader = _Reader({e.attributes["id"]: e for e in root.all() if "id" in e.attributes})
    if by_program:
        name = f"Inkscape {root.text(VERSION).split()[0]}"
        reader.drawing.warnings = (f"{name}: {INCH / unit:.0f} px are read as an inch",)
    place = upright.after(view).after(transform(root))
    setting = _Setting(place, inner if box else size, _is_hidden(root, False))
    for element in root.children:
        reader.draw(element, setting)
    return reader.drawing


class _Setting(NamedTuple):
    """What an element has from those around it."""

    place: Affine  # map of its user units
    whole: tuple[float, float]  # size of its viewport in them
    hidden: bool  # its visibility, unless it has its own
    used: int = 0  # how many `use` deep it is


@dataclass
class _Reader:
    named: dict[str, Element]
    drawing: Drawing = field(default_factory=Drawing)
    visited: int = 0

    def draw(self, element: Element, around: _Setting) -> None:
        """Draw an element with all within it."""
        name = element.name
        self.visited += 1
        if self.visited > MOST_MOVES:
            raise ToolpathError(f"line {element.line}: more than {MOST_MOVES} elements")
        if not _is_drawn(element):
            return
        if not _is_meant(element):
            self.drawing.leave_out(f"{name} for another language or program")
            return
        if name in LEFT_OUT:
            self.drawing.leave_out(name)
            return
        hidden = _is_hidden(element, around.hidden)
        if element.text("display") == "none" or (hidden and name in SHAPES):
            self.drawing.leave_out(f"hidden {name}")
            return
        for kind in ("clip-path", "mask"):
            if element.text(kind, "none") != "none":
                self.drawing.leave_out(kind)
        here = around._replace(place=around.place.after(transform(element)), hidden=hidden)
        if name in SHAPES:
            self._shape(element, here)
        elif name == "use":
            self._use(element, here)
        elif name == "switch":
            self._switch(element, here)
        else:
            if name == "svg":
                here = _nested(element, element, here)
            for child in element.children:
                self.draw(child, here)

    def _shape(self, element: Element, here: _Setting) -> None:
        try:
            for stroke in SHAPES[element.name](element, here.whole):
                self.drawing.add([segment.placed(here.place) for segment in stroke], element.line)
        except OverflowError:
            raise ToolpathError(
                f"line {element.line}: a number is too large to compute with"
            ) from None

    def _switch(self, element: Element, here: _Setting) -> None:
        """Draw the first child whose conditions hold, be it hidden or not."""
        choice = [child for child in element.children if _is_drawn(child)]
        chosen = next((child for child in choice if _is_meant(child)), None)
        for child in choice:
            if child is chosen:
                self.draw(child, here)
            else:
                self.drawing.leave_out(f"{child.name} not chosen by a switch")

    def _use(self, element: Element, here: _Setting) -> None:
        link = element.text("href")
        if not link.startswith("#"):
            self.drawing.leave_out("use of another file")
            return
        target = self.named.get(link[1:])
        if target is None:
            self.drawing.leave_out("use of a missing element")
            return
        if here.used == DEEPEST_USE:
            raise ToolpathError(
                f"line {element.line}: {shown(link)} uses itself, or {DEEPEST_USE} deep"
            )
        here = here._replace(used=here.used + 1)
        if target.name != "symbol":
            x, y = (length(element, n, 0.0, w) for n, w in zip("xy", here.whole, strict=True))
            moved = here.place.after(Affine(shift=complex(x, y)))
            self.draw(target, here._replace(place=moved))
            return
        place, hidden = here.place.after(transform(target)), _is_hidden(target, here.hidden)
        here = _nested(target, element, here._replace(place=place, hidden=hidden))
        for child in target.children:
            self.draw(child, here)


def _is_drawn(element: Element) -> bool:
    """Whether it is anything to be seen; all else defines or describes."""
    return element.name in (*GROUPS, *LEFT_OUT, "use", *SHAPES)


def _is_hidden(element: Element, around: bool) -> bool:
    """Its own visibility where it has one, else that of what is around it."""
    own = element.text("visibility")
    return own != "visible" and (around or own in ("hidden", "collapse"))


def _is_meant(element: Element) -> bool:
    """Whether its conditions hold: of the language, and no extension of SVG."""
    if element.attributes.get("requiredExtensions", "").strip():
        return False
    languages = element.attributes.get("systemLanguage", LANGUAGE).lower().split(",")
    return any(language.strip().split("-")[0] == LANGUAGE for language in languages)


def _nested(inner: Element, placed: Element, here: _Setting) -> _Setting:
    """Viewport of an inner svg or a symbol, placed by its own attributes or those of a `use`."""
    x, y = (length(placed, n, 0.0, w) for n, w in zip("xy", here.whole, strict=True))
    width, height = (
        length(placed, n, length(inner, n, w, w), w)
        for n, w in zip(("width", "height"), here.whole, strict=True)
    )
    box = _box(inner)
    place = here.place.after(Affine(shift=complex(x, y))).after(_viewport(inner, width, height))
    return here._replace(place=place, whole=(box[2], box[3]) if box else (width, height))


def _viewport(element: Element, width: float, height: float) -> Affine:
    """Map of a viewBox into its viewport, by preserveAspectRatio."""
    box = _box(element)
    if box is None:
        return Affine()
    x, y, wide, high = box
    across, down = width / wide, height / high
    align, *how = (element.text("preserveAspectRatio") or "xMidYMid meet").split()
    if align == "none":
        return Affine.matrix(across, 1j * down, -complex(across * x, down * y))
    scale = max(across, down) if how == ["slice"] else min(across, down)
    share = {"Min": 0.0, "Mid": 0.5, "Max": 1.0}
    right = share.get(align[1:4], 0.5) * (width - scale * wide)
    below = share.get(align[5:8], 0.5) * (height - scale * high)
    return Affine(scale, 0.0, complex(right, below) - scale * complex(x, y))


def _box(element: Element) -> tuple[float, float, float, float] | None:
    box = numbers(element, "viewBox")
    if not box:
        return None
    if len(box) != 4 or not (box[2] > 0 and box[3] > 0):
        raise ToolpathError(
            f"line {element.line}: viewBox needs four numbers, the last two above zero"
        )
    return box[0], box[1], box[2], box[3]


def _size(root: Element, name: str, default: float) -> float:
    """Width or height of the drawing [px]; a percentage is of nothing that is known."""
    return default if "%" in root.text(name) else length(root, name, default)
