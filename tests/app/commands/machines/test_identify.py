"""`identify` from the command line."""

import json

import pytest

from jcontour.app.cli import main
from jcontour.app.commands.machines.identify import (
    IdentifyResult,
)
from jcontour.app.files.axis_file import FlexibleAxisFile
from jcontour.app.files.results.stored import read_result
from jcontour.app.files.schema import read

HEADER = "time,motor_position,current_q"


@pytest.fixture
def demo(tour):
    return tour("identify").folder, tour("identify").stored()


@pytest.mark.slow
def test_the_demonstration(demo):
    """What the numbers have to be is the business of the library's tests; here that they arrive."""
    folder, summary = demo
    assert {path.name for path in folder.iterdir()} == {
        "settings.json",
        "result.json",
        "data.csv",
        "axis.json",
        "residuals.png",
        "model.png",
    }
    rows = {row["parameter"]: row for row in summary["parameters"]}
    axis = read(FlexibleAxisFile, json.loads((folder / "axis.json").read_text()))
    p, electrical = axis.parameters, axis.electrical
    assert electrical is not None and electrical.resistance == rows["resistance"]["value"]
    assert float(p.force_constant[0]) == rows["force_constant"][
        "value"
    ] and p.cogging_sine.shape == (1, 3)
    assert (
        axis.dt == 1e-3
        and axis.encoder_resolution == pytest.approx(5e-7)
        and list(axis.notes) == summary["notes"]
    )
    for name in ("total_mass", "viscous", "break_away", "amplitude_1", "stiffness_per_mass"):
        assert rows[name]["separated"] and rows[name]["value"] == pytest.approx(
            rows[name]["truth"], rel=0.02
        )
    assert not rows["coulomb"]["separated"] and rows["coulomb"]["value"] is None


def sliding_without_current():
    """To and fro at four speeds, the current zero throughout: no force at all is seen."""
    dt, place, rows = 1e-3, 0.0, [HEADER]
    for speed in (0.05, 0.1, 0.2, 0.3):
        for direction in (1, -1):
            for k in range(1000):
                rows.append(f"{dt * (len(rows) - 1):.6f},{place:.9f},0")
                place += direction * dt * min(speed, 2 * dt * k, 2 * dt * (1000 - k))
    return "\n".join(rows)


def test_a_break_away_force_of_zero_is_an_answer(tmp_path, capsys):
    data, folder = tmp_path / "free.csv", tmp_path / "run"
    data.write_text(sliding_without_current())
    flags = ["--force-constant", "80", "--out", str(folder), "--details"]
    assert main(["identify", str(data), *flags]) == 0
    printed = capsys.readouterr().out
    assert "a sweep to 0.45 m/s or more would separate them" in printed
    assert "Drawn: model.png, residuals.png" in printed
    assert "Load     nothing: the model has an end effector" in printed
    rows = {row.parameter: row for row in read_result(folder, IdentifyResult).parameters}
    assert rows["break_away"].value == 0 and not rows["coulomb"].separated


@pytest.mark.parametrize(
    ("flags", "says"),
    [
        ([], "identify: needs a CSV file, or --demo for simulated data, and not both"),
        (["data.csv", "--demo"], "and not both"),
        (["nowhere.csv"], "nowhere.csv: cannot be read"),
        (
            ["--demo", "--encoder-um", "0"],
            "encoder-um: needs to be finite and above zero, received 0",
        ),
        (["still.csv"], "force_constant: needs an electrical test"),
        (
            ["still.csv", "--force-constant", "-3"],
            "force_constant: needs to be finite and above zero, received -3",
        ),
        (["still.csv", "--force-constant", "80"], "motion: the motor needs to slide both ways"),
    ],
)
def test_bad_input_is_one_line_and_nothing_is_written(tmp_path, monkeypatch, capsys, flags, says):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "still.csv").write_text(
        "\n".join([HEADER, *(f"{0.001 * k},0,1" for k in range(300))])
    )
    assert main(["identify", *flags]) == 2
    captured = capsys.readouterr()
    assert (
        captured.err.startswith("jcontour: ")
        and captured.err.count("\n") == 1
        and says in captured.err
        and not captured.out
    )
    assert {path.name for path in tmp_path.iterdir()} == {"still.csv"}
