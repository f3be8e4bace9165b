"""Programs of `tests/data/programs` beside their moves worked out by hand; faults in one line."""

import math
import random
import re
from pathlib import Path

import numpy as np
import pytest

from jcontour.geometry.gcode.programs import files_beside, interpreted
from jcontour.geometry.toolpath_rules import FARTHEST, FASTEST, ToolpathError, lines_of

PROGRAMS = Path(__file__).parents[3] / "data" / "programs"
MM = 1e-3
PER_MINUTE = MM / 60

# end points [mm] in order, "r" before those of rapid moves
MOVES = {
    "expressions": "8,1,0 3.5,-2,0 45,5,0 3,1,0 1,1,0 4,0,0 0,1,0 -1,3,.5",
    # a square's sides from (0, 0), then #1 of the caller and the values returned
    "subprograms": "3,0,0 3,3,0 55,3,0 57,3,0 r20,3,0 21,3,0 21,4,0 r-5,4,0",
    "loops": "1,0,0 3,0,0 3,2,0 3,0,0 3,0,-1 3,0,-2",
    "numbered": "r1,0,0 r1,1,0 r1,2,0 r2,2,0 r2,3,0 r3,3,0 r0,0,0",
    "offsets": "r11,21,0 r101,1,0 r106,1,0 r105,1,0 r106,1,0 r100,3,0 r7,8,0 r8,10,0 r0,2,0 "
    "r-1,2,0 r50,50,0 r-1,2,0 r50,2,0 r50,5,0 r50,2,0",
    "cycles": "r0,0,10 r1,0,10 r1,0,1 1,0,-2 r1,0,1 r2,0,1 2,0,-2 r2,0,1 r3,0,10 "
    "r3,0,1 3,0,-2 r3,0,10 r0,0,10 r0,5,10 r0,5,1 0,5,-1 r0,5,1 r0,5,-.746 0,5,-2 r0,5,1 r0,5,3 "
    "r1,5,3 r1,5,1 1,5,-1 r1,5,1 r2,5,1 2,5,-1 r2,5,1 r2,5,5 "
    "r0,0,5 r0,0,2 0,0,-1 0,0,2 r0,0,5 r1,0,5 r1,0,2 1,0,-1 1,0,5",
    "arcs": "r10,0,0 0,10,0 -10,0,0 -10,0,0 -10,0,-2 -10,0,-4 0,0,-4 0,0,-4",
    "safe_start": "r0,0,15 r1.5,-.5,15 1.5,-.5,-1 1.5,2,-1 3,2,-1",
    "by_hand": "r0,0,10 r5,5,10 20,5,10 5,5.5,10",
}
ANGLES = {  # turned [quarter turns], counter-clockwise around the plane's normal
    "arcs": [0, 1, 1, -4, -4, -4, 2, -4],
}
FEEDS = {  # [mm/min] of cutting moves
    "safe_start": [100, 250, 250],
}
DWELLS = {"safe_start": [(1, 2.5)], "cycles": [(37, 0.1)]}  # moves before them, seconds
TOLD = {
    "safe_start": {"G40", "G43", "G50", "G69", "H"}
    | {"M106", "M3", "M5", "M6", "M8", "M9", "S", "T"},
    "numbered": set(),
    "by_hand": {"M0"},
}


def run(name):
    path = PROGRAMS / f"{name}.ngc"
    return interpreted(lines_of(path.read_text()), 3, None, files_beside(path))


def test_every_program_has_its_moves():
    assert {path.stem for path in PROGRAMS.glob("*.ngc")} == MOVES.keys()


@pytest.mark.parametrize("name", MOVES)
def test_moves(name):
    machine = run(name)
    expected = MOVES[name].split()
    ends = [[float(number) for number in end.lstrip("r").split(",")] for end in expected]
    np.testing.assert_allclose([move.end for move in machine.moves], np.array(ends) * MM, atol=1e-9)
    assert [move.rapid for move in machine.moves] == [end.startswith("r") for end in expected]
    starts = [(0.0, 0.0, 0.0), *(move.end for move in machine.moves[:-1])]
    assert [move.start for move in machine.moves] == starts
    turned = np.array([move.angle for move in machine.moves]) / (0.5 * math.pi)
    np.testing.assert_allclose(turned, ANGLES.get(name, [0] * len(ends)), atol=1e-12)
    if name in FEEDS:
        feeds = [move.feed for move in machine.moves if not move.rapid]
        np.testing.assert_allclose(feeds, np.array(FEEDS[name]) * PER_MINUTE, rtol=1e-12)
    dwells = [(stop.after, stop.lasting) for stop in machine.tracer.stops if stop.why == "G4"]
    assert dwells == DWELLS.get(name, [])
    if name in TOLD:
        assert machine.ignored == TOLD[name]


