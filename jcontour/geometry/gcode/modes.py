"""What a control keeps between lines: modes, offsets of the program's origin, and its tool table.

    machine = R(angle) (program + shift) + origin + tool

with the rotation and the origin of the work system in force (G54 ...), the shift of G52 and G92,
and the tool's offset (G43, G43.1), as LinuxCNC has it.
"""

import math
import re
from dataclasses import dataclass, field
from os import PathLike
from typing import NamedTuple

from jcontour.geometry.toolpath_rules import (
    INCH,
    MM,
    NUMBER,
    ToolpathError,
    lines_of,
    read_program,
    shown,
)

Point = tuple[float, float, float]  # [m]
ZERO: Point = (0.0, 0.0, 0.0)
SYSTEMS = 9  # G54 to G59.3
TABLE_WORD = re.compile(rf"([A-Za-z])\s*({NUMBER})\s*")
TABLE_LETTERS = frozenset("TPXYZABCUVWDIJQ")


@dataclass(slots=True)
class Modes:
    """Modes in force, with those that a control has when it is switched on."""

    plane: int = 170  # code of the plane of arcs and cycles, G17, G18 or G19, in tenths
    unit: float = MM  # length of one [m]
    unit_said: bool = False  # whether the program has said so
    incremental: bool = False  # whether end points count from the start of the move
    absolute_centres: bool = False  # whether centres of arcs do not
    to_r_plane: bool = False  # whether cycles go back to R only
    feed: float | None = None  # speed along the path [m/s], None before the first F
    # code of how joints of moves are passed: G61 stops in corners, G61.1 after every move
    path: int = 640

    def switch(self, codes: dict[str, int]) -> None:
        """Put codes in force, by their groups."""
        if "plane" in codes:
            self.plane = codes["plane"]
        if "units" in codes:
            self.unit = INCH if codes["units"] in (200, 700) else MM
            self.unit_said = True
        if "distance" in codes:
            self.incremental = codes["distance"] == 910
        if "centres" in codes:
            self.absolute_centres = codes["centres"] == 901
        if "return" in codes:
            self.to_r_plane = codes["return"] == 990
        self.path = codes.get("path", self.path)


@dataclass
class Offsets:
    """Offsets in force, and those of the work systems that are not [m]."""

    system: int = 1  # number of the work system, 1 for G54
    origins: list[Point] = field(default_factory=lambda: [ZERO] * SYSTEMS)  # of all systems
    # by which each is rotated around Z [rad]
    angles: list[float] = field(default_factory=lambda: [0.0] * SYSTEMS)
    shift: Point = ZERO  # of G52 and G92
    shifted: bool = False  # whether one of them is in force
    tool: Point = ZERO  # offset of the tool
    kept_shift: Point = ZERO  # what G92.3 brings back after G92.2

    @property
    def origin(self) -> Point:
        """Origin of the system in force."""
        return self.origins[self.system - 1]

    @property
    def angle(self) -> float:
        """Rotation of the system in force [rad]."""
        return self.angles[self.system - 1]

    @property
    def none(self) -> bool:
        """Whether program and machine have the same coordinates."""
        return self.origin == self.shift == self.tool == ZERO and not self.angle

    def on_machine(self, point: Point) -> Point:
        """Place of a point of the program on the machine."""
        if self.none:
            return point
        x, y, z = _sum(point, self.shift)
        x, y = _turned(x, y, self.angle)
        return _sum(_sum((x, y, z), self.origin), self.tool)

    def in_program(self, point: Point) -> Point:
        """Coordinates in the program of a point of the machine."""
        if self.none:
            return point
        return _difference(self.in_system(point, self.system), self.shift)

    def in_system(self, point: Point, system: int) -> Point:
        """Coordinates in a work system of a point of the machine, without the shift."""
        x, y, z = _difference(_difference(point, self.origins[system - 1]), self.tool)
        x, y = _turned(x, y, -self.angles[system - 1])
        return x, y, z

    def set_here(self, system: int, values: dict[int, float], at: Point) -> None:
        """Let the machine's place `at` have these coordinates in a system, by axis (G10 L20)."""
        here = _difference(self.in_system(at, system), self.shift)
        x, y, z = _difference(here, replaced(here, values))
        x, y = _turned(x, y, self.angles[system - 1])
        self.origins[system - 1] = _sum(self.origins[system - 1], (x, y, z))

    def shift_to(self, values: dict[int, float], at: Point) -> None:
        """Let the machine's place `at` have these coordinates from now on, by axis (G92)."""
        here = self.in_program(at)
        moved = _difference(here, replaced(here, values))
        self.shift = self.kept_shift = _sum(self.shift, moved)
        self.shifted = True


def _sum(a: Point, b: Point) -> Point:
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def _difference(a: Point, b: Point) -> Point:
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


def _turned(x: float, y: float, angle: float) -> tuple[float, float]:
    if not angle:
        return x, y
    cos, sin = math.cos(angle), math.sin(angle)
    return x * cos - y * sin, x * sin + y * cos


def replaced(point: Point, values: dict[int, float]) -> Point:
    """The point with some coordinates given anew, by axis."""
    return values.get(0, point[0]), values.get(1, point[1]), values.get(2, point[2])


class Tool(NamedTuple):
    """A tool: its diameter, and its offset along the axes (G43) [m]."""

    diameter: float = 0.0
    offset: Point = ZERO


def read_tool_table(path: str | PathLike[str]) -> dict[int, Tool]:
    """Tools of a file, by number.

    Raises:
        ToolpathError: it cannot be read, or a line is no tool.
    """
    tools: dict[int, Tool] = {}
    for number, line in enumerate(lines_of(read_program(path)), start=1):
        text = line.split(";")[0].strip()
        words = {letter.upper(): float(value) for letter, value in TABLE_WORD.findall(text)}
        if not text:
            continue
        if TABLE_WORD.sub("", text) or not words.keys() <= TABLE_LETTERS or words.get("T", 0.5) % 1:
            raise ToolpathError(f"{path}: line {number}: no tool as T1 P1 D6 Z25: {shown(text)}")
        x, y, z, diameter = (words.get(letter, 0.0) * MM for letter in "XYZD")
        tools[int(words["T"])] = Tool(diameter, (x, y, z))
    return tools


def tool_numbered(tools: dict[int, Tool] | None, number: int) -> Tool:
    """Tool of a table.

    Raises:
        ToolpathError: there is no table, no tool or not this one.
    """
    if tools is None:
        raise ToolpathError(
            "cutter compensation needs the tool's diameter: --tool-table, or G41.1 and G42.1 with D"
        )
    if number == 0:
        raise ToolpathError("no tool is in the spindle: T and M6 choose one")
    if number not in tools:
        raise ToolpathError(f"tool {number} is not in the tool table")
    return tools[number]
