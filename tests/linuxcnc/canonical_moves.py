"""Canonical moves of LinuxCNC's interpreter in full precision; run by the Python it comes with.

`rs274` prints four decimals. The module `gcode` hands the same interpreter's calls to an object.

    python3 canonical_moves.py IN OUT

IN holds programs, OUT then [{"moves": ..., "error": ..., "line": ...}, ...].

A move is [kind, place, centre, turns, line] in millimetres of the machine; `turns` of an arc are
those of ARC_FEED, of a dwell its seconds.
"""

import json
import math
import sys
import tempfile
from pathlib import Path

import gcode  # pyright: ignore[reportMissingImports]

MM = 25.4  # the module speaks in inches


class Canon:
    """Calls of the interpreter, kept as moves."""

    def __init__(self, folder):
        self.parameter_file = str(folder / "parameters.var")
        self.moves = []
        self.plane: int = 170
        self.shift = self.origin = self.tool = (0.0, 0.0, 0.0)
        self.angle, self.line, self.end = 0.0, 0, (0.0, 0.0, 0.0)

    def __getattr__(self, name):  # what moves nothing
        if name.startswith("__"):
            raise AttributeError(name)
        return lambda *arguments: None

    def next_line(self, state):
        self.line = state.sequence_number

    def check_abort(self):
        return False

    def get_block_delete(self):
        return True

    def get_external_length_units(self):
        return 1.0

    def get_external_angular_units(self):
        return 1.0

    def get_axis_mask(self):
        return 7

    def get_tool(self, pocket):
        return (-1, *[0.0] * 12, 0)

    def set_g5x_offset(self, index, x, y, z, *others):
        self.origin = x, y, z

    def set_g92_offset(self, x, y, z, *others):
        self.shift = x, y, z

    def set_xy_rotation(self, degrees):
        self.angle = math.radians(degrees)

    def tool_offset(self, x, y, z, *others):
        self.tool = x, y, z

    def set_plane(self, plane: int):
        self.plane = {1: 170, 2: 190, 3: 180}.get(plane, plane)

    def dwell(self, seconds):
        self.moves.append(["dwell", self.end, None, seconds, self.line])

    def _placed(self, x, y, z):
        x, y, z = x + self.shift[0], y + self.shift[1], z + self.shift[2]
        cosine, sine = math.cos(self.angle), math.sin(self.angle)
        x, y = x * cosine - y * sine, x * sine + y * cosine
        place = (x, y, z), self.origin, self.tool
        return [MM * sum(parts) for parts in zip(*place, strict=True)]

    def _move(self, kind, x, y, z, centre=None, turns=0):
        self.end = self._placed(x, y, z)
        self.moves.append([kind, self.end, centre, turns, self.line])

    def straight_traverse(self, x, y, z, *others):
        self._move("rapid", x, y, z)

    def straight_feed(self, x, y, z, *others):
        self._move("line", x, y, z)

    def rigid_tap(self, x, y, z, *others):
        self._move("line", x, y, z)

    def arc_feed(self, first, second, first_centre, second_centre, turns, normal, *others):
        orders = {170: (0, 1, 2), 180: (1, 2, 0), 190: (2, 0, 1)}
        order = orders[self.plane]

        def point(*values):
            return [values[place] for place in order]

        centre = self._placed(*point(first_centre, second_centre, normal))
        axis = order.index(2)
        self._move("arc", *point(first, second, normal), [axis, centre], turns)


def interpreted(program):
    """Moves of a program, and the message of the interpreter where it stops."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "program.ngc").write_text(program)
        (folder / "parameters.var").touch()
        canon = Canon(folder)
        code, line = gcode.parse(str(folder / "program.ngc"), canon, "G21", "", "")
    error = gcode.strerror(code) if code > gcode.MIN_ERROR else None
    return {"moves": canon.moves, "error": error, "line": line}


if __name__ == "__main__":
    source, result = map(Path, sys.argv[1:])
    result.write_text(json.dumps([interpreted(each) for each in json.loads(source.read_text())]))
