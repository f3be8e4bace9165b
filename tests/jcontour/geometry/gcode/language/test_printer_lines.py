"""Lines of printers are left out in their programs; in those of mills they are read strictly."""

import pytest

from jcontour.geometry.gcode.language.printer_lines import is_for_a_printer, printer_line
from jcontour.geometry.gcode.programs import interpreted
from jcontour.geometry.toolpath_rules import MM, ToolpathError

OF_PRINTERS = {  # and what is told
    'M862.3 P "MK3S"': "M862.3",
    "M862.1 P0.4 A0 F1 ; nozzle check": "M862.1",
    "M115 U3.13.2": "M115",
    "M115 U6.3.0+10073": "M115",
    "M84 E": "M84",
    "N7 M84 X Y E": "M84",
    "M569 S0 E": "M569",
    "M201 X10000 Y10000 Z400 E5000": "M201",
    "M555 X92.5 Y81 W65.1 H54": "M555",
    "M486 A'a part'": "M486",
    "m0106 s255 (fan)": "M106",
    "M1002 gcode_claim_action : 2": "M1002",
    "M17 X1.2 Y1.2 Z0.75": "M17",
    "M117 100% (layer 3": "M117",
    "G29 G": "G29",
    "G29 P9 X208 Y-2.5 W32 H4": "G29",
    "G29.1 Z0.02": "G29.1",
    "G10 ; retract": "G10",
    "G11": "G11",
    "Tx ; the next filament": "T",
    "EXCLUDE_OBJECT_START NAME=a": "EXCLUDE_OBJECT_START",
    "print_start EXTRUDER=240 BED=100": "PRINT_START",
    "_CLEAN": "_CLEAN",
}


def after(line):
    """Machine after a move of a printer, a line, and a move on."""
    return interpreted(["G21 G90 G1 X1 E1 F600", line, "G1 X3 E2"], 3, None)


@pytest.mark.parametrize("line", OF_PRINTERS)
def test_a_line_of_a_printer_moves_nothing_and_is_told(line):
    machine = after(line)
    assert [move.end for move in machine.moves] == [(1 * MM, 0, 0), (3 * MM, 0, 0)]
    assert machine.ignored == {"E", OF_PRINTERS[line]}


@pytest.mark.parametrize(
    "line", ["M569.1 P 9", "M486 A'a'", "G29 X1", "G11 X1", "G11 P", "Tx", "PRINT_START", "G28 F"]
)
def test_none_is_known_in_a_program_of_a_mill(line):
    with pytest.raises(ToolpathError, match="line 2: "):
        interpreted(["G21 G90 G1 X1 F600", line, "X3"], 3, None)


def test_axis_words_behind_an_m_code_move_a_mill():
    mill = interpreted(["G21 G90 G1 X1 F600", "M201 X2"], 3, None)
    assert [move.end[0] for move in mill.moves] == [1 * MM, 2 * MM]


@pytest.mark.parametrize("line", ["M106 S255 G1 X2", "M106 S255 (fan) G1 X2", "M140 S60 g1 X2"])
def test_a_move_in_the_line_is_no_word_of_the_command(line):
    assert [move.end[0] for move in after(line).moves] == [1 * MM, 2 * MM, 3 * MM]


@pytest.mark.parametrize(
    "line", ["M206 X5", "M808 L20", "SET_GCODE_OFFSET Z=0.1", "RESTORE_GCODE_STATE NAME=a"]
)
def test_what_shifts_or_repeats_moves_is_refused(line):
    with pytest.raises(ToolpathError, match="line 2: '[A-Z0-9_]+' is not supported"):
        after(line)


def test_levelling_and_drawing_back_stop():
    stops = [
        stop.why for line in ("G29 A", "G10", "G11", "M84 E") for stop in after(line).tracer.stops
    ]
    assert stops == ["G29", "G10", "G11"]


def test_homing_with_a_flag_goes_home():
    for line in ("G28 W", "G28 O", "g28 x y w", "G28 O X Y"):
        assert after(line).moves[1].end == (0, 0, 0)


@pytest.mark.parametrize(
    "line",
    [
        "M104 S200",
        "M109R170",
        "M115 U3.1.0",
        "N1 M862.1 P.4",
        "G92 E0",
        "M84 E",
        "M569 S0 E",
        "m18 x y;",
        "G29 P9 X2",
        "G29 G",
        "G29.1",
        "G1X1Y2E.5",
        "G2 X1 I4 E-5",
    ],
)
def test_what_shows_that_a_program_is_for_a_printer(line):
    assert is_for_a_printer(["G21", line])


@pytest.mark.parametrize(
    "line",
    [
        "M104 P1",
        "G1 X1E3",
        "G1 X1 (E 3)",
        "G1 X1 ; E3",
        "G187 E0.01",
        "G29 X1",
        "M201 X5",
        "M3 S",
        "M0 E",
    ],
)
def test_what_does_not(line):
    assert not is_for_a_printer(["G21", line])


def test_whether_it_prints_is_asked_where_it_matters():
    def never():
        raise AssertionError

    for line in ("G1 X5 E3", "M3 S100", "X1 Y2", "(M84 E)", "G10 L2 P1 X5", "M30", "T1"):
        assert printer_line(line, never) is None


@pytest.mark.parametrize(
    ("program", "extruded"),
    [
        ("G21G90\nG1X10Y5E0.3F600", "E"),
        ("G21G90\nG92E0\nG1X10Y5E3F600", "E"),
        ("G21G90F600\nG1X10Y5E3\nG1X10Y5E-.25", "E"),
        ("G21G90F600\nm66e0l0\nG1X10Y5", "ELM"),
        ("G21G90F600\n#1=3\nG1X10Y5E#1", "E"),
    ],
)
def test_e_right_behind_a_number_is_a_word_where_no_exponent_is_meant(program, extruded):
    machine = interpreted(program.split("\n"), 3, None)
    assert [move.end for move in machine.moves] == [(10 * MM, 5 * MM, 0)]
    assert {word[0] for word in machine.ignored} == set(extruded)


@pytest.mark.parametrize(
    ("program", "refused"),
    [
        ("G1 X1E3 F600", "line 1: cannot read 'E3 F600'"),
        ("G1 X10 E.5 F600\nG1 X1e-3 E1", "line 2: cannot read 'e-3 E1'"),
        ("#1=1E3", "line 1: cannot read 'E3'"),
    ],
)
def test_what_may_be_an_exponent_is_refused(program, refused):
    both = ": controls know no exponents; the word E needs a space before it here"
    with pytest.raises(ToolpathError) as raised:
        interpreted(program.split("\n"), 3, None)
    assert str(raised.value) == refused + both