def test_centres_of_arcs():
    centres = [move.centre for move in run("arcs").moves if move.angle]
    expected = [(0, 0, 0), (0, 0, 0), (-5, 0, 0), (-5, 0, 0), (-5, 0, -2), (-5, 0, -4), (0, 0, -2)]
    np.testing.assert_allclose(centres, np.array(expected) * MM, atol=1e-15)


def moves(program, axes=3):
    return interpreted(program.split("\n"), axes, None).moves


def ends(program: str) -> list[list[float]]:
    """End points of the moves of a program [mm]."""
    return [[round(length / MM, 9) for length in move.end] for move in moves(program)]


def test_a_subprogram_begins_with_its_arguments_and_zeros():
    """#1 to #30 are its own; one that M98 calls has those of its caller."""
    caller = "#1=5 #30=6 #31=7\no1 call\nG0 X#1 Y#30 Z#31\n"
    body = "G0 X#1 Y#30 Z#31\n#1=8 #31=9\n"
    assert ends(f"{caller}M2\no1 sub\n{body}o1 endsub") == [[0, 0, 7], [5, 6, 9]]
    called = caller.replace("o1 call", "M98 P1")
    assert ends(f"{called}M2\nO1\n{body}M99") == [[5, 6, 7], [8, 6, 9]]
    given = caller.replace("call", "call [1]")
    assert ends(f"{given}M2\no1 sub\n{body}o1 endsub")[0] == [1, 0, 7]


def test_parameters_that_the_machine_keeps():
    """Whether G92 is in force, its offsets, which G92.2 keeps; a work system's turn; A to W."""
    told = "G53 G0 X#5210 Y#5211 Z[#5212 + #5230]"
    program = f"G10 L2 P1 R30\nG10 L2 P1 R0\nG92 X1 Y2\n{told}\nG92.2\n{told}\nG92.3\n{told}\n"
    assert ends(program) == [[1, -1, -2], [0, -1, -2], [1, -1, -2]]
    assert ends(f"G92 X1 Y2\nG92.1\nG0 Z1\n{told}") == [[0, 0, 1], [0, 0, 0]]
    assert ends(f"G0 X1\nG10 L2 P1 R30\n{told}") == [[1, 0, 0], [0, 0, 30]]
    assert ends("G0 X[1 + #<_c> + #<_abs_a>]") == [[1, 0, 0]]


def test_files_beside_the_program(tmp_path):
    (tmp_path / "side.ngc").write_text("o<side> sub\nG1 X#1 F60\no<side> endsub\nM2\n")
    (tmp_path / "empty.ngc").write_text("G1 X1\n")
    library = files_beside(tmp_path / "part.ngc")
    machine = interpreted(["o<SIDE> call [7]", "o<side> call [8]"], 3, None, library)
    assert [move.end[0] for move in machine.moves] == [7 * MM, 8 * MM]
    assert [move.line for move in machine.moves] == [1, 2]  # those of the calls
    own = ["o1 sub", "G1 X#1 F60", "o<side> call [9]", "o1 endsub", "o1 call [5]", "G1 X6"]
    machine = interpreted(own, 3, None, library)
    assert [move.line for move in machine.moves] == [2, 3, 6]
    (tmp_path / "wrong.ngc").write_text("o<wrong> sub\n\nG51\no<wrong> endsub\n")
    for call, message in (
        ("o<wrong> call", r"wrong\.ngc line 3: 'G51' is not supported"),
        ("o<../side> call", r"line 1: there is no subprogram"),
        ("o<empty> call", r"line 1: empty\.ngc: there is no subprogram o<empty> in it"),
        ("o<none> call", r"line 1: there is no subprogram o<none>"),
    ):
        with pytest.raises(ToolpathError, match=message):
            interpreted([call], 3, None, library)


