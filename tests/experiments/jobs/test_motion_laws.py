"""Jerk-limited runs of a program: limits of the machine, true geometry, stops at rapid moves."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from experiments.catalogue.choices import machine_named
from experiments.files.results.run_metrics import MotionSummary
from experiments.jobs import job
from experiments.jobs.job import Job, Pace, from_file
from experiments.reports.simulated_tables import motion_table
from experiments.runs.motion_summary import motion_summary
from experiments.shared_options import MachineFlags

EXAMPLE = str(Path(job.__file__).parents[1] / "machines" / "example.json")
PROGRAM = "G21 G90 G0 X0 Y0\nG1 X4 F3000\nY3\nG0 X6 Y5\nG1 X8\n"


def planned_job(folder: Path, **given) -> Job:
    path = folder / "corner.ngc"
    path.write_text(PROGRAM)
    pace = Pace.of(MachineFlags(plant=EXAMPLE, feed_law="jerk", **given), machine_named(EXAMPLE))
    return from_file(path, pace)


def test_samples_keep_the_limits_of_the_machine(tmp_path):
    found = planned_job(tmp_path)
    dt = 1e-3
    position = np.asarray(found.reference(dt, 5).position)
    acceleration = np.diff(position, n=2, axis=0) / dt**2
    jerk = np.diff(position, n=3, axis=0) / dt**3
    # half of 3 and 2.5 m/s^2, built up in 20 ms; differences are means over samples
    assert (np.abs(acceleration).max(axis=0) <= np.array([1.5, 1.25]) * (1 + 1e-6)).all()
    assert (np.abs(jerk).max(axis=0) <= np.array([75.0, 62.5]) * (1 + 1e-6)).all()


def test_corners_leave_the_contour_within_the_tolerance(tmp_path):
    found = planned_job(tmp_path, corner_tolerance_um=20.0)
    reference = found.reference(1e-3, 1)
    points = reference.position[: reference.steps]
    nearest = found.contour.position(found.contour.nearest_anywhere(points))
    apart = np.linalg.norm(points - nearest, axis=1)
    assert 5e-6 < apart.max() <= 20e-6
    assert found.planned is not None and found.planned.motion.stops.size == 4  # at the rapid move


def test_without_tolerance_it_stops_in_every_corner(tmp_path):
    found = planned_job(tmp_path, corner_tolerance_um=0.0)
    assert found.planned is not None and found.planned.motion.stops.size == 5
    assert np.abs(np.asarray(found.aside.offset)).max() == 0.0


def test_summary_adds_up(tmp_path):
    found = planned_job(tmp_path, jerk=500.0)
    assert found.planned is not None
    summary = motion_summary(found.planned)
    assert abs(summary.cycle_time - (found.samples - 1) * 1e-3) <= 1e-3
    assert sum(summary.shares.values()) <= 1 + 1e-9
    assert max(summary.peak_jerk) <= 500.0 * (1 + 1e-9)


@pytest.mark.parametrize(
    ("name", "given"), [("jerk", {"jerk": 0.0}), ("corner", {"corner_tolerance_um": -1.0})]
)
def test_bad_limits_are_refused(tmp_path, name, given):
    with pytest.raises(ValueError, match=name):
        planned_job(tmp_path, **given)


def test_short_moves_at_one_feed_become_a_curve(tmp_path):
    """A half circle of 10 mm radius in 1,000 moves, as a CAM system writes it."""
    angle = np.linspace(0.0, np.pi, 1001)
    points = np.round(10 * np.stack([np.cos(angle), np.sin(angle)], axis=1), 3)
    path = tmp_path / "half.ngc"
    moves = "\n".join(f"X{x:.3f} Y{y:.3f}" for x, y in points[1:])
    path.write_text(f"G21 G90 G0 X10 Y0\nG1 F3000\n{moves}\n")
    pace = Pace.of(MachineFlags(plant=EXAMPLE, feed_law="jerk"), machine_named(EXAMPLE))
    found = from_file(path, pace)
    assert found.planned is not None
    assert found.planned.around.path.rate.size < 100
    assert found.samples * 1e-3 < 1.1 * np.pi * 10e-3 / 0.05


def test_a_circle_in_two_arcs_on_unequal_axes_has_no_stop(tmp_path):
    path = tmp_path / "circle.ngc"
    path.write_text("G21 G90 F3000\nG2 X2 Y0 I1 J0\nG2 X0 Y0 I-1 J0\n")
    machine = machine_named(EXAMPLE)
    unequal = machine.limits._replace(acceleration=np.array([3.0, 9.0]))
    flags = MachineFlags(plant=EXAMPLE, feed_law="jerk")
    found = from_file(path, Pace.of(flags, replace(machine, limits=unequal)))
    assert found.planned is not None and found.planned.motion.stops.size == 2


def test_a_motion_that_is_not_the_quickest_is_told():
    planned = MotionSummary(
        cycle_time=10.0,
        stops=0,
        deviation=0.0,
        shares={},
        jerk_limit=(1.0,),
        peak_jerk=(1.0,),
        peak_acceleration=(1.0,),
        gap=0.005,
    )
    assert [*motion_table(planned, "X").columns[0].cells][1] == "stops on the way"
    told = motion_table(replace(planned, gap=0.25), "X")
    assert [next(iter(column.cells)) for column in told.columns] == ["cycle time", "10.000 s"]
    assert [[*column.cells][1] for column in told.columns] == [
        "NOT THE QUICKEST, by about",
        "2.5 %",
    ]
