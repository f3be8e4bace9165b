"""Jerk-limited runs of a program: limits of the machine, true geometry, stops at rapid moves."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from jcontour.app.catalogue.choices import machine_named
from jcontour.app.files.results.run_metrics import MotionSummary
from jcontour.app.flags.shared import MachineFlags
from jcontour.app.jobs import job, motion_laws
from jcontour.app.jobs.job import Job, Pace, from_file
from jcontour.app.reports.run_tables import motion_table
from jcontour.app.runs.contour_summary import motion_summary
from jcontour.geometry.toolpath_rules import ToolpathError

EXAMPLE = str(Path(job.__file__).parents[1] / "machines" / "example.json")
PROGRAM = "G21 G90 G0 X0 Y0\nG1 X4 F3000\nY3\nG0 X6 Y5\nG1 X8\n"


def planned_job(folder: Path, program: str = PROGRAM, **given) -> Job:
    path = folder / "corner.ngc"
    path.write_text(program)
    flags = MachineFlags(**{"plant": EXAMPLE, "feed_law": "jerk"} | given)
    return from_file(path, Pace.of(flags, machine_named(EXAMPLE)))


def test_samples_keep_the_limits_of_the_machine(tmp_path):
    job = planned_job(tmp_path)
    dt = 1e-3
    position = np.asarray(job.reference(dt, 5).position)
    acceleration = np.diff(position, n=2, axis=0) / dt**2
    jerk = np.diff(position, n=3, axis=0) / dt**3
    # half of 3 and 2.5 m/s^2, built up in 20 ms; differences are means over samples
    assert (np.abs(acceleration).max(axis=0) <= np.array([1.5, 1.25]) * (1 + 1e-6)).all()
    assert (np.abs(jerk).max(axis=0) <= np.array([75.0, 62.5]) * (1 + 1e-6)).all()


def test_corners_leave_the_contour_within_the_tolerance(tmp_path):
    job = planned_job(tmp_path, corner_tolerance_um=20.0)
    reference = job.reference(1e-3, 1)
    points = np.asarray(reference.position)[: reference.steps]
    nearest = job.contour.position(job.contour.nearest_anywhere(points))
    apart = np.linalg.norm(points - np.asarray(nearest), axis=1)
    assert 5e-6 < apart.max() <= 20e-6
    assert job.planned is not None and job.planned.motion.stops.size == 4  # at the rapid move


def test_without_tolerance_it_stops_in_every_corner(tmp_path):
    job = planned_job(tmp_path, corner_tolerance_um=0.0)
    assert job.planned is not None and job.planned.motion.stops.size == 5
    assert np.abs(np.asarray(job.aside.offset)).max() == 0.0


def test_summary_adds_up(tmp_path):
    job = planned_job(tmp_path, jerk=500.0)
    assert job.planned is not None
    summary = motion_summary(job.planned)
    assert abs(summary.cycle_time - (job.samples - 1) * 1e-3) <= 1e-3
    assert sum(summary.shares.values()) == pytest.approx(1.0)
    assert max(summary.peak_jerk) <= 500.0 * (1 + 1e-9)


def test_summary_sees_ramps_of_a_millisecond_in_a_minute(tmp_path):
    """The speed v is reached at the acceleration sqrt(v j)."""
    job = planned_job(tmp_path, "G21 G90 G0 X0 Y0\nG1 X1 F1\n", jerk=100.0)
    assert job.planned is not None
    summary = motion_summary(job.planned)
    np.testing.assert_allclose(summary.peak_jerk, [100.0, 0.0], rtol=1e-9)
    np.testing.assert_allclose(
        summary.peak_acceleration, [np.sqrt(1e-3 / 60 * 100.0), 0.0], rtol=1e-6
    )
    assert 0.9999 < summary.shares["feed"] < 1.0 and 0 < summary.shares["jerk"] < 1e-4


@pytest.mark.parametrize(
    ("name", "given"),
    [
        ("jerk", {"jerk": 0.0}),
        ("jerk: beyond 1500 m/s", {"jerk": 1501.0}),  # 1.5 m/s^2 within a sample of 1 ms
        ("corner", {"corner_tolerance_um": -1.0}),
    ],
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
    job = from_file(path, pace)
    assert job.planned is not None
    assert job.planned.around.path.rate.size < 100
    assert job.samples * 1e-3 < 1.1 * np.pi * 10e-3 / 0.05


def test_a_circle_in_two_arcs_on_unequal_axes_has_no_stop(tmp_path):
    path = tmp_path / "circle.ngc"
    path.write_text("G21 G90 F3000\nG2 X2 Y0 I1 J0\nG2 X0 Y0 I-1 J0\n")
    machine = machine_named(EXAMPLE)
    unequal = machine.limits._replace(acceleration=np.array([3.0, 9.0]))
    flags = MachineFlags(plant=EXAMPLE, feed_law="jerk")
    job = from_file(path, Pace.of(flags, replace(machine, limits=unequal)))
    assert job.planned is not None and job.planned.motion.stops.size == 2


@pytest.mark.parametrize("law", ["jerk", "trapezoidal"])
def test_a_dwell_holds_the_tool_where_it_is(tmp_path, law):
    """In a blended corner, between two lines that go on straight, and at the end."""
    dwelling = "G21 G90 G0 X0 Y0\nG1 X4 F3000\nG4 P.2\nY3\nG4 P.1\nG4 P.2\nG1 Y6\nG4 P.05\n"
    job = planned_job(tmp_path, dwelling, feed_law=law)
    held = [np.isclose(job.arc, place, rtol=0, atol=1e-12) for place in (4e-3, 7e-3, 10e-3)]
    np.testing.assert_allclose([each.sum() for each in held], [201, 301, 51], atol=3)
    assert [job.line_at(int(np.argmax(each))) for each in held] == [4, 7, 7]
    reference = job.reference(1e-3, 1)
    np.testing.assert_allclose(
        np.asarray(reference.position)[: job.samples][held[0]][1], [4e-3, 0], atol=1e-12
    )
    without = "\n".join(line for line in dwelling.split("\n") if not line.startswith("G4"))
    assert 550 < job.samples - planned_job(tmp_path, without, feed_law=law).samples < 800


def test_dwells_are_in_the_cycle_time(tmp_path):
    still, dwelling = (planned_job(tmp_path, f"G1 X4 F3000\nG4 P{p}\nX8") for p in (0, 0.75))
    assert still.planned is not None and dwelling.planned is not None
    before, after = motion_summary(still.planned), motion_summary(dwelling.planned)
    assert after.cycle_time == pytest.approx(before.cycle_time + 0.75) and after.dwell == 0.75
    assert after.shares["rest"] == pytest.approx(0.75 / after.cycle_time)
    assert sum(after.shares.values()) == pytest.approx(1.0)
    rows = [[*column.cells][1] for column in motion_table(after, "XY").columns]
    assert rows == ["of it at rest", "0.750 s"]
    assert [*motion_table(before, "XY").columns[0].cells][1] == "stops on the way"


def test_dwells_that_are_too_long_name_their_unit(tmp_path):
    with pytest.raises(ToolpathError, match=r"takes 5e\+05 s .*P of G4 is in seconds"):
        planned_job(tmp_path, "G1 X4 F3000\nG4 P500000\nX8")


def test_rapid_moves_that_go_on_straight_are_stopped_between(tmp_path):
    """As LinuxCNC does; the tolerance is kept in the corner between both."""
    job = planned_job(tmp_path, "G1 X4 F3000\nG0 X8\nG1 X12\nG0 Y4\nG1 Y8\n")
    assert job.planned is not None
    np.testing.assert_allclose(job.planned.motion.stops, 1e-3 * np.array([0, 4, 8, 12, 16, 20]))
    assert np.abs(job.aside.offset).max() < 1e-12


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
    table = motion_table(replace(planned, gap=0.25), "X")
    assert [next(iter(column.cells)) for column in table.columns] == ["cycle time", "10.000 s"]
    assert [[*column.cells][1] for column in table.columns] == [
        "NOT THE QUICKEST, by about",
        "2.5 %",
    ]


INI = """[TRAJ]
LINEAR_UNITS = mm
[AXIS_X]
MAX_VELOCITY = 100
MAX_ACCELERATION = 3000
[AXIS_Y]
MAX_VELOCITY = 100
MAX_ACCELERATION = 2500
"""


@pytest.mark.parametrize("planner", ["linuxcnc", "grbl"])
def test_motion_of_another_control(tmp_path, planner):
    """From end to end on the path, or within P of G64, at its own limits."""
    (tmp_path / "sim.ini").write_text(INI)
    given = {"planner": planner, "machine_limits": str(tmp_path / "sim.ini")}
    job = planned_job(tmp_path, f"G64 P0.02\n{PROGRAM}", **given)
    reference = job.reference(1e-3, 5)
    position = np.asarray(reference.position)[: reference.steps]
    nearest = job.contour.position(job.contour.nearest_anywhere(position))
    apart = np.linalg.norm(position - np.asarray(nearest), axis=1)
    assert apart.max() < (20e-6 if planner == "linuxcnc" else 1e-9)
    assert job.feed_law.lower().startswith(f"as {planner} plans it, 3000 mm/min")
    assert job.arc[-1] == pytest.approx(float(job.contour.length))
    full = planned_job(tmp_path, machine_limits=given["machine_limits"])
    assert "acceleration" not in full.feed_law and full.samples < planned_job(tmp_path).samples


def test_half_of_the_stated_acceleration_is_said(tmp_path):
    assert planned_job(tmp_path).feed_law.startswith(
        "jerk-limited, 3000 mm/min, half the stated acceleration"
    )
    assert "acceleration" not in planned_job(tmp_path, acceleration=1.0).feed_law


def test_jerk_of_the_machine(tmp_path):
    machine = machine_named(EXAMPLE)
    limits = machine.limits._replace(jerk=np.array([500.0, 400.0]))
    pace = Pace.of(MachineFlags(plant=EXAMPLE), replace(machine, limits=limits))
    np.testing.assert_allclose(np.asarray(motion_laws.axis_limits(pace).jerk), [500.0, 400.0])


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"junction_deviation_um": 5.0}, "junction-deviation-um: --planner grbl alone has one"),
        ({"planner": "grbl", "junction_deviation_um": -1.0}, "needs to be finite and above zero"),
    ],
)
def test_settings_of_another_control_are_refused(tmp_path, given, message):
    with pytest.raises(ValueError, match=message):
        planned_job(tmp_path, **given)
