"""Moves of a G-code program as they were understood, line by line, for `--list-moves`."""

import math
from collections.abc import Iterator
from pathlib import Path

from jcontour.geometry.gcode.move import Move
from jcontour.geometry.gcode.programs import files_beside, interpreted
from jcontour.geometry.toolpath_rules import MM, ToolpathError
from jcontour.geometry.toolpath_text import lines_of, read_program

AXES = "XYZ"
MM_PER_MIN = MM / 60
HEAD = "  line  move      "


def listed_moves(path: Path, axes: int, feed: float | None) -> Iterator[str]:
    """Table of the moves of a program, a line of text for each, in millimetres.

    Args:
        path: of the program.
        axes: 3, or 2 for its projection to X and Y.
        feed: in force at the beginning [m/s]; None where the program has to give one.

    Raises:
        ToolpathError: it is no G-code, or a line of it cannot be read or traced.
    """
    if path.suffix.lower() in (".csv", ".svg", ".dxf"):
        raise ToolpathError(f"list-moves: {path} is no G-code")
    try:
        lines = lines_of(read_program(path))
        machine = interpreted(lines, axes, feed, files_beside(path))
    except ToolpathError as error:
        text = str(error)
        raise ToolpathError(text if str(path) in text else f"{path}: {text}") from None
    named = "".join(f"{axis:>11}" for axis in AXES[:axes])
    yield f"{HEAD}{named}   mm/min"
    for move in machine.moves:
        yield _line(move, axes)
    count = len(machine.moves)
    told = f"; ignored: {', '.join(sorted(machine.ignored))}" if machine.ignored else ""
    yield f"{count} move{'' if count == 1 else 's'}{told}"


def _line(move: Move, axes: int) -> str:
    end = "".join(f"{coordinate / MM + 0.0:11.4f}" for coordinate in move.end[:axes])
    feed = f"{'-':>9}" if move.rapid else f"{move.feed / MM_PER_MIN:9.5g}"
    line = f"{move.line:6d}  {_kind(move):10}{end}{feed}"
    if not move.angle:
        return line
    centre = ", ".join(f"{coordinate / MM + 0.0:.4f}" for coordinate in move.centre[:axes])
    return f"{line}  around {centre} by {math.degrees(move.angle):.4g} degrees"


def _kind(move: Move) -> str:
    if move.angle:
        rises = abs(move.end[move.normal] - move.start[move.normal]) > 0
        return "helix" if rises else "arc"
    return "rapid" if move.rapid else "line"
