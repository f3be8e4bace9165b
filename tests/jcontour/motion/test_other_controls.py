"""Motions of other controls: hand-computed corners, and cycle times measured in LinuxCNC."""

import math
import tarfile
from pathlib import Path

import numpy as np
import pytest

from jcontour.geometry import contours, toolpaths
from jcontour.geometry.gcode.programs import files_beside, interpreted
from jcontour.geometry.toolpath_rules import lines_of, read_program
from jcontour.motion.other_controls import ControlLimits, as_planned_by

MM = 1e-3
DT = 1e-3
PROGRAMS = Path(__file__).parents[4] / "shared" / "data" / "gcode" / "programs.tar.xz"


def limits(control, speed, acceleration, axes=2, **others) -> ControlLimits:
    every = np.ones(axes)
    return ControlLimits(control, MM * speed * every, MM * acceleration * every, **others)


def along(points, feed: float, asked: ControlLimits):
    """Motion along a polyline [mm] at a feed [mm/s]."""
    contour = contours.polyline(MM * np.array(points, float))
    count = len(points) - 1
    feeds, on = np.full(count, MM * feed), np.full(count, np.nan)
    return contour, as_planned_by(asked, contour, feeds, np.zeros(count, bool), on, DT)


def speeds(motion) -> np.ndarray:
    """At every sample [mm/s]."""
    return np.linalg.norm(np.diff(motion.place, axis=0), axis=1) / DT / MM


RIGHT_ANGLE = [(0, 0), (10, 0), (10, 10)]


def test_grbl_passes_a_right_angle_on_the_circle_of_its_deviation():
    """v^2 = a d sin 45 / (1 - sin 45), a = 500 sqrt(2) mm/s^2 of both axes together."""
    _, motion = along(RIGHT_ANGLE, 200, limits("grbl", 200, 500, junction_deviation=10e-6))
    corner = math.sqrt(500 * math.sqrt(2) * 0.01 * math.sqrt(0.5) / (1 - math.sqrt(0.5)))
    peak = math.sqrt(500 * 10 + 0.5 * corner**2)
    assert motion.duration == pytest.approx(2 * (2 * peak - corner) / 500, rel=1e-9)
    assert speeds(motion).max() == pytest.approx(peak, rel=1e-2)


def test_grbl_sees_fifteen_blocks_ahead():
    points = [(0.1 * k, 0) for k in range(300)]
    _, motion = along(points, 200, limits("grbl", 200, 500))
    assert speeds(motion).max() == pytest.approx(math.sqrt(2 * 500 * 0.1 * 15), rel=5e-2)


def test_linuxcnc_rounds_a_corner_within_its_tolerance():
    """R = tan 45 cos 45 P / (1 - sin 45), v^2 = 0.87 a R; no axis exceeds its acceleration."""
    asked = limits("linuxcnc", 200, 3000, tolerance=0.01 * MM)
    contour, motion = along(RIGHT_ANGLE, 50, asked)
    beside = motion.place / MM - np.array([10, 0])
    radius = math.sqrt(0.5) * 0.01 / (1 - math.sqrt(0.5))
    assert np.abs(beside).min(axis=1).max() == pytest.approx(
        radius * (1 - math.sqrt(0.5)), rel=0.15
    )
    assert np.linalg.norm(beside, axis=1).min() == pytest.approx(0.01, rel=0.1)
    slowest = speeds(motion)[100:-100].min()
    assert slowest == pytest.approx(math.sqrt(math.sqrt(0.75) * 3000 * radius), rel=5e-2)
    assert np.abs(np.diff(motion.place, 2, axis=0)).max() / DT**2 / MM < 3001
    np.testing.assert_allclose(motion.arc[[0, -1]], [0, float(contour.length)], atol=1e-12)


def test_a_square_takes_as_long_as_in_linuxcnc():
    """2 mm at 3000 mm/min, P0.005, 3 m/s^2: 0.242 s measured in its servo thread."""
    square = [(0, 0), (2, 0), (2, 2), (0, 2), (0, 0)]
    asked = limits("linuxcnc", 200, 3000, tolerance=0.005 * MM)
    assert along(square, 50, asked)[1].duration == pytest.approx(0.242, rel=0.03)