@pytest.mark.parametrize(
    ("program", "message"),
    [
        ("o1 while [1]\no1 endwhile", r"line 1: .* a loop that does not end"),
        ("o1 do\n#1 = [#1 + 1]\no1 while [1]", r"line \d: .* lines carried out again"),
        (
            "F1 G1 G91\no1 while [1]\n#1=[#1+1] X1\nX-1\no1 endwhile",
            r"line \d: .* lines carried out again",
        ),
        ("M98 P1 L1000000\nM2\nO1\n(nothing)\nM99", r"line \d: .* lines carried out again"),
        ("o1 repeat [1e9]\no1 endrepeat", r"line 1: needs ']' before 'e9\]'"),
        ("o1 sub\no1 call\no1 endsub\no1 call", r"line 2: subprograms call .* more than 10 deep"),
        ("o1 if [1]\nG0 X1", r"line 1: o1 if has no end"),
        ("o1 endif", r"line 1: o1 endif without o1 if"),
        ("o1 if [0]\no1 else\no1 else\no1 endif", r"line 3: o1 else without o1 if"),
        ("o1 while [0]\no2 endwhile", r"line 1: o1 while has no end"),
        ("o1 break", r"line 1: o1 break outside a loop"),
        ("o1 endsub", r"line 1: o1 endsub without o1 sub"),
        ("o1 sub\no2 sub\no2 endsub\no1 endsub", r"line 1: subprogram o2 begins inside o1"),
        ("o1 return", r"line 1: return outside a subprogram"),
        ("o1 sub\nG0 X1", r"line 1: o1 sub has no end"),
        ("o1 call", r"line 1: there is no subprogram o1"),
        ("o1 if\no1 endif", r"line 1: O-word 'if' with 0 values"),
        ("o1 jump", r"line 1: cannot read 'jump'"),
        ("o", r"line 1: an O-word needs a number or a name"),
        ("(ABORT, wrong tool)", r"line 1: the program aborts: 'wrong tool'"),
        ("#<x> = #<y>", r"line 1: parameter '#<y>' is read before it is set"),
        ("#5220 = 1", r"line 1: parameter #5220 is read-only"),
        ("#6000 = 1", r"line 1: parameter #6000: the number needs to be 1 to 5601"),
        ("#1.5 = 1", r"line 1: the number of a parameter needs to be whole"),
        ("#1 = [1 / 0]", r"line 1: a division by zero"),
        ("#1 = sqrt[-1]", r"line 1: a function has no value"),
        ("#1 = [-8 ** 0.5]", r"line 1: a negative number to a power"),
        ("#1 = [9 ** 999]", r"line 1: a result is too large"),
        ("#1 = " + "[" * 300 + "1", r"line 1: an expression is nested more than 50"),
        ("#1 = [1" + "+1" * 300 + "]", r"line 1: more than 200 operations"),
        ("#1 = [2", r"line 1: needs ']' before ''"),
        ("G1 @1 F1", r"line 1: cannot read '@1 F1'"),
        ("G81 X1 Z-1 F1", r"line 1: a canned cycle needs R"),
        ("G81 X1 R1 F1", r"line 1: a canned cycle needs Z"),
        ("G81 X1 Z1 R0 F1", r"line 1: R of a canned cycle lies below"),
        ("G83 X1 Z-1 R1 F1", r"line 1: G83 needs a depth Q above 0"),
        ("G83 X1 Z-1 R1 Q0.00001 F1", r"line 1: G83: more than 10000 pecks"),
        ("G81 X1 Z-1 R1 F1 L0", r"line 1: L of a cycle needs to be 1"),
        ("G81 X1 Z-1 R1 F1 K3", r"line 1: I, J and K do not belong to a canned cycle"),
        ("G5 X1 Y1 I1 J1 P1 Q1", r"line 1: 'G5' is not supported"),
        ("G8 P1", r"line 1: 'G8' is not supported"),
        ("M97 P1", r"line 1: 'M97' is not supported"),
        ("M98 P1\nM2\nO1\nM99 P7", r"line 4: M99 with P goes on at another line"),
        ("G93 G1 X1", r"line 1: 'G93' is not supported"),
        ("M70", r"line 1: 'M70' is not supported"),
        ("F1 G90.1 G2 X2 I1", r"line 1: a centre under G90.1 needs I and J"),
        ("G53 G2 X1 I1 F1", r"line 1: G53 needs G0 or G1"),
        ("G10 L2 P12 X1", r"line 1: G10 needs P0 to P9"),
        ("F1 G10 L2 R30\nG18 G2 X2 I1", r"line 2: an arc in the plane of G18 in a rotated"),
    ],
)
def test_faults_are_told_in_one_line(program, message, monkeypatch):
    monkeypatch.setattr("jcontour.geometry.gcode.programs.MOST_REPEATED", 2000)
    with pytest.raises(ToolpathError) as caught:
        moves(program)
    assert re.match(message, str(caught.value)), str(caught.value)
    assert len(str(caught.value).splitlines()) == 1


