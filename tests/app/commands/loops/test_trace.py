"""`trace` from the command line. What is printed of a traversal, and what is advised."""

import json
from dataclasses import replace

import numpy as np
import pytest

from jcontour.app.catalogue.choices import machine_named
from jcontour.app.cli import main
from jcontour.app.commands.loops.trace import (
    advice,
    job_of,
    judged,
    limits_along,
    next_steps,
    of_file,
    show,
    verdict_on,
)
from jcontour.app.files.results.loop_results import Asked, Traversed
from jcontour.app.files.results.stored import read_result
from jcontour.app.files.results.verdict import LimitCheck, exceeded
from jcontour.app.flags.loops import Trace
from jcontour.app.reports.tables import console_of
from jcontour.geometry.contours import circle, polyline
from jcontour.simulation.traversal import traversal_score

USUAL = Asked(0.3, 200.0, (60.0, 60.0), 7, 4.0, 250.0)
TABLE = Asked(0.3, 200.0, (60.0, 60.0), 7, 4.0, 250.0)
FINE = replace(TABLE, r_control=(0.15, 0.15), period_ms=1.0)  # a horizon of 7 ms


def test_trace_arrives_and_stores_what_it_did(tour):
    summary, result = tour("trace").stored(), tour("trace").result(Traversed)
    assert summary["arrived"] and summary["residual"] <= 1e-8 and 0.1 < summary["time_s"] < 2
    assert summary["peak_um"] < 100
    assert np.abs(summary["signals"]["control"]).max() <= 0.5 + 1e-9
    assert tour("trace").files() == {"settings.json", "result.json", "trace.png", "path.png"}
    assert result.signals is not None and result.signals.tool_mm.shape == (result.steps, 2)
    assert result.rms_um == summary["rms_um"] and result.end_mm is not None
    assert result.arrived and 0 < result.end_mm < 0.01
    assert result.came_mm == pytest.approx(result.length_mm, abs=0.01)


@pytest.mark.slow
def test_a_tool_that_its_controller_s_progress_leaves_behind_has_not_gone_round(tmp_path, capsys):
    """Where the tool moved by 0.065 mm about the start of a circle of 1 mm, by its own points."""
    assert main(["trace", "circle", "--q-theta", "1000", "--out", str(tmp_path / "run")]) == 3
    told = " ".join(capsys.readouterr().out.split())
    assert "LEFT THE TOOL BEHIND: it came to 6.283 mm of 6.283 mm, the tool 0.0645" in told
    assert "DID NOT ARRIVE" in told and "Next: less --q-theta, 100 say" in told
    found = read_result(tmp_path / "run", Traversed)
    assert found.signals is not None and found.outrun and not found.arrived
    moved = np.unwrap(np.arctan2(found.signals.tool_mm[:, 1], found.signals.tool_mm[:, 0]))
    assert found.came_mm == pytest.approx(moved.max(), rel=1e-6)


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
        asked=USUAL,
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


LINE = polyline([[0.0, 0.0], [3e-3, 0.0]])  # [m]


@pytest.mark.parametrize(
    ("last_mm", "arrived"),
    [((3.0, 0.0), True), ((3.0, 0.09), True), ((3.0, 0.84), False), ((2.6, 0.0), False)],
)
def test_arrived_is_a_tool_that_is_at_the_end_at_its_last_sample(last_mm, arrived):
    """A tool that runs down a line of 3 mm in 5 samples of 1 ms, and ends anywhere."""
    tool = 1e-3 * np.array([[0.0, 0.0], [1.0, 0.1], [2.0, 0.1], [2.8, 0.0], last_mm])
    found = judged(traversal_score(LINE, tool, 1e-3), tool, LINE, tool[:, 0])
    assert found["arrived"] is arrived and found["came_mm"] == pytest.approx(max(2.8, last_mm[0]))
    assert found["end_mm"] == pytest.approx(np.hypot(3 - last_mm[0], last_mm[1]))
    assert found["time_s"] == (pytest.approx(3e-3) if arrived else None)
    assert found["peak_um"] == pytest.approx(100.0)


def test_a_tool_that_stays_behind_has_no_error_of_the_path_and_no_time():
    tool = 1e-3 * np.array([[0.0, 0.0], [1.0, 0.0], [1.5, 0.0]])
    found = judged(traversal_score(LINE, tool, 1e-3), tool, LINE, tool[:, 0])
    none = {"arrived": False, "time_s": None, "rms_um": None, "peak_um": None, "outrun": False}
    came = {"came_mm": pytest.approx(1.5), "end_mm": pytest.approx(1.5)}
    assert found == {**none, **came, "progress_mm": pytest.approx(1.5), "left_mm": None}


def test_a_run_that_stopped_has_not_arrived():
    tool = 1e-3 * np.array([[0.0, 0.0], [1.5, 0.0], [3.0, 0.0]])
    score = traversal_score(LINE, tool, 1e-3)
    assert judged(score, tool, LINE, tool[:, 0])["arrived"]
    found = judged(score, tool, LINE, tool[:, 0], failure="no answer")
    assert not found["arrived"] and found["time_s"] is None


