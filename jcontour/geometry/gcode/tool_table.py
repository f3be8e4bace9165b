"""Tool tables of LinuxCNC: `T1 P1 D6.0 Z25.4 ; a comment`, a tool a line, in millimetres."""

import re
from os import PathLike
from typing import NamedTuple

from jcontour.geometry.gcode.move import ZERO, Point
from jcontour.geometry.toolpath_rules import MM, NUMBER, ToolpathError, shown
from jcontour.geometry.toolpath_text import lines_of, read_program

WORD = re.compile(rf"([A-Za-z])\s*({NUMBER})\s*")
KNOWN = frozenset("TPXYZABCUVWDIJQ")


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
        words = {letter.upper(): float(value) for letter, value in WORD.findall(text)}
        if not text:
            continue
        if WORD.sub("", text) or not words.keys() <= KNOWN or words.get("T", 0.5) % 1:
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
