"""Lists of moves beside what the program says."""

from pathlib import Path

import pytest

from jcontour.app.commands.loops.list_moves import listed_moves
from jcontour.app.flags.shared import MachineFlags
from jcontour.geometry.toolpath_rules import ToolpathError


def listed(path, axes, feed=None):
    """On a machine of so many axes, at a feed where the file gives none."""
    flags = MachineFlags(feed_mm_per_min=None if feed is None else 60e3 * feed)
    return list(listed_moves(path, axes, flags))


def test_a_line_for_each_move(tmp_path):
    path = tmp_path / "part.ngc"
    path.write_text("G21 F600 M3\nG0 X10\nG1 Y2.5 Z-1\nG3 X8 Y4.5 I-2 F300\nG1 Z0\nM2\n")
    head, *moves, last = listed(path, 3)
    assert head.split() == ["line", "move", "X", "Y", "Z", "mm/min"]
    assert [line.split() for line in moves] == [
        ["2", "rapid", "10.0000", "0.0000", "0.0000", "-"],
        ["3", "line", "10.0000", "2.5000", "-1.0000", "600"],
        "4 arc 8.0000 4.5000 -1.0000 300 around 8.0000, 2.5000, -1.0000 by 90 degrees".split(),
        ["5", "line", "8.0000", "4.5000", "0.0000", "300"],
    ]
    assert last == "4 moves; ignored: M3"
    *_, stop, _, told, left_out = listed(path, 2)
    assert stop.split()[1:] == "stop 8.0000 4.5000 - for Z 0.2 s".split()
    assert told == "1 stop: Z at line 5; Z alone takes 0.2 s at its feed"
    assert left_out.startswith("a run leaves out 1 of them")


def test_columns_are_as_wide_as_their_numbers_which_have_no_exponents(tmp_path):
    """A feed in inches whose value is large, and places of a large machine."""
    path = tmp_path / "part.ngc"
    path.write_text("G20 F9999 G1 X-3000 Y1\nF0.0025 X1\n" + "X2 F40\n" * 3)
    head, *moves, _ = listed(path, 2)
    assert moves[0].split() == ["1", "line", "-76200.0000", "25.4000", "253975"]
    assert moves[1].split()[-1] == "0.0635"
    assert not any("e+" in line or "e-" in line for line in moves)
    ends = [head.index(name) + len(name) for name in ("X", "Y", "mm/min")]
    for line in moves:
        assert all(line[end - 1] != " " and line[end : end + 2] in ("  ", "") for end in ends)


def test_dwells_stand_in_their_places_with_their_unit(tmp_path):
    path = tmp_path / "part.ngc"
    path.write_text("G4 P1\nG21 F600 G1 X10\nG4 P2.5\nG4 P0\nG82 X12 R3 Z-1 P.5\n")
    _, *moves, last, told, left_out = listed(path, 3)
    assert [line.split()[:2] for line in moves[:4]] == [
        ["1", "dwell"],
        ["2", "line"],
        ["3", "dwell"],
        ["4", "dwell"],
    ]
    assert moves[2].split() == ["3", "dwell", "10.0000", "0.0000", "0.0000", "-", "for", "2.5", "s"]
    drilled, dwelt, out = moves[-3:]
    assert drilled.split()[1:5] == ["line", "12.0000", "0.0000", "-1.0000"]
    assert dwelt.split()[1:] == ["dwell", "12.0000", "0.0000", "-1.0000", "-", "for", "0.5", "s"]
    assert out.split()[1] == "rapid"
    assert last == "5 moves" and told == "4 stops: G4 4 times from line 1 (4 s)"
    assert left_out.startswith("a run leaves out 1 of them")


def test_stops_stand_in_their_places_and_long_dwells_are_asked_about(tmp_path):
    path = tmp_path / "part.ngc"
    path.write_text("G21 F600 G1 X10\nM8\nX20\nG61.1 X30\nX40\nG4 P500\nG1 X50\n")
    _, *moves, last, told, doubt = listed(path, 3)
    assert moves[1].split() == ["2", "stop", "10.0000", "0.0000", "0.0000", "-", "for", "M8"]
    assert [line.split()[1] for line in moves] == ["line", "stop", *["line"] * 3, "dwell", "line"]
    assert last == "5 moves"
    stops = "2 stops: M8 at line 2, G4 at line 6 (500 s)"
    assert told == f"{stops}; G61.1 from line 4: stops after every move"
    assert doubt.startswith("line 6: a dwell of 500 s; P is in seconds here")


def test_faults_name_the_file(tmp_path):
    path = tmp_path / "part.ngc"
    path.write_text("G21 G1 X1\n")
    with pytest.raises(ToolpathError, match=r"part\.ngc: line 1: a cutting move without a feed"):
        listed(path, 2)
    assert len(listed(path, 2, 0.01)) == 3
    with pytest.raises(ToolpathError, match=r"missing\.ngc'?: no such file"):
        listed(tmp_path / "missing.ngc", 2)
    with pytest.raises(ToolpathError, match=r"list-moves: points\.csv holds points"):
        listed(Path("points.csv"), 2)


def test_a_program_without_moves_is_a_fault(tmp_path):
    path = tmp_path / "still.ngc"
    path.write_text("G21 M3\nG1 Z1 F100\n")
    with pytest.raises(ToolpathError, match=r"still\.ngc: the program has no moves along X or Y$"):
        listed(path, 2)
    assert len(listed(path, 3)) == 3


def test_a_drawing_has_arcs_curves_and_the_rapid_moves_between(tmp_path):
    path = tmp_path / "part.svg"
    path.write_text(
        '<svg xmlns="http://www.w3.org/2000/svg" width="40mm" height="20mm" viewBox="0 0 40 20">\n'
        '<path d="M 2 20 L 10 20 A 5 5 0 0 0 15 15"/>\n'
        '<path d="M 20 20 C 22 20 24 18 24 16"/>\n</svg>\n'
    )
    head, *moves, last = (line.split() for line in listed(path, 2, 0.01))
    assert head == ["line", "move", "X", "Y", "mm/min"]
    assert moves[0] == ["2", "line", "10.0000", "0.0000", "600"]
    assert moves[1] == "2 arc 15.0000 5.0000 600 around 10.0000, 5.0000 by 90 degrees".split()
    assert moves[2] == ["3", "rapid", "20.0000", "0.0000", "-"]
    assert {move[1] for move in moves[3:]} == {"curve"}
    assert moves[-1] == ["3", "curve", "24.0000", "4.0000", "600"]
    assert last == [str(len(moves)), "moves"]


def test_a_closed_drawing_ends_where_it_began(tmp_path):
    path = tmp_path / "part.svg"
    path.write_text(
        '<svg xmlns="http://www.w3.org/2000/svg" width="40mm" height="20mm" viewBox="0 0 40 20">\n'
        '<circle cx="10" cy="10" r="4"/>\n</svg>\n'
    )
    _, move, _ = listed(path, 2, 0.01)
    assert move.split()[:5] == ["2", "arc", "14.0000", "10.0000", "600"]
    assert move.endswith("around 10.0000, 10.0000 by -360 degrees")
