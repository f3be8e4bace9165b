"""`audit` from the command line, on a log made of a simulated run."""

import json

import numpy as np
import pytest
import xarray as xr

from jcontour.app.cli import main
from jcontour.app.commands.machines import audit
from jcontour.app.files.results.loop_results import AuditedResult, SimulatedResult
from jcontour.app.files.results.stored import read_result
from jcontour.app.reports.causes import audit_answer
from jcontour.app.reports.rollouts import ROLLOUTS

MOVED = 0.05  # [m] of the part in the log


@pytest.fixture
def audited(tour, tmp_path):
    """Log of the nominal plant of a run of `simulate`, and the folder of its audit."""
    run = tour("simulate").folder
    data = xr.load_dataset(run / ROLLOUTS).isel(design=0, contour=0, plant=0)
    rows = np.column_stack([data.time, data.reference + MOVED, data.output + MOVED])
    names = ["time_s", *(f"{a}_{what}_m" for what in ("command", "position") for a in "xy")]
    log = tmp_path / "log.csv"
    np.savetxt(log, rows, "%.12g", ",", header=",".join(names), comments="")
    return run, log, tmp_path / "out"


def test_a_measured_run_has_the_error_of_the_simulated_one(audited, capsys):
    run, log, out = audited
    assert main(["audit", str(log), "--part", "part.ngc", "--out", str(out)]) == 0
    screen = capsys.readouterr().out
    assert len(screen.splitlines()) <= 15 and "Change   " in screen
    simulated, measured = read_result(run, SimulatedResult), read_result(out, AuditedResult)
    assert any(f"X {1e3 * MOVED:g}" in line for line in measured.words)
    (found,), wanted = measured.plants.values(), next(iter(simulated.plants.values()))
    assert found.peak_contour_error == pytest.approx(wanted.peak_contour_error, rel=1e-3)
    squares = [one.rms_contour_error**2 * one.duration for one in (found, wanted)]  # it settles
    assert squares[0] == pytest.approx(squares[1], rel=0.05)
    assert measured.contour == simulated.contour
    total = sum(one.rms for one in measured.causes)
    assert total == pytest.approx(found.rms_contour_error, rel=1e-6)
    assert {path.suffix for path in out.iterdir()} >= {".png", ".html", ".nc"}
    assert main(["report", str(out), str(run), "--json"]) == 0
    numbers = json.loads(capsys.readouterr().out)["comparison"]["numbers"]
    nominal = [one for one in numbers if one.get("plant") == "nominal"]
    (peaks,) = (one["values"] for one in nominal if one["name"] == "peak contour error um")
    assert peaks[0] == pytest.approx(peaks[1], rel=1e-3)


def test_the_screen_says_what_was_taken_for_granted(audited, tmp_path, capsys):
    """A quarter of the log, its times without unit in us, beside an axis at rest."""
    _, log, out = audited
    rows = np.loadtxt(log, delimiter=",", skiprows=1)
    rows = (rows - [0, *4 * [MOVED]])[: len(rows) // 4] * [1e6, *4 * [1e3]]
    quarter = tmp_path / "quarter.csv"
    heads = "time,x_command,y_command,x_position,y_position,z_command,z_position"
    np.savetxt(
        quarter,
        np.hstack([rows, np.zeros((len(rows), 2))]),
        "%.12g",
        ",",
        header=heads,
        comments="",
    )
    flags = ["--axes", "X", "Y", "Z", "--part", "part.ngc", "--out", str(out)]
    assert main(["audit", str(quarter), *flags]) == 0
    assert "Note" in capsys.readouterr().out
    result = read_result(out, AuditedResult)
    notes = [one.text for one in audit_answer(result) if one.heading == "Note"]
    assert len(notes) == 2 and "taken as us" in notes[0] and "% of the part alone" in notes[1]
    assert result.lags[2] is None and result.lags[0] is not None
    assert "Z" not in next(one.text for one in result.causes if one.kind == "lag")


def test_what_is_no_run_of_the_part_is_refused_in_a_line(audited, tmp_path, capsys):
    _, log, out = audited
    assert main(["audit", str(log), "--part", "lobes", "--out", str(out)]) == 2
    assert "mm from this part" in capsys.readouterr().err
    still = tmp_path / "still.csv"
    still.write_text("time,x_command,y_command,x_position,y_position\n" + "0,1,1,1,1\n" * 9)
    assert main(["audit", str(still), "--out", str(out)]) == 2
    assert "time has to grow" in capsys.readouterr().err
    for flags, said in (
        ("--axes X X", "one to three different names"),
        ("--axes X --part lobes", "one axis follows its command and no path"),
        ("--period-ms 0", "--period-ms: needs to be above zero"),
        ("--length-unit -1", "--length-unit: needs to be above zero"),
    ):
        assert main(["audit", str(log), *flags.split(), "--out", str(out)]) == 2
        assert said in capsys.readouterr().err
    assert main(["audit", str(still), "--period-ms", "1", "--out", str(out)]) == 2
    assert "the commands do not move" in capsys.readouterr().err
    assert not out.exists()


@pytest.mark.parametrize(
    ("columns", "said"),
    [
        ("t,x,y,x,0*y", "the position of Y stands still"),
        ("t,4e-4*x,4e-4*y,4e-4*x,4e-4*y", "the commands do not move, in"),
        ("t,x,y,y,x", "the command of X is followed by the position of Y"),
        ("t,x,y,x,t**2", "the position of Y does not follow its command"),
        ("t,x,y,1000*x,y", "the position of X goes 1e+03 times as far"),
        ("t,x,y,x,np.where(t > 2, np.nan, y)", "y_position holds no number in row 202"),
        ("np.where(t > 2, t + 5, t)*0 + 1,x,y,x,y", "time has to grow"),
        ("np.round(t),x,y,x,y", "time has to grow"),
        ("t,x[:2],y[:2],x[:2],y[:2]", "at least three samples"),
    ],
)
def test_bad_columns_are_told_in_one_line(tmp_path, capsys, columns, said):
    t = 0.01 * np.arange(400)
    names = {"np": np, "t": t, "x": np.sin(t), "y": np.cos(2 * t)}
    signals = eval(f"[{columns}]", names)
    rows = np.column_stack([one[: min(map(len, signals))] for one in signals])
    log = tmp_path / "log.csv"
    heads = "time_s,x_command,y_command,x_position,y_position"
    np.savetxt(log, rows, "%.9g", ",", header=heads, comments="")
    assert main(["audit", str(log), "--out", str(tmp_path / "out")]) == 2
    told = capsys.readouterr().err
    assert told.count("\n") == 1 and said in told


def test_an_interrupted_audit_leaves_its_name_free(audited, monkeypatch):
    """No folder with settings alone, which a second run would refuse."""
    _, log, out = audited

    def interrupted(*_):
        assert (out / "settings.json").exists()
        raise KeyboardInterrupt

    monkeypatch.setattr(audit, "write_result", interrupted)
    assert main(["audit", str(log), "--out", str(out)]) == 130
    assert not out.exists()