BYTES = ["-", "9", ".", "[", "]", "#1", "#<a>", "G2", "G81", "G91", "R", "(", "\n", "é", "o1 call"]
WORD = re.compile(r"[A-Za-z#<>_]*[-.0-9]+")


def mutated(text, chance):
    """Some of its words left out, doubled, moved or with another number."""
    for _ in range(chance.randint(1, 4)):
        one, other = (chance.choice(list(WORD.finditer(text))) for _ in range(2))
        new = chance.choice(["", 2 * one[0], other[0], chance.choice(BYTES), f"{one[0]}7"])
        text = text[: one.start()] + new + text[one.end() :]
    return text


def runs(program, axes):
    """Whether a program runs; where it does its moves are sound, else its fault is one line."""
    try:
        actual = interpreted(lines_of(program), axes, None).moves
    except ToolpathError as error:
        assert len(str(error).splitlines()) == 1 and str(error).startswith("line "), program
        return False
    at = (0.0, 0.0, 0.0)
    for move in actual:
        assert math.dist(at[:axes], move.start[:axes]) < 1e-8, program
        assert all(abs(coordinate) <= FARTHEST for coordinate in (*move.start, *move.end))
        assert math.isnan(move.feed) == move.rapid, program
        assert move.rapid or 0 < move.feed <= 1.01 * FASTEST, program
        assert move.angle or math.dist(move.start[:axes], move.end[:axes]) > 0, program
        at = move.end
    return True


@pytest.mark.parametrize("name", sorted(MOVES))
def test_mutated_programs(name, monkeypatch):
    monkeypatch.setattr("jcontour.geometry.gcode.programs.MOST_REPEATED", 2000)
    chance, text = random.Random(15), (PROGRAMS / f"{name}.ngc").read_text()
    ran = [runs(mutated(text, chance), chance.choice((2, 3))) for _ in range(60)]
    assert 0 < sum(ran) < 60  # both kinds are met


def test_a_loop_that_stands_still_ends_sooner(monkeypatch):
    monkeypatch.setattr("jcontour.geometry.gcode.programs.MOST_STANDING", 100)
    assert len(moves("G91 F1\no1 repeat [500]\nG1 X1\no1 endrepeat")) == 500
    with pytest.raises(ToolpathError, match=r"101 lines carried out again, 101 of them without"):
        moves("G91 F1\no1 repeat [500]\nG4 P1\no1 endrepeat")


def stops_of(program: str, axes: int = 3) -> list[tuple[int, int, str]]:
    machine = interpreted(program.split("\n"), axes, None)
    return [(stop.line, stop.after, stop.why) for stop in machine.tracer.stops]


def test_spindle_tool_coolant_and_pauses_stop():
    """Pauses after the move of their line, the others before it; before any move there is none."""
    program = "M3 S9\nF600 G1 X1\nX2 M8 M4\nX3 M1\nM62 P1 X4\nS9 X5\nM204 S3\nM5 M9\nM30"
    assert stops_of(program) == [(3, 1, "M8 M4"), (4, 3, "M1"), (8, 5, "M5 M9")]


def test_the_users_own_codes_stop_and_fans_do_not():
    program = "F600 G1 X1\nM101\nX2\nM106 S99\nX3\nM52 P1\nX4\nM61 Q1\nX5 M53 P1\nM107 X6"
    assert stops_of(program) == [(2, 1, "M101"), (6, 3, "M52"), (8, 4, "M61")]


@pytest.mark.parametrize("line", ["M104 S200", "m109 s200", "M140 S60", "G1X10Y5E0.3", "X3 E4"])
def test_programs_of_printers_are_refused(line):
    with pytest.raises(ToolpathError, match="line 2: .*programs of 3D printers are not read"):
        moves(f"G1 F600 X1\n{line}")