def test_a_tool_near_the_start_of_a_closed_path_has_not_come_to_its_end():
    """The end is near as well; where the controller holds it to be does not matter."""
    turn, path = np.linspace(0, 0.065, 172), circle(1e-3)
    tool = 1.002e-3 * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    progress = np.linspace(0, float(path.length), 172)
    found = judged(traversal_score(path, tool, 1e-3), tool, path, progress)
    assert found["outrun"] and not found["arrived"] and found["rms_um"] is None
    assert found["came_mm"] == pytest.approx(0.065) and found["left_mm"] is None
    assert found["progress_mm"] == pytest.approx(2 * np.pi)


def test_a_tool_comes_no_further_once_it_has_left_the_path():
    """A line of 3 mm: it is 4 mm off after 1 mm, and comes back to its end."""
    tool = 1e-3 * np.array([[0.0, 0.0], [1.0, 0.0], [2.0, 4.0], [2.8, 0.0], [3.0, 0.0]])
    found = judged(traversal_score(LINE, tool, 1e-3), tool, LINE, tool[:, 0])
    assert found["left_mm"] == pytest.approx(4.0) and found["came_mm"] == pytest.approx(1.0)
    assert not found["arrived"] and found["time_s"] is None and found["rms_um"] is None


def test_limits_of_the_machine_that_a_run_exceeds_are_told(machine_file):
    """Against differences of the samples, a parabola."""
    machine = machine_named(str(machine_file))
    limits, dt = machine.limits, machine.model.dt
    assert limits.speed is not None
    x = 3 * float(np.max(limits.speed)) / (99 * dt) * dt**2 * np.arange(100.0) ** 2 / 2
    tool, control = np.stack([x, 0 * x], axis=1), np.zeros((100, machine.model.inputs))
    beyond = exceeded(limits_along("part", tool, control, machine))
    speed = np.diff(x).max() / dt
    assert beyond[0] == (
        f"speed of {machine.axes[0]} EXCEEDS its limit: {speed:.4g} of {limits.speed[0]:.4g} m/s "
        "(part, nominal)"
    )
    assert all(one.kept for one in limits_along("part", 0 * tool, control, machine))


def test_a_program_s_extents_are_those_of_its_path(tmp_path, capsys):
    """Straight cuts and a half circle from X20 around X10: the smoothed motion leaves them."""
    part = tmp_path / "three.ngc"
    part.write_text("G21 G90 G17\nG0 X0 Y0\nG1 X20 F1500\nY15\nG3 X0 I-10 J0\nG1 X0 Y0\nM2\n")
    read = of_file(job_of(Trace(contour=str(part))), machine_named("xy-table"), str(part))["read"]
    np.testing.assert_allclose(read.low, [0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(read.high, [0.02, 0.025], atol=1e-12)
    assert "X 0 ... 20, Y 0 ... 25 mm" in told_of(part, capsys)


def late_result(asked=TABLE, **fields):
    """A run of 3 mm that did not arrive, as it is told."""
    given = {"plant": "table", "contour": "line", "control_unit": "V", "length_mm": 3.0}
    ran = {"failure": "", "steps": 9, "fallbacks": 0, "limited": 0.0, "residual": 0.0}
    return Traversed(**given, **ran, asked=asked, **{"arrived": False, "time_s": None, **fields})


@pytest.mark.parametrize(
    ("asked", "says"),
    [
        (
            replace(TABLE, q_theta=1000.0),
            "less --q-theta, 100 say, rewards progress less than it costs",
        ),
        (replace(TABLE, q_lag=0.0), "--q-lag 200 ties progress to the tool"),
        (FINE, "--horizon 28 looks 28 ms ahead, as in the paper"),
    ],
)
@pytest.mark.parametrize("lost", [{"outrun": True}, {"left_mm": 7.0}])
def test_a_tool_that_is_left_behind_is_never_advised_more_progress(asked, says, lost):
    full = {"control_used": (9.0,), "control_limit": (9.0,)}
    assert advice(late_result(asked, **lost, **full)) == says


def test_a_tool_that_is_not_where_its_controller_held_it_is_told(capsys):
    found = late_result(outrun=True, came_mm=0.1, end_mm=0.0, progress_mm=3.0)
    show(found, console_of())
    assert "DID NOT ARRIVE" in capsys.readouterr().out
    (behind,) = verdict_on(found).reasons
    assert "LEFT THE TOOL BEHIND: it came to 3 mm of 3 mm, the tool 0.1 mm" in behind
    (left,) = verdict_on(late_result(outrun=True, left_mm=170.0, end_mm=170.0)).reasons
    assert left == "the tool LEFT the path: it was 170 mm off one of 3 mm"


def test_a_tool_that_arrives_within_its_limits_ends_with_code_0_and_any_other_with_3():
    speed = LimitCheck(name="speed of X", value=0.19, allowed=0.2, unit="m/s")
    arrived = late_result(arrived=True, time_s=0.1, came_mm=3.0, end_mm=0.0, limits=[speed])
    assert verdict_on(arrived).exit_code == 0
    assert verdict_on(replace(arrived, arrived=False)).exit_code == 3
    found = replace(arrived, limits=[replace(speed, value=0.25)])
    assert verdict_on(found).exit_code == 3
    assert "a lower --max-speed-mm-s, 125 say" in next_steps(found)[-1].text
