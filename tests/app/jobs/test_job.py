"""The pace of a motion, and programs that no run can hold."""

from pathlib import Path

import numpy as np
import pytest

from jcontour import simulate
from jcontour.app.catalogue.choices import machine_named
from jcontour.app.catalogue.entries import MACHINES
from jcontour.app.flags.shared import MachineFlags
from jcontour.app.jobs import job
from jcontour.app.jobs.job import (
    ENTRY,
    Pace,
    along_contour,
    at_constant_feed,
    behind_entry,
    from_file,
)
from jcontour.app.jobs.pace import ACCELERATION
from jcontour.geometry.contours import circle, line, polygon, spline
from jcontour.geometry.toolpath_rules import ToolpathError
from jcontour.geometry.toolpaths import parse_gcode
from jcontour.motion import feed_laws

EXAMPLE = str(Path(job.__file__).parents[1] / "machines" / "example.json")
SQUARE = [[0.0, 0.0], [2e-3, 0.0], [2e-3, 2e-3], [0.0, 2e-3]]  # [m]


@pytest.mark.parametrize(
    ("moves", "where"),
    [
        ("X90000 F0.1", r"slow\.ngc: line 2: {}; that is more"),
        ("Z-90000 F0.1\nX2 F600", r"line 1: {}, 5\.4e\+07 s of it while Z"),
    ],
)
def test_a_program_that_takes_for_ever(tmp_path, moves, where):
    path = tmp_path / "slow.ngc"
    path.write_text(f"G1 X1 F600\n{moves}\n")
    message = where.format(r"the program takes 5\.4e\+07 s at least, longest here")
    with pytest.raises(ToolpathError, match=message):
        from_file(path, Pace(MACHINES["bridgeport"](), None, None))


def test_a_turn_that_no_motion_can_follow_is_told_with_its_line(tmp_path, monkeypatch):
    monkeypatch.setattr(feed_laws, "MOST_STEPS", 100)
    path = tmp_path / "turns.ngc"
    path.write_text("G21 F600\nG1 X10\nG2 X10 Y0 I5 P50\n")
    pace = Pace.of(MachineFlags(feed_law="trapezoidal"), MACHINES["bridgeport"]())
    with pytest.raises(
        ToolpathError, match=r"turns\.ngc: line 3: contour: a curve turns too sharply"
    ):
        from_file(path, pace)


def test_a_motion_leaves_half_of_the_acceleration_to_the_tool():
    pace = Pace(machine_named(EXAMPLE), None, None)  # 3 and 2.5 m/s^2
    assert pace.acceleration_or_default == 1.25
    np.testing.assert_allclose(pace.axis_acceleration, [1.5, 1.25])


def test_who_asks_for_an_acceleration_gets_all_of_the_machine():
    pace = Pace(machine_named(EXAMPLE), None, 2.8)
    assert pace.acceleration_or_default == 2.8
    np.testing.assert_allclose(pace.axis_acceleration, [3.0, 2.5])


def test_a_machine_that_states_no_acceleration_has_the_usual_one():
    pace = Pace(MACHINES["bridgeport"](), None, None)
    assert pace.acceleration_or_default == ACCELERATION and pace.axis_acceleration is None


def test_at_constant_feed_the_entry_is_not_scored():
    """A closed contour is scored on its second lap, an open one behind its first samples."""
    pace = Pace(MACHINES["bridgeport"](), None, None)  # 25 um a sample
    ring = at_constant_feed("ring", circle(1e-3), pace)
    assert not ring.scored[ring.arc < 2e-3 * np.pi].any() and ring.scored.sum() == 251
    way = at_constant_feed("way", line([0.0, 0.0], [8e-3, 0.0]), pace)
    np.testing.assert_array_equal(way.scored, np.arange(321) >= ENTRY)
    short = at_constant_feed("way", line([0.0, 0.0], [1e-3, 0.0]), pace)
    np.testing.assert_array_equal(short.scored, np.arange(41) >= 20)


def test_a_part_is_run_within_half_of_the_acceleration(tmp_path):
    path = tmp_path / "line.ngc"
    path.write_text("G1 X20 F3000\n")
    pace = Pace(machine_named(EXAMPLE), None, None)
    needed = np.abs(np.diff(from_file(path, pace).arc, 2)) / pace.machine.model.dt**2
    assert needed.max() == pytest.approx(1.5, rel=2e-3)


@pytest.mark.parametrize("law", ["trapezoidal", "jerk"])
def test_a_tool_that_rests_where_a_cut_ends_is_scored(law, tmp_path):
    """Before the rapid move as well as after it; in between it is not."""
    path = tmp_path / "part.ngc"
    path.write_text("G21 F1000 G1 X4\nG4 P.3\nG0 X8\nG4 P.2\nG1 X9\n")
    machine = MACHINES["bridgeport"]()
    job = from_file(path, Pace.of(MachineFlags(feed_law=law), machine))
    at_end, at_start = (abs(job.arc - place) < 1e-12 for place in (4e-3, 8e-3))
    assert job.scored[at_end].sum() * machine.model.dt == pytest.approx(0.3, abs=0.01)
    assert job.scored[at_start].sum() * machine.model.dt == pytest.approx(0.2, abs=0.01)
    between = (job.arc > 4e-3) & (job.arc < 8e-3)
    np.testing.assert_array_equal(job.scored, ~between | at_end | at_start)


