"""`trace` from the command line."""

import json

import numpy as np
import pytest

from experiments.catalogue.choices import machine_named
from experiments.cli import main
from experiments.commands.loops.trace import Traversed, advice, job_of, judged, of_file, show
from experiments.files.results.stored import read_result
from experiments.flags.loops import Trace
from experiments.reports.tables import console_of
from jcontour.geometry.contours import polyline
from jcontour.simulation.traversal import traversal_score


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
    assert result.signals is not None and result.signals.tool_mm.shape == (result.steps, 2)
    assert result.rms_um == summary["rms_um"] and result.end_mm is not None
    assert result.arrived and 0 < result.end_mm < 0.01
    assert result.came_mm == pytest.approx(result.length_mm, abs=0.01)


@pytest.mark.slow
def test_a_run_that_does_not_arrive_says_what_to_do(tmp_path, capsys):
    flags = ["--max-speed-mm-s", "1000", "--q-theta", "0", "--out", str(tmp_path / "run")]
    assert main(["trace", "circle", *flags]) == 1
    told = " ".join(capsys.readouterr().out.split())
    assert "DID NOT ARRIVE" in told and "path.png shows the tool" in told
    assert "Next: more --q-theta rewards progress" in told
    assert "Tool came 0 mm of 6.283 mm along the path; 0 mm from its end point" in told
    assert "Contour error none: it counts on the whole path" in told and "max-control" not in told


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
    contour = job_of(Trace()).contour
    assert contour.axes == 2 and float(contour.length) == pytest.approx(0.256, abs=1e-3)


PROGRAM = """G1 X10 F100
M3
G4 P2
X20
G0 Z5
Y8
G1 Z0
X0 Y8
"""


def told_of(part, capsys):
    """What is printed of a file beside the run, which is made up here."""
    machine = machine_named(Trace().plant)
    found = Traversed(
        plant="table",
        contour=str(part),
        control_unit="V",
        length_mm=1.0,
        failure="",
        steps=1,
        fallbacks=0,
        limited=0.0,
        residual=0.0,
        arrived=False,
        time_s=None,
        **of_file(job_of(Trace(contour=str(part))), machine, str(part)),
    )
    show(found, console_of())
    return capsys.readouterr().out


def test_a_program_is_told_as_it_was_read_and_what_is_not_kept(tmp_path, capsys):
    """Three cuts of 10, 10 and 20 mm, and a rapid move of 8 mm between them."""
    part = tmp_path / "part.ngc"
    part.write_text(PROGRAM)
    told = told_of(part, capsys)
    read = "Read part: 4 moves, 40 mm cut, 8 mm rapid, X 0 ... 20, Y 0 ... 8 mm"
    assert read in told and " s, X" not in told
    assert "the program has no G20 or G21" in told and "M3 at line 2" in told
    lost = "feeds, stops, waits and rapid moves of the file are not kept"
    assert f"{lost}; rapid moves are part of the path." in told


def test_only_what_a_file_has_is_not_kept(tmp_path, capsys):
    part, points = tmp_path / "part.ngc", tmp_path / "points.csv"
    part.write_text("G21 S5 G1 X10 F100\n")
    points.write_text("0,0\n10,0\n")
    told = told_of(part, capsys)
    assert "1 move, 10 mm, X 0 ... 10, Y 0 ... 0 mm; ignored: S" in told
    assert "chooses its own speed: feeds of the file are not kept.\n" in told
    told = told_of(points, capsys)
    assert "Read points: 1 move, 10 mm" in told and "not kept" not in told


LINE = polyline([[0.0, 0.0], [3e-3, 0.0]])  # [m]


@pytest.mark.parametrize(
    ("last_mm", "arrived"),
    [((3.0, 0.0), True), ((3.0, 0.09), True), ((3.0, 0.84), False), ((2.6, 0.0), False)],
)
def test_arrived_is_a_tool_that_is_at_the_end_at_its_last_sample(last_mm, arrived):
    """A tool that runs down a line of 3 mm in 5 samples of 1 ms, and ends anywhere."""
    tool = 1e-3 * np.array([[0.0, 0.0], [1.0, 0.1], [2.0, 0.1], [2.8, 0.0], last_mm])
    found = judged(traversal_score(LINE, tool, 1e-3, progress=tool[:, 0]), tool, LINE)
    assert found["arrived"] is arrived and found["came_mm"] == pytest.approx(max(2.8, last_mm[0]))
    assert found["end_mm"] == pytest.approx(np.hypot(3 - last_mm[0], last_mm[1]))
    assert found["time_s"] == (pytest.approx(3e-3) if arrived else None)
    assert found["peak_um"] == pytest.approx(100.0)


def test_a_tool_that_stays_behind_has_no_error_of_the_path_and_no_time():
    tool = 1e-3 * np.array([[0.0, 0.0], [1.0, 0.0], [1.5, 0.0]])
    found = judged(traversal_score(LINE, tool, 1e-3, progress=tool[:, 0]), tool, LINE)
    none = {"arrived": False, "time_s": None, "rms_um": None, "peak_um": None}
    assert found == {**none, "came_mm": pytest.approx(1.5), "end_mm": pytest.approx(1.5)}


def test_a_run_that_stopped_has_not_arrived():
    tool = 1e-3 * np.array([[0.0, 0.0], [1.5, 0.0], [3.0, 0.0]])
    score = traversal_score(LINE, tool, 1e-3, progress=tool[:, 0])
    assert judged(score, tool, LINE)["arrived"]
    found = judged(score, tool, LINE, failure="no answer")
    assert not found["arrived"] and found["time_s"] is None


def late_result(**fields):
    """A run of 3 mm that did not arrive, as it is told."""
    given = {"plant": "table", "contour": "line", "control_unit": "V", "length_mm": 3.0}
    ran = {"failure": "", "steps": 9, "fallbacks": 0, "limited": 0.0, "residual": 0.0}
    return Traversed(**given, **ran, arrived=False, time_s=None, **fields)


def test_how_far_a_late_tool_came_is_told_and_no_error(capsys):
    show(late_result(came_mm=1.25, end_mm=1.75), console_of())
    told = capsys.readouterr().out
    assert "Tool came         1.25 mm of 3 mm along the path; 1.75 mm from its end point" in told
    assert "DID NOT ARRIVE" in told and "RMS" not in told


def test_a_larger_limit_is_advised_only_where_the_controls_are_short_of_it():
    apart = late_result(control_used=(0.006, 11.0), control_limit=(300.0, 12.0))
    assert advice(apart) == "more --q-theta rewards progress, a larger --max-control allows it"
    free = advice(late_result(control_used=(0.006, 0.0), control_limit=(300.0, 12.0)))
    assert "max-control" not in free and "they used at most 0.006 of 300 V" in free
    assert "more --q-theta" in free and "longer --horizon" in free and "less --r-control" in free


def test_a_tool_that_overran_the_end_is_advised_to_brake():
    beside = late_result(rms_um=235.0, peak_um=890.0, control_used=(9.0,), control_limit=(9.0,))
    assert "longer --horizon brakes in time" in advice(beside)
    assert "less --q-theta" in advice(beside)
