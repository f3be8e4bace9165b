"""`identify --excite` from the command line."""

import numpy as np

from jcontour.app.cli import main


def test_both_programs_are_written(tour):
    folder = tour("excite").folder
    rows = np.loadtxt(folder / "excite.csv", delimiter=",", skiprows=1)
    assert (folder / "excite.csv").read_text().startswith("time_s,x_mm,y_mm\n")
    assert rows.shape[1] == 3 and np.allclose(np.diff(rows[:, 0]), 0.002)
    assert (folder / "excite.ngc").read_text().strip().endswith("M2")


def test_what_cannot_be_read_is_told(tmp_path, capsys):
    path = tmp_path / "limits.json"
    assert main(["identify", "--excite", str(path)]) == 2
    assert "cannot be read" in capsys.readouterr().err
    path.write_text("{")
    assert main(["identify", "--excite", str(path)]) == 2
    assert "is not JSON" in capsys.readouterr().err
