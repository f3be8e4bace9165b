"""The reader of G-code beside LinuxCNC's interpreter, move by move."""

import json
import math
import re
import shutil
import subprocess
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from jcontour.geometry.gcode.modes import read_tool_table
from jcontour.geometry.gcode.moves import Move, Stop
from jcontour.geometry.gcode.programs import interpreted
from jcontour.geometry.toolpath_rules import MM, ToolpathError
from tests.linuxcnc.random_contours import compensated_contour
from tests.linuxcnc.random_programs import Author

PYTHON = Path("/usr/bin/python3")  # the one that Debian's LinuxCNC has its modules in
CANON = Path(__file__).with_name("canonical_moves.py")
pytestmark = pytest.mark.skipif(
    shutil.which("rs274") is None or not PYTHON.exists(),
    reason="LinuxCNC is not installed (Debian: linuxcnc-uspace)",
)

NEAR = 1e-9  # [mm]
PLACE = 1e-6  # [mm] of a centre that ends off its circle move, and of moves without length

CONSTRUCTS = """
G0 X1 Y2 Z3
G1 X1 F60; G0 Y2; X3
G53 G1 X1 F100
G2 X4 Y0 R3; G3 X0 R-3; G2 X1 Y1 R1 P2
G18 G2 X1 I.5 Y3 P2; G19 G3 Y5 J1 K0; G17 G3 I4 Z2
G90.1 G2 X4 Y0 I2 J0; G91.1 G3 X8 I2
G91 G1 X1; G2 X2 I1; G90 G1 X0
G20 G1 X1; G21 X1
G92 X5 Y1; G0 X0; G92.2; X0; G92.3; X0; G92.1; X0
G52 X1; G0 X0; G92.1; X0
G92 X1 Y2; G10 L20 P1 X0; G0 X0 Y0
G10 L2 P0 X1; G0 X0; G10 L20 P0 X1; X0
G10 L2 P1 R45; G92 X3; G0 X1 Y1; G92.1; X1; G28.1; X9 Y9; G28 Y2
G10 L2 P9 Y3; G59.3 G0 Y0; G54 Y0
G43.1 X1 Y2 Z3; G43.1 X5; G0 X0 Y0 Z0; G49; X0; G43.1 X3; Y0 Z0
G28.1; G92 X5; G28 X1 Y2; G30.1; G0 X9 Y9; G91 G30 X1; G28
G4 P1; G0 X1; G4 P.5
G1 X1; G4 P1 X2
G98 G0 Z5; G81 X1 Z-1 R1 L2; X2 Z-2; R3 X4; G80
G99 G0 Z5; G82 X1 Z-1 R1 P.5 L3; Y2
G98 G0 Z5; G83 X1 Z-3 R1 Q1; Q.7 X2
G99 G0 Z-5; G73 X1 Z-3 R1 Q1; X2
M4 G98 G74 X1 Z-1 R1; M3 G84 X2 Z-1 R1
G98 G85 X1 Z-1 R1; X2
M3 G98 G86 X1 Z-1 R1 P0; X2; G89 X3 Z-1 R1 P1
G91 G98 G0 Z5; G81 X1 Z-1 R1 L2
G18 G98 G81 X1 Y-1 R1; Z3; G19 G99 G82 Y4 X-2 R0 P0
#1=2 #2=#1; G0 X#2; #2=#1; G0 Y#2 Z##1
#1=round[-0.5] #2=fup[-1.5] #3=fix[-1.5]; G0 X#1 Y#2 Z#3
G0 X[1 mod 0.3] Y[2**3**2] Z[-2**2]
G0 X[1 eq 1.0000005] Y[5 le 5] Z[exists[#<a>]]
G0 X[acos[0.5]] Y[atan[-1]/[-1]] Z[exp[1]]
G0 X[ln[2]] Y[sqrt[2]] Z[tan[45]]; X[asin[.5]] Y[cos[60]] Z[abs[-2]]
G0 X[1 and 0 or 1] Y[1 xor 1] Z[7 mod -3]
G0 X--1 Y-[2] Z-#1; X+#5420
G1 X5; G0 Z[#<_x> + #<_feed> + #<_plane> + #5220]
#<_q>=3 #<a>=4; o<b> sub; G0 X#1 Y#<_q>; o<b> endsub [7]; o<b> call [3]; G0 X#<_value>
o1 sub; o1 if [#1 gt 0]; G91 G0 X1; o1 return [1]; o1 endif; G0 Y1; o1 endsub; o1 call [1]; o1 call
o1 if [0]; G0 X1; o1 elseif [1]; G0 X2; o1 else; G0 X3; o1 endif
o1 repeat [3]; G91 G0 X1; o1 endrepeat
#1=0; o1 while [#1 lt 4]; #1=[#1+1]; o2 if [#1 eq 2]; o1 continue; o2 endif; G0 X#1; o1 endwhile
#1=0; o1 do; #1=[#1+1]; o2 if [#1 eq 3]; o1 break; o2 endif; G0 X#1; o1 while [#1 lt 9]
M98 P1 L2; M2; O1; G91 G0 X1; M99
M3 S9; G1 X1 M8; M62 P1 X2; M5 M9
G61 G1 X1; G61.1 Y1; G64 P.1 X2; G64 P.1 Q.1
n10 g0x1(a)y1; G0 X2 ; (x); /G0 X3; G00 X04.; N5
G0 X 1 . 5 Y- 2
%; G0 X1; %; G0 X2
"""

