"""Lists of moves beside what the program says."""

import pytest

from experiments.jobs.listed_moves import listed_moves
from jcontour.geometry.toolpath_rules import ToolpathError


def test_a_line_for_each_move(tmp_path):
    path = tmp_path / "part.ngc"
    path.write_text("G21 F600 M3\nG0 X10\nG1 Y2.5 Z-1\nG3 X8 Y4.5 I-2 F300\nG1 Z0\nM2\n")
    head, *moves, last = listed_moves(path, 3, None)
    assert head.split() == ["line", "move", "X", "Y", "Z", "mm/min"]
    assert [line.split() for line in moves] == [
        ["2", "rapid", "10.0000", "0.0000", "0.0000", "-"],
        ["3", "line", "10.0000", "2.5000", "-1.0000", "600"],
        "4 arc 8.0000 4.5000 -1.0000 300 around 8.0000, 2.5000, -1.0000 by 90 degrees".split(),
        ["5", "line", "8.0000", "4.5000", "0.0000", "300"],
    ]
    assert last == "4 moves; ignored: M3"
    assert len(list(listed_moves(path, 2, None))) == 5  # the last move is along Z alone


def test_faults_name_the_file(tmp_path):
    path = tmp_path / "part.ngc"
    path.write_text("G1 X1\n")
    with pytest.raises(ToolpathError, match=r"part\.ngc: line 1: a cutting move without a feed"):
        list(listed_moves(path, 2, None))
    assert len(list(listed_moves(path, 2, 0.01))) == 3
    with pytest.raises(ToolpathError, match=r"missing\.ngc'?: no such file"):
        list(listed_moves(tmp_path / "missing.ngc", 2, None))
    with pytest.raises(ToolpathError, match=r"list-moves: points\.csv is no G-code"):
        list(listed_moves(path.with_name("points.csv").relative_to(tmp_path), 2, None))
