"""Modes of a machine control, and end points that words ask for under them."""

import math
from dataclasses import dataclass

from jcontour.geometry.gcode.move import Point, check_near
from jcontour.geometry.toolpath_rules import INCH, MM, ToolpathError


@dataclass(slots=True)
class Modes:
    """Modes in force, with those that a control has when it is switched on.

    Attributes:
        plane: code of the plane of arcs and cycles, G17, G18 or G19, in tenths.
        unit: length of one [m].
        unit_said: whether the program has said so.
        incremental: whether end points count from the start of the move.
        absolute_centres: whether centres of arcs do not.
        inverse_time: whether F is one over the minutes of a move.
        to_r_plane: whether cycles go back to R only.
        feed: speed along the path [m/s], None before the first F.
        path: code of how joints of moves are passed: G61 stops in corners, G61.1 after every move.
    """

    plane: int = 170
    unit: float = MM
    unit_said: bool = False
    incremental: bool = False
    absolute_centres: bool = False
    inverse_time: bool = False
    to_r_plane: bool = False
    feed: float | None = None
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


def target(values: dict[str, float], here: Point, modes: Modes) -> Point:
    """End point [m] that the letters X, Y, Z or @ and ^ say, seen from `here` [m].

    >>> target({"X": 5.0, "Z": 1.0}, (1e-3, 2e-3, 0.0), Modes())
    (0.005, 0.002, 0.001)

    Raises:
        ToolpathError: it is too far away, or @ or ^ comes with X or Y.
    """
    x, y, z = here
    unit = modes.unit
    if "@" in values or "^" in values:
        if "X" in values or "Y" in values:
            raise ToolpathError("@ and ^ beside X or Y")
        radius, angle = math.hypot(x, y), math.atan2(y, x)
        if "@" in values:
            length = values["@"] * unit
            radius = length + (radius if modes.incremental else 0.0)
        if "^" in values:
            turn = math.radians(values["^"])
            angle = turn + (angle if modes.incremental else 0.0)
        x, y = radius * math.cos(angle), radius * math.sin(angle)
    elif modes.incremental:
        x += values.get("X", 0.0) * unit
        y += values.get("Y", 0.0) * unit
    else:
        x = values["X"] * unit if "X" in values else x
        y = values["Y"] * unit if "Y" in values else y
    if "Z" in values:
        z = values["Z"] * unit + (z if modes.incremental else 0.0)
    check_near((x, y, z))
    return x, y, z