ACCEPTED_HERE = {  # what LinuxCNC refuses, and why it is read here
    "X1": "grbl and Mach begin in G0; it is told",
    "G4 X2": "the dwell of Fanuc's lathes; it is told",
    "G4": "a dwell without a time is no dwell; it is told",
    "G70;G0 X1": "inches of other controls (there a lathe's cycle)",
    "G50": "cancelling scaling, as G69 and G15 cancel what is not there",
    "G2 X2 I1 K0": "a centre of 0 along the plane's normal says nothing",
    "G91 G53 G0 X1": "G53 is absolute whatever G91 says",
    "G0 X1 (a (b) c)": "comments of older posts are nested",
    "M3 G88 X1 Z-1 R1": "a cycle without a dwell dwells for no time",
    "G81 X1 Z-1 R1;G85 X2": "another cycle keeps the words of the one before",
    "G86 X1 Z-1 R1 P0": "no spindle is needed to trace a hole",
    "G0 X1;%;G0 X2": "a % ends a program that began without one",
}
REFUSED_HERE = {  # what LinuxCNC accepts, and why it is not read
    "G5 X1 Y1 I1 J1 P1 Q1": "splines",
    "G7": "a lathe's diameters",
    "o1 repeat [2.5];G0 X1;o1 endrepeat": "half a round has no meaning",
    "G1 X200000": "no machine is that large",
    "G18 G41.1 D4": "compensation beside the XZ plane, of lathes",
    "G93 G1 X9 F2": "inverse time, of machines that turn the part",
    "G1 @5 ^30 F60": "polar end points, which no CAM system writes",
    "M70": "the modal state kept",
    "G41.1 D0": "a tool without a diameter needs no compensation: the D is wrong",
    "G41.1 D4;G1 X10;Y10;X9.5;G2 X19.5 I5": "LinuxCNC runs X9.5 backwards into the contour",
}
OTHERWISE = {  # what both read, but not alike
    "G0 Z5;G81 X1 Z-1 R1": "cycles begin in G98 here, as Fanuc's; LinuxCNC begins in G99",
}


class Step(NamedTuple):
    """A move or a dwell as both sides show it.

    Attributes:
        kind: rapid, line, arc or dwell.
        end: place [mm].
        centre: of an arc, in its plane [mm].
        amount: angle of an arc [rad], seconds of a dwell.
        line: of the program.
    """

    kind: str
    end: tuple[float, ...]
    centre: tuple[float, ...] = ()
    amount: float = 0.0
    line: int = 0


