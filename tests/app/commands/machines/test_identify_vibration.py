"""`identify` of accelerometer records from the command line."""

import shlex

import numpy as np
import pytest

from jcontour.app.cli import main
from jcontour.app.files.results.machine_results import VibrationResult
from jcontour.app.files.results.stored import read_result
from jcontour.app.machines.from_file import load_machine
from tests.tuning.identification.shaken_tool import shaken

ORDER = {"x": [0, 1, 2], "y": [1, 0, 2]}


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder, heads = tmp_path_factory.mktemp("raw"), "#time,accel_x,accel_y,accel_z"
    for name, hertz in (("x", 52.0), ("y", 38.0)):
        time, seen = shaken([(hertz, 0.05, 1.0)])
        columns = np.column_stack([time, 1e3 * seen[:, ORDER[name]]])
        np.savetxt(folder / f"raw_data_{name}.csv", columns, "%.6f", ",", header=heads, comments="")
    return [str(folder / f"raw_data_{name}.csv") for name in ORDER]


def test_resonances_of_two_axes_go_into_a_machine(files, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["identify", *files, "--out", "out"]) == 0
    screen = capsys.readouterr().out
    assert len(screen.splitlines()) <= 15
    assert "shaper_freq_x: 52.0, damping_ratio_x: 0.050" in screen
    result = read_result(tmp_path / "out", VibrationResult)
    low, high = result.axes["Y"][0].frequency[1:]
    assert result.axes.keys() == {"X", "Y"} and 37.9 < low < high < 38.1
    assert (tmp_path / "out/vibration-X.png").exists()
    step = screen[screen.index("jcontour machine") : screen.index("Folder")].replace("\\\n", " ")
    assert "--resonance-hz 52.0 38.0" in step
    assert main([*shlex.split(step)[1:], "--out", "machine.json"]) == 0
    assert load_machine(tmp_path / "machine.json").model.axes == 2


def test_one_axis_and_faults(files, tmp_path, capsys):
    assert main(["identify", files[1], "--out", str(tmp_path / "out")]) == 0
    assert "--resonance-hz 0 38.0" in capsys.readouterr().out.replace("\\\n", " ")
    log = tmp_path / "log.csv"
    log.write_text("time,x_command,x_position\n" + "".join(f"{k},0,{k}\n" for k in range(9)))
    for flags, words in (
        ([files[0], files[0]], "shakes X, as the other file does"),
        ([files[0], str(log)], "log.csv: column accel_x holds no number"),
        ([str(log), files[0]], "is of no accelerometer"),
    ):
        assert main(["identify", *flags, "--out", str(tmp_path / "none")]) == 2
        assert words in capsys.readouterr().err
    assert not (tmp_path / "none").exists()