@pytest.mark.parametrize("law", ["trapezoidal", "jerk"])
def test_x_and_y_wait_while_z_moves_alone(law, tmp_path):
    """0.5 s in the work are scored, 0.2 s above it are not; half the feed takes twice as long."""
    path = tmp_path / "part.ngc"
    path.write_text("G21 F600 G1 X4\nZ-5\nX5\nG0 Z9\nX8\nG1 Z7\nX9\nG0 Z9\n")
    pace = Pace.of(MachineFlags(feed_law=law), MACHINES["bridgeport"]())
    for override in (1.0, 0.5):
        job = from_file(path, pace._replace(override=override))
        resting = [abs(job.arc - place) < 1e-12 for place in (4e-3, 8e-3)]
        times = [here.sum() * pace.machine.model.dt * override for here in resting]
        np.testing.assert_allclose(times, [0.5, 0.2], atol=0.01)
        assert job.scored[resting[0]].all() and not job.scored[resting[1]].any()


def test_a_drawing_is_run_at_the_feed_with_rapid_moves_between_contours():
    plate = Path(__file__).parents[2] / "data" / "drawings" / "plate.dxf"
    job = from_file(plate, Pace(machine_named(EXAMPLE), 0.1, None))
    assert job.program.ignored == ("1 TEXT (layer notes)",) and job.line_at(0) == 20
    assert 0 < np.count_nonzero(~job.scored) < job.samples / 2
    assert job.line_at(job.steps - 1) == job.line_at(job.samples - 1)


def test_a_machine_that_states_its_acceleration_runs_contours_within_half_of_it():
    """A square of 2 mm with sharp corners, at constant feed on the machine that states none."""
    free = along_contour("square", polygon(SQUARE), Pace(MACHINES["bridgeport"](), None, None))
    assert not free.at_rest and free.feed_law == "constant 3000 mm/min"
    pace = Pace(machine_named(EXAMPLE), None, None)
    job = along_contour("square", polygon(SQUARE), pace)
    assert job.at_rest and job.scored.all() and job.arc[0] == 0
    place = np.asarray(job.reference(pace.machine.model.dt, 1).position)
    needed = np.abs(np.diff(place, 2, axis=0)).max(axis=0) / pace.machine.model.dt**2
    assert (needed < 1.01 * np.array([1.5, 1.25])).all() and (needed > [1.4, 1.2]).all()


def test_a_run_from_rest_to_rest_holds_its_end_for_a_quarter_of_a_second_that_is_scored():
    pace = Pace(machine_named(EXAMPLE), None, None)
    job = along_contour("line", line([0.0, 0.0], [9e-3, 0.0]), pace)
    reference = job.reference(pace.machine.model.dt, 3)
    held = slice(job.samples, reference.steps)
    assert (reference.steps - job.samples) * pace.machine.model.dt == pytest.approx(0.25)
    np.testing.assert_allclose(np.asarray(reference.position)[held], [[9e-3, 0.0]] * 250)
    assert np.asarray(reference.mask)[: reference.steps].all()
    free = along_contour("square", polygon(SQUARE), Pace(MACHINES["bridgeport"](), None, None))
    assert free.steps == free.samples  # it ends in motion


def test_a_contour_of_more_axes_than_the_machine_is_refused():
    pace = Pace(machine_named(EXAMPLE), None, None)
    corkscrew = spline([[0.0, 0.0, 0.0], [1e-3, 0.0, 1e-3], [1e-3, 1e-3, 2e-3]])
    with pytest.raises(ValueError, match="contour: screw needs 3 axes, example-mill has 2"):
        along_contour("screw", corkscrew, pace)


def test_drawings_without_a_unit_name_the_flag(tmp_path):
    path = tmp_path / "part.dxf"
    path.write_text(
        "0\nSECTION\n2\nENTITIES\n0\nLINE\n10\n0\n20\n0\n11\n1\n21\n0\n0\nENDSEC\n0\nEOF\n"
    )
    machine = machine_named(EXAMPLE)
    with pytest.raises(ToolpathError, match=r"part\.dxf: .* give it, as --drawing-unit mm"):
        from_file(path, Pace.of(MachineFlags(), machine))
    inches = from_file(path, Pace.of(MachineFlags(drawing_unit="inch"), machine))
    assert float(inches.contour.length) == pytest.approx(25.4e-3)
    with pytest.raises(ValueError, match="join-um: needs to be finite and not negative"):
        Pace.of(MachineFlags(join_um=-1.0), machine)


