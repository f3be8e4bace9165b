"""The G-code of mills (RS-274), interpreted line by line: modal state and moves.

`toolpaths` says what may be in a program.
"""

import math
import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import NamedTuple

from jcontour.geometry.arcs import arcs_between, centre_from_radius
from jcontour.geometry.toolpath_rules import (
    FARTHEST,
    FASTEST,
    INCH,
    MM,
    MOST_MOVES,
    NUMBER,
    SHORTEST,
    ToolpathError,
    shown,
)

LARGEST = 1e9  # of any number in a program

# first and second axis of the plane, then its normal
PLANES = {17: (0, 1, 2), 18: (2, 0, 1), 19: (1, 2, 0)}
MODES = {"motion": (0, 1, 2, 3, 80), "plane": (17, 18, 19), "units": (20, 21), "distance": (90, 91)}
MODE_OF = {float(code): mode for mode, codes in MODES.items() for code in codes}
NO_MOTION_IN = frozenset({40, 49, 54, 61, 64, 91.1, 94})
MACHINE_CODES = frozenset({0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 30})
END = frozenset({2, 30})  # M codes that end the program
WORDS = frozenset("FIJKNRSTXYZ")
NO_MOTION_BY = frozenset("PST")

WORD = re.compile(rf"\s*([A-Za-z])\s*({NUMBER})")
COMMENT = re.compile(r"\([^)]*\)|;.*")

Point = tuple[float, float, float]


class Move(NamedTuple):
    """A line, or an arc or helix where `angle` is not zero (signed, around the plane's normal)."""

    start: Point
    end: Point
    centre: Point
    angle: float
    normal: int
    feed: float
    rapid: bool
    line: int  # of the program


@dataclass
class Interpreter:
    """The modal state of a machine control, and the moves it has made."""

    axes: int
    feed: float | None
    motion: int | None = None
    plane: int = 17
    unit: float = MM
    incremental: bool = False
    at: Point = (0.0, 0.0, 0.0)
    ended: bool = False
    line: int = 0  # that was executed last, from 1
    moves: list[Move] = field(default_factory=list)
    ignored: set[str] = field(default_factory=set)  # words without meaning for the path

    def execute(self, line: str) -> None:
        """Carry out the next line.

        Raises:
            ToolpathError: what cannot be read or traced.
        """
        self.line += 1
        line = COMMENT.sub(" ", line).strip()
        if line in ("", "%") or line.startswith("/"):
            return
        modes, without_motion, machine_codes, values = _words(line)
        self.ignored |= {f"G{code:g}" for code in without_motion}
        self.ignored |= {f"M{code:g}" for code in machine_codes - END}
        self.ignored |= values.keys() & NO_MOTION_BY
        self.unit = {20: INCH, 21: MM}.get(modes.get("units", 0), self.unit)
        self.plane = modes.get("plane", self.plane)
        self.incremental = {90: False, 91: True}.get(modes.get("distance", 0), self.incremental)
        if "motion" in modes:
            self.motion = None if modes["motion"] == 80 else modes["motion"]
        if "F" in values:
            self._set_feed(values["F"])
        if values.keys() & frozenset("XYZIJKR"):
            self._move(values)
        if len(self.moves) > MOST_MOVES:
            raise ToolpathError(f"more than {MOST_MOVES} moves")
        self.ended = bool(machine_codes & END)

    def _set_feed(self, word: float) -> None:
        feed = word * self.unit / 60.0
        if not 0 < feed <= FASTEST:
            raise ToolpathError(
                f"the feed needs to be above 0 and at most {FASTEST:g} m/s, received F{word:g}"
            )
        self.feed = feed

    def _move(self, values: dict[str, float]) -> None:
        target, offset, radius = self._lengths(values)
        if self.motion is None:
            raise ToolpathError("axis words without a motion mode (G0, G1, G2 or G3) before them")
        if self.motion > 0 and self.feed is None:
            raise ToolpathError("a cutting move without a feed (F) before it")
        if self.motion > 1:
            self._arc(target, offset, radius)
        elif offset or radius is not None:
            raise ToolpathError(f"I, J, K and R belong to arcs (G2, G3), not to G{self.motion}")
        else:
            self._trace(target, target, 0.0)

    def _lengths(self, values: dict[str, float]) -> tuple[Point, dict[int, float], float | None]:
        """End point, given centre offsets by axis, and the radius [m]."""
        lengths = {
            letter: values[letter] * self.unit for letter in values.keys() & frozenset("XYZIJKR")
        }
        target = (
            self._coordinate(lengths.get("X"), self.at[0]),
            self._coordinate(lengths.get("Y"), self.at[1]),
            self._coordinate(lengths.get("Z"), self.at[2]),
        )
        if not all(abs(length) <= FARTHEST for length in (*target, *lengths.values())):
            raise ToolpathError(f"a coordinate is farther than {FARTHEST:g} m away")
        offset = {i: lengths[name] for i, name in enumerate("IJK") if name in lengths}
        return target, offset, lengths.get("R")

    def _coordinate(self, word: float | None, at: float) -> float:
        """Coordinate [m] of the end point on an axis at `at` [m], which stays without a word."""
        if word is None:
            return at
        return (at if self.incremental else 0.0) + word

    def _arc(self, target: Point, offset: dict[int, float], radius: float | None) -> None:
        first, second, normal = PLANES[self.plane]
        if normal < 2 and self.axes == 2:
            raise ToolpathError(
                f"an arc in the plane of G{self.plane} needs a third axis: "
                'read the program with axes "XYZ"'
            )
        if bool(offset) == (radius is not None):
            raise ToolpathError("an arc needs either a centre (I, J, K) or a radius (R)")
        if offset.get(normal):
            raise ToolpathError(f"{'IJK'[normal]} is not in the plane of G{self.plane}")
        counter_clockwise = self.motion == 3
        start = complex(self.at[first], self.at[second])
        end = complex(target[first], target[second])
        if radius is None:
            centre = start + complex(offset.get(first, 0.0), offset.get(second, 0.0))
        else:
            centre = centre_from_radius(start, end, radius, counter_clockwise)
        arcs = list(arcs_between(start, end, centre, counter_clockwise))
        rise = target[normal] - self.at[normal]
        slope = rise / sum(angle for _, _, angle in arcs) if abs(rise) >= SHORTEST else 0.0
        for end, centre, angle in arcs:
            level = self.at[normal]
            end_point = _in_space(self.plane, end, level + slope * angle)
            self._trace(end_point, _in_space(self.plane, centre, level), angle)

    def _trace(self, end: Point, centre: Point, angle: float) -> None:
        """Add a move; one too short to see only moves the axes that are not traced."""
        if angle == 0.0 and math.dist(self.at[: self.axes], end[: self.axes]) < SHORTEST:
            self.at = (self.at[0], self.at[1], end[2] if self.axes == 2 else self.at[2])
            return
        rapid = self.motion == 0
        feed = math.nan if rapid or self.feed is None else self.feed
        normal = PLANES[self.plane][2]
        self.moves.append(Move(self.at, end, centre, angle, normal, feed, rapid, self.line))
        self.at = end