def flattened(path: Path, most: int = 120) -> list[str]:
    """The first moves of a program from its first cut on, as plain lines and arcs."""
    moves = interpreted(lines_of(read_program(path)), 3, 0.05, files_beside(path)).moves
    first = next(k for k, move in enumerate(moves) if not move.rapid)
    x, y, z = (length / MM for length in moves[first].start)
    lines, plane = [f"G0 X{x:.6f} Y{y:.6f} Z{z:.6f}"], 17
    for move in moves[first : first + most]:
        code = 19 - move.normal
        lines += [f"G{code}"] if code != plane else []
        plane = code
        x, y, z = (length / MM for length in move.end)
        words = f"X{x:.6f} Y{y:.6f} Z{z:.6f}"
        if not move.angle:
            lines.append(f"G{0 if move.rapid else 1} {words}")
            continue
        centre = [(c - s) / MM for c, s in zip(move.centre, move.start, strict=True)]
        around = " ".join(f"{'IJK'[k]}{centre[k]:.6f}" for k in range(3) if k != move.normal)
        lines.append(f"G{3 if move.angle > 0 else 2} {words} {around}")
    return lines


EQUAL, UNEQUAL, SLOW = (200, 3000), ((200, 150, 50), (3000, 2000, 500)), (100, 800)
MEASURED = [  # name, limits of the axes [mm/s, mm/s^2], path mode, feed [mm/min], time [s]
    ("cam_botomata.nc", EQUAL, "G64 P0.01", 3000, 20.152),
    ("cam_buildbotics.gcode", UNEQUAL, "G64 P0.01", 3000, 25.025),
    ("cam_cutout.ngc", SLOW, "G64 P0.05", 3000, 15.372),
    ("cam_heart.ngc", EQUAL, "G64 P0.05", 6000, 9.404),
    ("cam_mt_kazbegi.ngc", SLOW, "G64", 6000, 9.385),
    ("cam_tinycat.ngc", EQUAL, "G64 P0.002", 1500, 2.497),
    ("lcnc_3D_Chips.ngc", UNEQUAL, "G64 P0.002", 1500, 13.372),
    ("lcnc_3dtest.ngc", SLOW, "G61", 1500, 29.670),
    ("lcnc_51MeanderAve.ngc", EQUAL, "G61", 3000, 15.569),
    ("lcnc_arcspiral.ngc", UNEQUAL, "G64 P0.01", 3000, 12.804),
    ("lcnc_cds.ngc", SLOW, "G64 P0.01", 3000, 47.456),
    ("lcnc_tort.ngc", EQUAL, "G64 P0.05", 6000, 26.155),
    ("pyg_Clamp.nc", UNEQUAL, "G64 P0.05", 6000, 25.067),
    ("pyg_plug6a.tap", EQUAL, "G64", 1500, 28.780),
    ("tinyg_boxes400.gcode", UNEQUAL, "G64 P0.002", 1500, 7.478),
    ("tinyg_compass64.tap", SLOW, "G64 P0.002", 1500, 4.584),
    ("tinyg_shapeoko.ngc", UNEQUAL, "G61", 3000, 31.006),
    ("ugs_headrough.nc", SLOW, "G64 P0.01", 3000, 7.013),
    ("ugs_ordbot.nc", EQUAL, "G64 P0.01", 6000, 8.850),
    ("ugs_ruler.gcode", UNEQUAL, "G64 P0.05", 6000, 15.942),
    ("ugs_turtle.nc", SLOW, "G64 P0.05", 6000, 8.767),
    ("pyg_Heart.tap", EQUAL, "G64", 1500, 13.206),
]


@pytest.fixture(scope="module")
def programs(tmp_path_factory):
    if not PROGRAMS.exists():
        pytest.skip("the public programs are not here")
    folder = tmp_path_factory.mktemp("gcode")
    with tarfile.open(PROGRAMS) as archive:
        archive.extractall(folder, filter="data")
    return folder / "gcode"


@pytest.mark.parametrize(("name", "axes", "mode", "feed", "measured"), MEASURED)
def test_cycle_times_of_public_programs(programs, name, axes, mode, feed, measured):
    """Times of the servo thread of LinuxCNC 2.9 from the first motion to the last one."""
    first, *others = flattened(programs / name)
    lines = ["G21 G90 G17 G91.1", first, mode, f"F{feed}", *others]
    machine = interpreted(lines, 3, None)
    path = toolpaths._toolpath(machine.moves, 3, None, ())
    rest = toolpaths._rest(machine.tracer.stops, 0, path.contour)
    asked = limits("linuxcnc", *map(np.array, axes), axes=3, tolerance=machine.tolerance)
    motion = as_planned_by(asked, path.contour, path.feed, path.rapid, rest, DT)
    assert motion.duration == pytest.approx(measured, rel=0.03)
    assert np.isfinite(motion.place).all() and (np.diff(motion.arc) > -1e-9).all()
    steps = np.abs(np.diff(motion.place, axis=0)).max(axis=0)
    assert (steps <= asked.speed * DT * (1 + 1e-6)).all()
