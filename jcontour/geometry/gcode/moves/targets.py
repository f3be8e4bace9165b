"""End points of moves in the program: absolute, incremental or polar coordinates."""

import math

from jcontour.geometry.gcode.moves.modes import Modes
from jcontour.geometry.gcode.moves.move import Point
from jcontour.geometry.gcode.moves.tracer import check_near
from jcontour.geometry.toolpath_rules import ToolpathError


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
        x, y = _polar(values, x, y, modes)
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


def _polar(values: dict[str, float], x: float, y: float, modes: Modes) -> tuple[float, float]:
    if "X" in values or "Y" in values:
        raise ToolpathError("@ and ^ beside X or Y")
    radius, angle = math.hypot(x, y), math.atan2(y, x)
    if "@" in values:
        length = values["@"] * modes.unit
        radius = length + (radius if modes.incremental else 0.0)
    if "^" in values:
        turn = math.radians(values["^"])
        angle = turn + (angle if modes.incremental else 0.0)
    return radius * math.cos(angle), radius * math.sin(angle)
