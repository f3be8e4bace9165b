"""Path data of SVG: the letters M L H V C S Q T A Z and their numbers, as segments.

The grammar and the arcs are those of the W3C's "SVG 2", chapter 9 and appendix B.2.
"""

import cmath
import math
import re

from jcontour.geometry.drawings.affine import Planar
from jcontour.geometry.drawings.segments import Arc, Curve, Line, Segment
from jcontour.geometry.drawings.svg_words import NUMBERS, number
from jcontour.geometry.toolpath_rules import ToolpathError, shown

LETTER = re.compile(r"[\s,]*([a-zA-Z])")
REST = re.compile(r"[\s,]*\Z")  # nothing more
FLAG = re.compile(r"[\s,]*([01])")
COUNTS = {"M": 2, "L": 2, "H": 1, "V": 1, "C": 6, "S": 4, "Q": 4, "T": 2, "A": 7, "Z": 0}
FLAGS = (3, 4)  # places of those among the numbers of A


def path_strokes(data: str, line: int) -> list[list[Segment]]:
    """Subpaths of path data on a line of the file, in user units.

    Raises:
        ToolpathError: a letter or a number that cannot be read.
    """
    pen, at = _Pen(), 0
    while not REST.match(data, at):
        match = LETTER.match(data, at)
        kind = match[1].upper() if match else ""
        if not match or kind not in COUNTS or not (pen.begun or kind == "M"):
            raise ToolpathError(f"line {line}: path data cannot be read from {shown(data[at:])}")
        letter, at = match[1], match.end()
        first = True
        while first or (COUNTS[kind] and NUMBERS.match(data, at)):
            given, at = _given(data, at, kind, line)
            pen.draw(kind if first or kind != "M" else "L", given, letter.islower())
            first = False
    return pen.strokes


def _given(data: str, at: int, kind: str, line: int) -> tuple[list[float], int]:
    given = []
    for i in range(COUNTS[kind]):
        match = (FLAG if kind == "A" and i in FLAGS else NUMBERS).match(data, at)
        if not match:
            raise ToolpathError(
                f"line {line}: {kind} needs {COUNTS[kind]} numbers, received {shown(data[at:])}"
            )
        given.append(number(match[1], line))
        at = match.end()
    return given, at


class _Pen:
    """Where a path is, and what it has drawn."""

    def __init__(self):
        self.strokes: list[list[Segment]] = []
        self.at = self.first = 0j
        self.begun = self.lifted = False
        self.handle: tuple[str, Planar] = "", 0j  # kind of the last curve, its last control point

    def draw(self, kind: str, given: list[float], relative: bool) -> None:
        """Draw what a letter says."""
        origin = self.at if relative else 0j
        if kind == "M":
            self.at = self.first = origin + complex(*given)
            self.begun = self.lifted = True
            self.handle = "", 0j
            return
        if kind == "Z":
            if self.at != self.first:
                self._add(Line(self.at, self.first))
            self.at, self.lifted, self.handle = self.first, True, ("", 0j)
            return
        handle = "", 0j
        if kind == "H":
            end = complex(origin.real + given[0], self.at.imag)
        elif kind == "V":
            end = complex(self.at.real, origin.imag + given[0])
        else:
            end = origin + complex(*given[-2:])
        if kind == "A":
            self._add(arc(self.at, end, given[0], given[1], given[2], given[3] > 0, given[4] > 0))
        elif kind in "CSQT":
            controls = [origin + complex(*given[i : i + 2]) for i in range(0, len(given) - 2, 2)]
            family = "C" if kind in "CS" else "Q"
            if kind in "ST":
                before, place = self.handle
                controls.insert(0, 2 * self.at - place if before == family else self.at)
            self._add(Curve.bezier(self.at, *controls, end))
            handle = family, controls[-1]
        else:
            self._add(Line(self.at, end))
        self.at, self.handle = end, handle

    def _add(self, segment: Segment) -> None:
        if self.lifted:
            self.strokes.append([])
            self.lifted = False
        self.strokes[-1].append(segment)


def arc(
    start: Planar,
    end: Planar,
    rx: float,
    ry: float,
    turned: float,
    large: bool,
    clockwise: bool,
) -> Segment:
    """Arc of an ellipse between two points; radii that do not reach grow until they do.

    Args:
        start: first point.
        end: last point.
        rx: half axis.
        ry: half axis.
        turned: angle of the first half axis [degrees].
        large: the way of more than half a turn.
        clockwise: as it is seen with y downwards; towards larger angles.
    """
    rx, ry = abs(rx), abs(ry)
    if rx == 0 or ry == 0 or start == end:
        return Line(start, end)
    turn = cmath.rect(1.0, math.radians(turned))

    def on_circle(point: Planar) -> Planar:
        own = point / turn
        return complex(own.real / rx, own.imag / ry)

    chord = on_circle(0.5 * (start - end))
    grown = max(1.0, abs(chord))
    ratio = grown / abs(chord) if abs(chord) else 1.0
    height = math.sqrt(max(0.0, ratio * ratio - 1.0))
    centre = 1j * chord * height * (-1 if large != clockwise else 1)
    begin = cmath.phase(chord - centre)
    sweep = (cmath.phase(-chord - centre) - begin) % math.tau
    sweep = sweep if clockwise else sweep - math.tau
    own = complex(centre.real * rx, centre.imag * ry) * turn
    first, second = grown * rx * turn, 1j * grown * ry * turn
    return Arc(0.5 * (start + end) + own, first, second, begin, sweep)
