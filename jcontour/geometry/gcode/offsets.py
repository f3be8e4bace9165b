"""Where the program's origin lies on the machine: G54 to G59.3, G10, G52, G92 and tool offsets.

    machine = R(angle) (program + shift) + origin + tool

with the rotation and the origin of the work system in force (G54 ...), the shift of G52 and G92,
and the tool's offset (G43.1), as LinuxCNC has it.
"""

import math
from dataclasses import dataclass, field

from jcontour.geometry.gcode.move import ZERO, Point

SYSTEMS = 9  # G54 to G59.3


@dataclass
class Offsets:
    """Offsets in force, and those of the work systems that are not [m].

    Attributes:
        system: number of the work system, 1 for G54.
        origins: of all systems.
        angles: by which each is rotated around Z [rad].
        shift: of G52 and G92.
        shifted: whether one of them is in force.
        tool: offset of the tool.
        kept_shift: what G92.3 brings back after G92.2.
    """

    system: int = 1
    origins: list[Point] = field(default_factory=lambda: [ZERO] * SYSTEMS)
    angles: list[float] = field(default_factory=lambda: [0.0] * SYSTEMS)
    shift: Point = ZERO
    shifted: bool = False
    tool: Point = ZERO
    kept_shift: Point = ZERO

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
        x, y, z = _sum(point, self.shift)
        x, y = _turned(x, y, self.angle)
        return _sum(_sum((x, y, z), self.origin), self.tool)

    def in_program(self, point: Point) -> Point:
        """Coordinates in the program of a point of the machine."""
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