def joined(steps: list[Step]) -> list[Step]:
    """Arcs of one line around one centre as one: turns, and halves of an arc off its circle."""
    kept: list[Step] = []
    for step in steps:
        last = kept[-1] if kept else None
        if (
            last is not None
            and last.kind == step.kind == "arc"
            and last.line == step.line
            and len(last.centre) == len(step.centre)
            and math.dist(last.centre, step.centre) < 1e-2
        ):
            kept[-1] = step._replace(amount=last.amount + step.amount, centre=last.centre)
        else:
            kept.append(step)
    return kept


def in_plane(point, normal: int) -> tuple[float, ...]:
    return tuple(value for axis, value in enumerate(point) if axis != normal)


def read(program: str) -> list[Step]:
    """Steps as the reader has them."""
    machine = interpreted(program.split("\n"), 3, None)
    moves = [(number, 1, move) for number, move in enumerate(machine.moves)]
    rests = [(stop.after, 0, stop) for stop in machine.tracer.stops if stop.lasting]
    return joined([step(each) for *_, each in sorted(moves + rests, key=lambda one: one[:2])])


def step(each: Move | Stop) -> Step:
    """One of them."""
    if isinstance(each, Stop):
        return Step("dwell", (), (), each.lasting, each.line)
    end, centre = (tuple(length / MM for length in point) for point in (each.end, each.centre))
    if not each.angle:
        return Step("rapid" if each.rapid else "line", end, (), 0.0, each.line)
    return Step("arc", end, in_plane(centre, each.normal), each.angle, each.line)


def canonical(moves: list) -> list[Step]:
    """Steps as LinuxCNC has them; those without length are left out."""
    steps: list[Step] = []
    at = (0.0, 0.0, 0.0)
    for kind, end, centre, turns, line in moves:
        if kind == "dwell":
            steps += [Step(kind, (), (), turns, line)] if turns else []
            continue
        if kind == "arc":
            normal, centre = centre
            flat = in_plane(centre, normal)
            begin, last = (complex(*in_plane(p, normal)) - complex(*flat) for p in (at, end))
            if normal == 1:  # from Z to X
                begin, last = (complex(p.imag, p.real) for p in (begin, last))
            angle = math.copysign(1, turns) * math.atan2((last / begin).imag, (last / begin).real)
            angle = angle % math.tau if angle % math.tau > 1e-9 else math.tau
            whole = math.copysign(angle + math.tau * (abs(turns) - 1), turns)
            spirals = abs(abs(begin) - abs(last)) > PLACE  # it meets both ends here: another centre
            steps.append(Step(kind, tuple(end), () if spirals else flat, whole, line))
        elif math.dist(at, end) > PLACE:
            steps.append(Step(kind, tuple(end), (), 0.0, line))
        at = end
    return joined(steps)


def difference(ours: list[Step], theirs: list[Step], near: float = NEAR) -> str | None:
    """First step that is not alike, in words."""
    for mine, other in zip(ours, theirs, strict=False):
        apart = mine.kind != other.kind or math.dist(mine.end, other.end) > near
        if not apart and other.centre:
            apart = math.dist(mine.centre, other.centre) > PLACE
        if apart or abs(mine.amount - other.amount) > (PLACE if other.centre else 1e-2):
            return f"{mine} here, {other} there"
    return None if len(ours) == len(theirs) else f"{len(ours)} steps here, {len(theirs)} there"


@pytest.fixture(scope="module")
def linuxcnc(tmp_path_factory):
    """Interprets programs by LinuxCNC: their steps, and the fault of each or None."""

    def run(programs: list[str]) -> list[tuple[list[Step], str | None]]:
        folder = tmp_path_factory.mktemp("linuxcnc")
        (folder / "in.json").write_text(json.dumps(programs))
        command = [PYTHON, CANON, folder / "in.json", folder / "out.json"]
        subprocess.run(command, check=True, capture_output=True)
        actual = json.loads((folder / "out.json").read_text())
        return [(canonical(each["moves"]), each["error"]) for each in actual]

    return run


