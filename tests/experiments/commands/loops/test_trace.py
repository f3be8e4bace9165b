"""`trace` from the command line."""

import json

import numpy as np
import pytest

from experiments.cli import main
from experiments.commands.loops.trace import Traversed, contour_of
from experiments.files.results.stored import read_result
from experiments.flags.loops import Trace


@pytest.mark.slow
def test_trace_arrives_and_stores_what_it_did(tmp_path, capsys):
    assert main(["trace", "square", "--json", "--out", str(tmp_path / "run")]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary["arrived"] and summary["residual"] <= 1e-8 and 0.1 < summary["time_s"] < 2
    assert summary["peak_um"] < 100
    assert np.abs(summary["signals"]["control"]).max() <= 0.5 + 1e-9
    stored = {path.name for path in (tmp_path / "run").iterdir()}
    assert stored == {"settings.json", "result.json", "trace.png", "path.png"}
    result = read_result(tmp_path / "run", Traversed)
    assert result.arrived and result.signals.tool_mm.shape == (result.steps, 2)
    assert result.rms_um == summary["rms_um"]


@pytest.mark.slow
def test_a_run_that_does_not_arrive_says_what_to_do(tmp_path, capsys):
    flags = ["--max-speed-mm-s", "1000", "--q-theta", "0", "--out", str(tmp_path / "run")]
    assert main(["trace", "circle", *flags]) == 1
    told = " ".join(capsys.readouterr().out.split())
    assert "DID NOT ARRIVE" in told and "path.png shows the tool" in told
    assert "Next: more --q-theta rewards progress" in told


@pytest.mark.parametrize(
    ("flags", "says"),
    [
        (["circle", "--period-ms", "2.5"], "period-ms"),
        (["nowhere"], "give one of circle, "),
        (["circle", "--horizon", "0"], "horizon"),
        (["circle", "--horizon", "1000"], "horizon: at most 100 steps, received 1000"),
        (["circle", "--solver", "magic"], "magic"),
        (["circle", "--q-theta", "-1"], "q-theta: "),
        (["circle", "--r-control", "0"], "r-control: "),
        (["circle", "--max-speed-mm-s", "nan"], "max-speed-mm-s: "),
        (["circle", "--max-control", "-1"], "max-control: "),
    ],
)
def test_bad_traces_are_one_line(tmp_path, capsys, flags, says):
    assert main(["trace", *flags, "--out", str(tmp_path / "run")]) == 2
    captured = capsys.readouterr()
    assert says in captured.err and captured.err.count("\n") == 1
    assert not (tmp_path / "run").exists()


def test_a_machine_without_limits_needs_one(tmp_path, capsys, machine_fields):
    fields = {name: value for name, value in machine_fields.items() if name != "limits"}
    (tmp_path / "free.json").write_text(json.dumps(fields))
    assert main(["trace", "circle", "--plant", str(tmp_path / "free.json")]) == 2
    assert "max-control: tiny states no limit on its controls" in capsys.readouterr().err


def test_the_lobes_are_the_default_contour():
    contour = contour_of(Trace())
    assert contour.axes == 2 and float(contour.length) == pytest.approx(0.256, abs=1e-3)
