"""Rows that go through a file."""

from typing import NamedTuple

import numpy as np
import pytest

from experiments.benchmarks.kept_rows import opened, write
from experiments.benchmarks.promises.kept_promises import Checked

WHAT = "random toolpaths"
ROWS = [
    Checked(8, "lines, feeds differ", 3, 1.0, 0.1 + 0.2, 1 + 1e-10, 1.0, 0.9, 1.0, 0.1),
    Checked(11, "lines and arcs", 50, 1.0, 0.5, 1.0, 1.0, 0.9, np.nan, 0.1),
]


def test_rows_come_back_to_the_last_bit(tmp_path):
    path = tmp_path / "paths.csv"
    for row in ROWS:
        with opened(path, Checked, WHAT)[1] as file:
            write(file, [row])
    found, file = opened(path, Checked, WHAT)
    file.close()
    assert found[0] == ROWS[0] and str(found) == str(ROWS)  # NaN is no other NaN


def test_a_line_cut_off_is_dropped_and_written_again(tmp_path):
    path = tmp_path / "paths.csv"
    with opened(path, Checked, WHAT)[1] as file:
        write(file, ROWS)
    path.write_text(path.read_text()[:-9])
    found, file = opened(path, Checked, WHAT)
    with file:
        assert found == ROWS[:1]
        write(file, ROWS[1:])
    assert len(opened(path, Checked, WHAT)[0]) == 2


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a,b\n1,2\n", "holds no random toolpaths"),
        (None, r"line 2: needs the fields of random toolpaths"),
    ],
)
def test_other_files_are_refused(tmp_path, text, message):
    path = tmp_path / "paths.csv"
    with opened(path, Checked, WHAT)[1]:
        pass
    path.write_text(path.read_text() + "1,lines,x\n" if text is None else text)
    with pytest.raises(ValueError, match=f"keep: .*{message}"):
        opened(path, Checked, WHAT)
    with pytest.raises(ValueError, match="keep: "):
        opened(tmp_path / "none" / "paths.csv", Checked, WHAT)


class Kept(NamedTuple):
    """A row with a flag."""

    seed: int
    sound: bool


def test_a_flag_is_no_text(tmp_path):
    path = tmp_path / "rows.csv"
    rows = [Kept(0, True), Kept(1, False)]
    with opened(path, Kept, "rows")[1] as file:
        write(file, rows)
    assert opened(path, Kept, "rows")[0] == rows
    path.write_text("seed,sound\n0,perhaps\n")
    with pytest.raises(ValueError, match="line 2"):
        opened(path, Kept, "rows")