def test_a_unit_for_drawings_is_not_taken_for_that_of_points(tmp_path):
    """They are in millimetres: 1 is 1 mm, though inches are asked for, and that is said."""
    path = tmp_path / "points.csv"
    path.write_text("x,y\n0,0\n1,0\n")
    pace = Pace(MACHINES["bridgeport"](), None, None)
    job = from_file(path, pace._replace(drawing_unit=0.0254))
    assert float(job.contour.length) == pytest.approx(1e-3)
    line = "--drawing-unit does not act on points.csv: points are read in mm"
    assert line in job.program.warnings
    assert not [line for line in from_file(path, pace).program.warnings if "--drawing-unit" in line]


@pytest.mark.parametrize(
    ("machine", "said"),
    [
        ("bridgeport", "1800 mm/min (3 times the fastest feed: the machine states no speed)"),
        (EXAMPLE, "12000 mm/min (the machine's limit of speed)"),  # 0.2 m/s in its file
    ],
)
def test_the_speed_of_rapid_moves_is_told_and_where_it_is_from(machine, said, tmp_path):
    path = tmp_path / "part.ngc"
    path.write_text("G21 F600\nG1 X20\nG0 X500\nG1 X520 F300\n")
    pace = Pace(machine_named(machine), None, None)
    run = from_file(path, pace)
    assert f"rapid moves at {said}" in run.program.warnings
    fastest = np.diff(run.arc).max() / pace.machine.model.dt
    assert 60e3 * fastest == pytest.approx(float(said.split()[0]), rel=1e-6)
    path.write_text("G21 F600\nG1 X20 Y5\n")
    assert from_file(path, pace).program.warnings == ()


@pytest.mark.parametrize(
    ("tolerance", "said"),
    [
        (2e-6, "2 um are used: --corner-tolerance-um 12.7"),
        (
            20e-6,
            "20 um are used: --corner-tolerance-um 12.7",
        ),
        (12.7e-6, None),
    ],
)
def test_a_tolerance_of_the_program_s_own_is_told_beside_the_one_that_is_used(
    tolerance, said, tmp_path
):
    path = tmp_path / "part.ngc"
    path.write_text("G20 F60 G64 P.0005\nG1 X1\nY1\n")
    pace = Pace(MACHINES["bridgeport"](), None, None, corner_tolerance=tolerance)
    warnings = from_file(path, pace).program.warnings
    assert len(warnings) == (said is not None) and all(one.endswith(said) for one in warnings)
    assert from_file(path, pace._replace(feed_law="trapezoidal")).program.warnings == ()


def test_a_program_that_moves_a_single_axis_says_which_one_never_moves(tmp_path):
    path = tmp_path / "turned.ngc"
    pace = Pace(MACHINES["bridgeport"](), None, None)
    for program, said in (
        ("G21 F600\nG1 X20\nX5\n", ("Y never moves",)),
        ("G21 F600\nG1 Y20\n", ("X never moves",)),
        ("G21 F600\nG1 X5 Y.001\n", ()),
        ("G21 F600\nG2 X0 Y10 J5\n", ()),
        ("G21 F600 G18\nG17 G1 X20 Y5\n", ()),
    ):
        path.write_text(program)
        warnings = from_file(path, pace).program.warnings
        assert len(warnings) == len(said), program
        assert all(one.startswith(other) for one, other in zip(warnings, said, strict=True))


def test_a_lathe_s_program_needs_z():
    program = "G21 F600 G18\nG0 X1\nG1 X20 Z-1\n"
    assert parse_gcode(program, "XYZ").warnings == ()
    with pytest.raises(ToolpathError, match="line 3: a cut in the plane of G18 needs a third axis"):
        parse_gcode(program, "XY")


@pytest.mark.parametrize(
    ("samples", "entry"), [(1000, 100), (201, 100), (200, 100), (199, 99), (2, 1), (1, 0)]
)
def test_the_entry_is_a_hundred_samples_or_half_of_the_run(samples, entry):
    np.testing.assert_array_equal(np.flatnonzero(behind_entry(samples)), range(entry, samples))


@pytest.mark.parametrize("name", ["contouring-lq", "preview-lq"])
def test_behind_the_entry_the_first_lap_is_the_second_one(name, closed_loop):
    """How far the tool is from its place on a circle of 251 samples, lap by lap."""
    plants, controller, reference = closed_loop(name)
    lap = 251
    followed = reference(2 * lap)
    output = np.asarray(simulate(plants[0], controller, followed).output)
    error = output[: 2 * lap] - np.asarray(followed.position)[: 2 * lap]
    radial = np.linalg.norm(error, axis=1)
    apart = np.abs(radial[:lap] - radial[lap:]) / radial[lap:].max()
    assert apart[:ENTRY].max() > 0.1 and apart[ENTRY:].max() < 0.05