def interpreted(lines: Iterable[str], axes: int, feed: float | None) -> Interpreter:
    """Interpreter that has carried out the lines of a program, up to its end (M2, M30).

    >>> program = interpreted(["G1 X1 F600", "X2", "M30", "not read"], axes=2, feed=None)
    >>> len(program.moves)
    2

    Args:
        lines: of the program.
        axes: 3, or 2 for the projection to X and Y.
        feed: in force at the beginning [m/s]; None where the program has to give one.

    Raises:
        ToolpathError: "line 12: ..." for whatever cannot be read or traced.
    """
    interpreter = Interpreter(axes=axes, feed=feed)
    for number, line in enumerate(lines, start=1):
        try:
            interpreter.execute(line)
        except ToolpathError as error:
            raise ToolpathError(f"line {number}: {error}") from None
        if interpreter.ended:
            break
    return interpreter


def _words(line: str) -> tuple[dict[str, int], set[float], set[float], dict[str, float]]:
    """Modal G codes by their group, G codes without motion, M codes, values of the other words."""
    modes, others, machine_codes, values = {}, set(), set(), {}
    position = 0
    while position < len(line):
        match = WORD.match(line, position)
        if not match:
            raise ToolpathError(f"cannot read {shown(line[position:])}")
        position = match.end()
        letter, value, word = match[1].upper(), float(match[2]), match[0]
        if not abs(value) <= LARGEST:
            raise ToolpathError(f"the number in {shown(word)} is too large")
        if letter == "G" and value in MODE_OF:
            if MODE_OF[value] in modes:
                raise ToolpathError(
                    f"{shown(word)} and another G code of its kind ({MODE_OF[value]}) in one line"
                )
            modes[MODE_OF[value]] = int(value)
        elif letter == "G" and value in NO_MOTION_IN:
            others.add(value)
        elif letter == "M" and value in MACHINE_CODES:
            machine_codes.add(value)
        elif letter in WORDS or (letter == "P" and 64 in others):
            if letter in values:
                raise ToolpathError(f"{letter} is given twice")
            values[letter] = value
        else:
            known = letter in "GM"
            raise ToolpathError(
                f"{shown(word)} is not supported" if known else f"unknown word {shown(word)}"
            )
        if letter in "NST" and (value < 0 or value % 1):
            raise ToolpathError(
                f"{shown(word)}: {letter} needs a whole number that is not negative"
            )
    return modes, others, machine_codes, values


def _in_space(plane: int, point: complex, level: float) -> Point:
    """Point in space from its place in a plane and its level along the plane's normal."""
    first, second, normal = PLANES[plane]
    coordinates = {first: point.real, second: point.imag, normal: level}
    return coordinates[0], coordinates[1], coordinates[2]
