"""Cutter compensation worked out by hand, and the lines that refuse it.

`tests/linuxcnc` compares random contours with LinuxCNC's interpreter.
"""

import math
import re

import numpy as np
import pytest

from jcontour.geometry.gcode.modes import Tool, read_tool_table
from jcontour.geometry.gcode.programs import interpreted
from jcontour.geometry.toolpath_rules import ToolpathError

MM = 1e-3
TOOLS = {1: Tool(4 * MM, (0.0, 0.0, 25 * MM)), 7: Tool()}


def moves(program: str, axes: int = 3, tools=TOOLS):
    return interpreted(program.split("\n"), axes, None, tools=tools).moves


def ends(program: str, axes: int = 3) -> list[tuple[float, ...]]:
    return [tuple(round(length / MM, 9) for length in move.end) for move in moves(program, axes)]


def test_a_square_from_outside_and_inside():
    """Arcs around outside corners; inside corners are cut short by the radius."""
    square = "F600 {} G1 X10\nY20\nX30\nY0\nX0\nG40 Y-10"
    program = square.format("T1 M6 G41")
    assert ends(program) == [
        *[(8, 2, 0), (8, 20, 0), (10, 22, 0), (30, 22, 0), (32, 20, 0), (32, 0, 0), (30, -2, 0)],
        *[(0, -2, 0), (0, -10, 0)],
    ]
    turned = [move.angle for move in moves(program) if move.angle]
    np.testing.assert_allclose(turned, [-0.5 * math.pi] * 3)
    assert ends(square.format("G42.1 D4")) == [
        *[(10, -2, 0), (12, 0, 0), (12, 18, 0), (28, 18, 0), (28, 2, 0), (0, 2, 0), (0, -10, 0)]
    ]


def test_two_axes_and_stops_follow_the_corner():
    """What Z and a dwell do in an inside corner is done there."""
    program = "F600 G41.1 D4 G1 X10\nY10\nZ1\nG4 P1\nX0\nG40 Y0"
    assert ends(program)[:3] == [(8, 2, 0), (8, 8, 0), (8, 8, 1)]
    machine = interpreted(program.split("\n"), 2, None)
    assert [move.end[:2] for move in machine.moves][:2] == [(8 * MM, 2 * MM), (8 * MM, 8 * MM)]
    assert {stop.place[:2] for stop in machine.tracer.stops} == {(8 * MM, 8 * MM)}


def test_the_program_goes_on_from_its_own_place():
    """Incremental moves count from the programmed place, also behind G40."""
    assert ends("F600 G41.1 D4 G1 X10\nG91 X10\nG40 X5 Y1\nX1")[1:] == [
        *[(20, 2, 0), (25, 1, 0), (26, 1, 0)]
    ]
    assert ends("F600 G41.1 D4 G1 X10 #1=#<_x>\nX20\n#1=#<_ccomp>\nG40 X#1")[-1][0] == 411


def test_a_tool_offset_is_that_of_the_table():
    assert ends("T1 M6\nG43 G0 Z0\nG49 Z0\nG43 H7 X1") == [(0, 0, 25), (0, 0, 0), (1, 0, 0)]
    assert ends("G43.1 X1 Y2\nG43.1 X5\nG0 X0 Y0") == [(5, 2, 0)]


@pytest.mark.parametrize(
    ("program", "message"),
    [
        ("G41", r"line 1: no tool is in the spindle: T and M6"),
        ("G41 D5", r"line 1: tool 5 is not in the tool table"),
        ("T7 M6\nG41", r"line 2: G41: tool 7 has no diameter in the tool table"),
        ("G41.1", r"line 1: G41.1 needs the tool's diameter, D, which is not 0"),
        ("G18 G41 D1", r"line 1: G41 needs the XY plane \(G17\)"),
        ("G41 D1 F9 G1 X2", r"line 1: the first move of .* 2 mm, is not larger than .* 2 mm"),
        ("G41 D1 F9 G1 X9\nG3 X10 Y1 J1", r"line 2: an inside arc of 1 mm is not larger than"),
        ("G41 D1 F9 G1 X9\nY1\nX0", r"line 3: the tool cannot reach an inside corner without"),
        ("G41 D1\nG42 D1", r"line 2: G42 under the cutter compensation of line 1: G40 ends it"),
        ("G41 D1\nM6 T7", r"line 2: M6 under the cutter compensation of line 1"),
        ("G41 D1\nG81 X1 Z-1 R1", r"line 2: G81 under the cutter compensation"),
        (
            "G41 D1 F9 G1 X9\nG40\nG2 X12 I1.5",
            r"line 3: the first move after G40 needs to be a line",
        ),
        ("G43 H3", r"line 1: tool 3 is not in the tool table"),
    ],
)
def test_what_is_refused_is_told_in_one_line(program, message):
    with pytest.raises(ToolpathError) as caught:
        moves(program)
    assert re.match(message, str(caught.value)), str(caught.value)
    assert len(str(caught.value).splitlines()) == 1


def test_tool_tables(tmp_path):
    path = tmp_path / "tool.tbl"
    path.write_text("; tools\nT1 P1 D4.0 Z+25 ;an end mill\n\nt7 p2\n")
    tools = read_tool_table(path)
    assert tools.keys() == TOOLS.keys()
    assert tools == TOOLS
    for line in ("P1 D4", "T1.5 D4", "T1 D", "T1 D4 F3", "end mill"):
        path.write_text(f"T2 D1\n{line}\n")
        with pytest.raises(ToolpathError, match=r"tool\.tbl: line 2: no tool as T1 P1 D6 Z25"):
            read_tool_table(path)
