"""Runs of predictive control: whether the tool arrives, and what of a file is not kept."""

from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

from jcontour.app.catalogue.choices import job_named, machine_named
from jcontour.app.cli import main
from jcontour.app.designs.predictive import PREDICTIVE, PredictiveDesign
from jcontour.app.files.results.loop_results import SimulatedResult
from jcontour.app.files.results.stored import read_result
from jcontour.app.flags.shared import MachineFlags
from jcontour.app.jobs.pace import Pace
from jcontour.app.machines.machine import Hosted
from jcontour.app.runs.loops.traversing import Ending, ended, not_kept, stays
from jcontour.geometry.contours import circle, polyline
from jcontour.host.loop import reported_loop
from jcontour.linear.transformations import with_input_gains
from jcontour.plants.xy_table import xy_table


def test_a_run_of_mpcc_is_stored_like_every_simulation(tour):
    """The signals have the error of the result, within the limit on the controls."""
    result = tour("traverse").result(SimulatedResult)
    metrics, read = result.plants["nominal"], result.read
    assert tour("traverse").code == 0 and result.verdict.usable
    assert read is not None and read.duration is not None and 0.1 < read.duration < 2
    signals = xr.load_dataset(tour("traverse").folder / "rollouts.nc").squeeze()
    errors = np.linalg.norm(signals.contour_error.values, axis=-1)
    assert errors.max() == pytest.approx(metrics.peak_contour_error) and errors.max() < 100e-6
    assert np.abs(signals.control.values).max() <= 0.5 + 1e-9
    assert np.linalg.norm(signals.output.values[-1] - signals.reference.values[-1]) < 1e-5
    files = {"contour-square.png", "errors-square.png", "rollouts.nc", "report.html"}
    assert files <= tour("traverse").files()


LINE = polyline([[0.0, 0.0], [3e-3, 0.0]])  # [m]


@pytest.mark.parametrize(
    ("last_mm", "there"),
    [((3.0, 0.0), True), ((3.0, 0.09), True), ((3.0, 0.84), False), ((2.6, 0.0), False)],
)
def test_a_tool_that_arrives_is_at_the_end_at_its_last_sample(last_mm, there):
    assert stays(1e-3 * np.array(last_mm), LINE) is there


def reversed_drives():
    return Hosted(with_input_gains(xy_table(1e-3), np.array([-1.0, -1.0])), xy_table(4e-3), 4)


@pytest.mark.parametrize(
    ("controller", "radius", "design", "changed", "ending"),
    [
        # at rest without a reward on progress
        ("mpcc", 2e-3, PredictiveDesign({"q_theta": 0.0}, 4, 500.0), {}, Ending.LATE),
        # the paper's largest reward 200 times over: theta ends its lap, the tool is at its start
        ("mpcc", 1e-3, PredictiveDesign({"q_theta": 1000.0}, 7, 250.0), {}, Ending.OUTRUN),
        (
            "tracking-mpc",
            2e-3,
            PredictiveDesign({}, 4, 100.0),
            {"with_friction": reversed_drives},
            Ending.DIVERGED,
        ),
    ],
)
def test_a_run_that_does_not_arrive_says_how_it_ended(controller, radius, design, changed, ending):
    machine, contour = replace(machine_named("xy-table"), **changed), circle(radius)
    hosted = PREDICTIVE[controller].hosted(machine, contour, design)
    run = reported_loop(hosted.plant, hosted.controller, hosted.reference)
    assert ended(run, hosted, contour)[0] is ending


PROGRAM = """G1 X10 F100
M3
G4 P2
X20
G0 Z5
Y8
G1 Z0
X0 Y8
"""


def test_what_of_a_program_is_not_kept_is_told(tmp_path):
    part = tmp_path / "part.ngc"
    part.write_text(PROGRAM)
    machine = machine_named("xy-table")
    job = job_named(str(part), Pace.of(MachineFlags(), machine))
    (line,) = not_kept(job.program, str(part))
    lost = "feeds, stops, waits, rapid moves of the file are not kept"
    assert f"{lost}; rapid moves are part of the path" in line
    none = job.program._replace(rapid=np.zeros_like(job.program.rapid))
    assert "rapid" not in not_kept(none, str(part))[0]


@pytest.mark.parametrize(
    ("flags", "says"),
    [
        (["--preview", "1000"], "preview: needs 1 to 100 steps, received 1000"),
        (["--weights", "q_theta=-1"], "q_theta: "),
        (["--weights", "r_control=0"], "r_control: "),
        (["--alpha", "1"], "weights: mpcc has no weight 'alpha'"),
        (["--terminal", "riccati"], "terminal: mpcc has no use for it"),
        (["--plant", "flexible-axes"], "states no limit on its controls"),
    ],
)
def test_bad_flags_are_told_in_one_line(tmp_path, capsys, flags, says):
    where = ["--plant", "xy-table", "--out", str(tmp_path / "run")]
    assert main(["simulate", "circle", "--controller", "mpcc", *where, *flags]) == 2
    captured = capsys.readouterr()
    assert says in captured.err and captured.err.count("\n") == 1
    assert not (tmp_path / "run").exists()


@pytest.mark.slow
def test_a_tool_that_its_controller_s_progress_leaves_behind_is_told(tmp_path):
    flags = ["--controller", "mpcc", "--plant", "xy-table", "--preview", "7"]
    flags += ["--weights", "q_theta=1000", "--out", str(tmp_path / "run")]
    assert main(["simulate", "circle", *flags]) == 3
    verdict = read_result(tmp_path / "run", SimulatedResult).verdict
    assert "LEFT THE TOOL BEHIND" in verdict.reasons[0] and "q_theta" in verdict.reasons[0]