@pytest.mark.parametrize("line", ["#1=1E3", "X1e-3"])
def test_exponents_are_refused(line):
    with pytest.raises(ToolpathError, match="line 2: cannot read '.*controls know no exponents"):
        moves(f"G1 F600 X1\n{line}")


def test_a_radius_of_a_code_that_moves_nothing_is_told():
    machine = interpreted(["F600 G1 X1", "M19 R90", "G64 P1 R2"], 3, None)
    assert machine.ignored == {"M19", "R"} and len(machine.moves) == 1


def test_changes_of_offsets_stop():
    """Another work system, any tool offset; G92 of an axis, G10 of the system in force."""
    program = "F600 G54 G43 H1 G1 X1\nG54 X2\nG55 X1\nX2\nG49\nG92 E0\nG92 X0\nX5\nG92.1"
    assert [why for *_, why in stops_of(program)] == ["G55", "G49", "G92", "G92.1"]
    program = "F600 G1 X1\nG10 L2 P2 X1\nX2\nG10 L2 P1 X1\nX3\nG10 L1 P1 Z1\nX4\nG59.3"
    stops = stops_of(program)
    assert stops == [(4, 2, "G10"), (6, 3, "G10"), (8, 4, "G59.3")]


def test_messages_stop_as_the_last_comment_of_a_line():
    program = "F600 G1 X1\n(MSG, tool 2)\nX2 ( msg , here )\nX3 (MSG, a)(b)\nX4 (print, a)"
    assert stops_of(program) == [(2, 1, "(MSG)"), (3, 1, "(MSG)")]


def test_exact_stop_after_every_move_until_it_is_switched_off():
    program = "F600 G1 X1\nG61.1 X2\nG2 X4 I1\nG1 G64 X5\nG61.1 X6\nG61 X7"
    stops = stops_of(program)
    assert stops == [(2, 2, "G61.1"), (3, 3, "G61.1"), (5, 5, "G61.1"), (6, 6, "G61")]


def test_two_axes_stand_still_while_z_moves():
    program = "F600 G1 X1\nZ-1\nZ-1\nX2 Z-2\nG0 Z5\nX9"
    assert stops_of(program, axes=2) == [(2, 1, "Z"), (5, 2, "Z")]
    assert stops_of(program) == []


def test_dwells_say_how_long_and_where():
    program = "F600 G1 X1\nG4 P1.5\nG20 G4 X0.5\nG21 X2 G4 P.25\nG4"
    machine = interpreted(program.split("\n"), 3, None)
    actual = [(dwell.line, dwell.after, dwell.lasting) for dwell in machine.tracer.stops]
    assert actual == [(2, 1, 1.5), (3, 1, 0.5), (4, 1, 0.25)]  # before the move of their line
    assert len(machine.moves) == 2 and machine.ignored == {"G4"}
    with pytest.raises(ToolpathError, match=r"line 2: P-1: a dwell needs seconds"):
        interpreted(["G1 X1 F600", "G4 P-1"], 3, None)
    with pytest.raises(ToolpathError, match=r"line 1: P-1: a dwell needs seconds"):
        interpreted(["G89 X1 Z-1 R2 P-1 F100"], 3, None)


def test_first_lines_only():
    endless = ["o1 while [1]", "G91 G0 X1", "o1 endwhile"]
    assert len(interpreted(endless, 3, None, most_lines=10).moves) == 3


def test_the_tolerance_of_a_program_is_its_smallest_one_in_its_units():
    """G64 without P, or with P0, has none: the control may go where it likes."""
    for program, allowed in (
        ("G20 F60 G64 P.001 G1 X1", 25.4e-6),
        ("G21 F60 G64 P.05 G1 X1\nG64 P.01\nX2\nG64 P.02 Q.1", 10e-6),
        ("G64 P.01 G20 F60 G1 X1", 254e-6),
    ):
        machine = interpreted(program.split("\n"), 2, None)
        assert machine.tolerance == pytest.approx(allowed)
        assert not {"G64", "P"} & machine.ignored
    for program in ("F60 G64 G1 X1", "F60 G64 P0 G1 X1"):
        machine = interpreted([program], 2, None)
        assert machine.tolerance is None and "G64" in machine.ignored