def spelled(construct: str) -> str:
    head = [] if construct.startswith("%") else ["F600"]
    return "\n".join([*head, *construct.split(";"), "M2", ""])


def differences(programs: list[str], linuxcnc) -> list[str]:
    actual = []
    for program, (steps, fault) in zip(programs, linuxcnc(programs), strict=True):
        try:
            unlike = difference(read(program), steps) if fault is None else fault
        except ToolpathError as error:
            unlike = str(error)
        actual += [f"{unlike}\n{program}"] if unlike else []
    return actual


def test_random_programs(linuxcnc):
    programs = [Author(seed).program(25) for seed in range(300)]
    actual = differences(programs, linuxcnc)
    assert not actual, f"{len(actual)} differ, the first: {actual[0]}"


def test_constructs(linuxcnc):
    actual = differences([spelled(one) for one in CONSTRUCTS.strip().split("\n")], linuxcnc)
    assert not actual, "\n".join(actual)


def test_cutter_compensation(linuxcnc):
    """Where LinuxCNC tells a gouge, it is refused at that line."""
    programs = [compensated_contour(seed) for seed in range(100)]
    gouges = 0
    for program, (steps, fault) in zip(programs, linuxcnc(programs), strict=True):
        if fault is None:
            assert difference(read(program), steps, near=1e-6) is None, program
        else:
            with pytest.raises(ToolpathError, match="gouging|not larger than the tool's"):
                read(program)
            gouges += 1
    assert 3 <= gouges <= 20


def test_tools_of_a_table(tmp_path):
    """G41 with the tool in the spindle, and with D; `rs274` takes tables for inches."""
    words = "T1 M6;G0 X-10;G41 G1 X0;Y10;X10;G2 X20 Y0 J-10;G1 X0;G40 Y-10;G41 D2 X9;X20;G40 X30"
    program, table = tmp_path / "part.ngc", tmp_path / "tool.tbl"
    program.write_text(spelled(words))
    table.write_text(f"T1 P1 D{4 / 25.4:.12f} ; an end mill\nT2 P7 D{1 / 25.4:.12f}\n")
    printed = subprocess.run(
        ["rs274", "-g", "-t", table, program], capture_output=True, text=True, cwd=tmp_path
    ).stdout
    table.write_text("T1 P1 D4 ; an end mill\nT2 P7 D1\n")
    machine = interpreted(spelled(words).split("\n"), 3, None, tools=read_tool_table(table))
    ends = [[length / MM for length in move.end[:2]] for move in machine.moves]
    actual = re.findall(r"(?:TRAVERSE|FEED)\((\S+), (\S+),", printed)
    np.testing.assert_allclose(ends, [[float(x), float(y)] for x, y in actual], atol=1e-4)


def faults_here(constructs) -> list[str]:
    """Those that the reader refuses."""
    refused = []
    for one in constructs:
        try:
            read(spelled(one))
        except ToolpathError:
            refused.append(one)
    return refused


def test_differences_are_those_listed(linuxcnc):
    faults = [fault for _, fault in linuxcnc([spelled(one) for one in ACCEPTED_HERE])]
    assert None not in faults, dict(zip(ACCEPTED_HERE, faults, strict=True))
    assert faults_here(ACCEPTED_HERE) == []
    theirs = linuxcnc([spelled(one) for one in REFUSED_HERE])
    assert [fault for _, fault in theirs] == [None] * len(REFUSED_HERE)
    assert faults_here(REFUSED_HERE) == list(REFUSED_HERE)
    assert len(differences([spelled(one) for one in OTHERWISE], linuxcnc)) == len(OTHERWISE)
