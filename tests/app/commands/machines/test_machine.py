"""`machine` from the command line."""

import json

import numpy as np
import pytest

from jcontour.app.catalogue.choices import machine_named
from jcontour.app.cli import main
from jcontour.linear.continuous_axes import sampled_machine, speed_axis


def test_the_example_is_written_without_a_checkout(tmp_path, capsys):
    path = tmp_path / "mill.json"
    assert main(["machine", "--example", str(path)]) == 0
    told = capsys.readouterr().out
    assert f"Written: {path}" in told and f"jcontour tune --plant {path}" in told
    machine = machine_named(str(path))
    assert machine.axes == ("X", "Y") and machine.name == "example-mill"
    assert main(["machine", "--example", str(path)]) == 2
    assert "exists; give another name" in capsys.readouterr().err
    assert main(["machine", "--gain", "1", "--example", str(tmp_path / "other.json")]) == 2
    assert "gain: describes a new machine" in capsys.readouterr().err


def recorded(path, axis, dt=1e-3):
    plant, _ = sampled_machine([axis], dt)
    A, B, C = (np.asarray(one) for one in (plant.A, plant.B, plant.C))
    x, lines = np.zeros(len(A)), ["time,control,position"]
    for k in range(300):
        u = 50.0 * (k > 20)
        lines.append(f"{k * dt:.6f},{u},{1e3 * (C @ x).item():.3f}")  # micrometres of a mm
        x = A @ x + B[:, 0] * u
    path.write_text("\n".join(lines))
    return str(path)


def test_step_responses_become_a_machine(tmp_path, capsys):
    files = [
        recorded(tmp_path / "x.csv", speed_axis(1e-3, 0.02)),
        recorded(tmp_path / "y.csv", speed_axis(2e-3, 0.01)),
    ]
    path = tmp_path / "mill.json"
    words = ["--steps", *files, "--max-control", "100", "--json", "--out", str(path)]
    assert main(["machine", *words]) == 0
    x, y = json.loads(capsys.readouterr().out)["axes"]
    assert x["gain"] == pytest.approx(1e-3, rel=2e-3) and y["gain"] == pytest.approx(2e-3, rel=2e-3)
    assert [one["rise"] for one in (x, y)] == pytest.approx([0.02, 0.01], abs=1.1e-3)


def test_the_file_has_a_name_that_the_next_command_takes(tmp_path, capsys):
    numbers = "--gain 1 --time-constant-ms 20 --out".split()
    assert main(["machine", *numbers, str(tmp_path / "mill3")]) == 0
    told = "".join(capsys.readouterr().out.split())
    assert f"--plant{tmp_path / 'mill3.json'}" in told
    assert sorted(path.name for path in tmp_path.iterdir()) == ["mill3.json", "mill3.png"]
    assert main(["machine", *numbers, str(tmp_path / "mill3")]) == 2
    assert "mill3.json exists; give another name" in capsys.readouterr().err
    assert main(["machine", str(tmp_path / "mill3.json")]) == 0


def test_faults_are_told_in_a_line_and_nothing_is_written(tmp_path, machine_file, capsys):
    path = tmp_path / "mill.json"
    for words, line in (
        ([], "gain: missing; a drive that takes a speed needs it"),
        (["--gain", "1", "--out", str(machine_file)], "exists; give another name"),
        ([str(machine_file), "--gain", "1"], "gain: describes a new machine"),
        ([str(machine_file), "--max-speed", "1"], "max-speed: describes a new machine"),
        ([str(tmp_path / "none.json")], "cannot be read"),
    ):
        assert main(["machine", *(words or ["--out", str(path)])]) == 2
        told = capsys.readouterr().err
        assert line in told and told.count("\n") == 1
    assert not path.exists() and not list(tmp_path.glob("*.png"))


def test_a_file_with_warnings_is_not_called_sound(tmp_path, capsys):
    path = tmp_path / "mill.json"
    numbers = "--gain 1 --time-constant-ms 20 --max-control 250 --out".split()
    assert main(["machine", *numbers, str(path)]) == 0
    assert "can be read" not in capsys.readouterr().out
    assert main(["machine", str(path)]) == 0
    told = capsys.readouterr().out
    assert "The file is sound." in told and "WARNING" not in told
    path.write_text(json.dumps(json.loads(path.read_text()) | {"dt": 2}))  # a slip for 2 ms
    assert main(["machine", str(path)]) == 0
    told = capsys.readouterr().out
    assert "WARNING: a sample period of 2000 ms is unusual" in told
    assert "The file can be read, but look at the warnings." in told and "sound" not in told
