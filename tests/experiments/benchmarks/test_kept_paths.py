"""Rows of checked paths that go through a file."""

import numpy as np
import pytest

from experiments.benchmarks.kept_paths import opened, write
from experiments.benchmarks.random_paths import Checked

ROWS = [
    Checked(8, "lines, feeds differ", 3, 1.0, 0.1 + 0.2, 1 + 1e-10, 1.0, 0.9, 1.0, 0.1),
    Checked(11, "lines and arcs", 50, 1.0, 0.5, 1.0, 1.0, 0.9, np.nan, 0.1),
]


def test_rows_come_back_to_the_last_bit(tmp_path):
    path = tmp_path / "paths.csv"
    for row in ROWS:
        with opened(path)[1] as file:
            write(file, [row])
    found, file = opened(path)
    file.close()
    assert found[0] == ROWS[0] and str(found) == str(ROWS)  # NaN is no other NaN


def test_a_line_cut_off_is_dropped_and_written_again(tmp_path):
    path = tmp_path / "paths.csv"
    with opened(path)[1] as file:
        write(file, ROWS)
    path.write_text(path.read_text()[:-9])
    found, file = opened(path)
    with file:
        assert found == ROWS[:1]
        write(file, ROWS[1:])
    assert len(opened(path)[0]) == 2


@pytest.mark.parametrize(
    ("text", "message"),
    [("a,b\n1,2\n", "holds no random toolpaths"), (None, r"line 2: needs numbers of a path")],
)
def test_other_files_are_refused(tmp_path, text, message):
    path = tmp_path / "paths.csv"
    with opened(path)[1]:
        pass
    path.write_text(path.read_text() + "1,lines,x\n" if text is None else text)
    with pytest.raises(ValueError, match=f"keep: .*{message}"):
        opened(path)
    with pytest.raises(ValueError, match="keep: "):
        opened(tmp_path / "none" / "paths.csv")
