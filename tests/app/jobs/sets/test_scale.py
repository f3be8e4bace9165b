"""Size, feed and place of runs, measured on shapes whose radii are known."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jcontour.app.jobs.job import Pace, at_constant_feed, from_file
from jcontour.app.jobs.sets.scale import scale_of, sharpest_corner
from jcontour.app.machines.built_in import bridgeport_machine
from jcontour.geometry.contours import circle, ellipse, lemniscate, polygon

FEED = 0.05  # [m/s] of contours that have no programme


@pytest.fixture(scope="module")
def pace():
    return Pace(bridgeport_machine(), None, None)


@pytest.fixture(scope="module")
def scale(pace):
    return lambda *jobs: scale_of(jobs, pace.machine.model.dt)


@pytest.fixture
def part(tmp_path, pace):
    def made(text, name="part.ngc"):
        path = tmp_path / name
        path.write_text(text)
        return from_file(path, pace)

    return made


def points(array):
    return "\n".join(f"{x:.3f},{y:.3f}" for x, y in array)  # mm, as a CAM system rounds


@settings(max_examples=10)
@given(radius=st.floats(1e-3, 0.1), x=st.floats(-1.0, 1.0))
def test_circle(pace, radius, x):
    job = at_constant_feed("circle", circle(radius, [x, 0.0]), pace)
    scale = scale_of([job], pace.machine.model.dt)
    assert scale.radius == pytest.approx(radius, rel=5e-3)
    assert scale.half_diagonal == pytest.approx(np.sqrt(2) * radius, rel=0.02)
    assert scale.feed == pytest.approx(FEED)
    np.testing.assert_allclose(scale.low, [x, 0.0], atol=0.02 * radius)
    np.testing.assert_allclose(scale.high, scale.low)


def test_length_for_each_radian(pace, scale):
    """Perimeter 9.688 b over 2 pi of an ellipse of 2 to 1; 5.244 a over 3 pi of a lemniscate."""
    oval = at_constant_feed("ellipse", ellipse(20e-3, 10e-3), pace)
    eight = at_constant_feed("lemniscate", lemniscate(20e-3), pace)
    assert scale(oval).radius == pytest.approx(9.688448e-2 / (2 * np.pi), rel=0.02)
    assert scale(eight).radius == pytest.approx(5.244115 * 20e-3 / (3 * np.pi), rel=0.02)


def test_many_short_lines_are_the_curve_that_they_stand_for(part, scale):
    """Points at a micrometre's rounding: turns between neighbours are mostly rounding."""
    angle = np.linspace(0.0, 2 * np.pi, 4001)
    job = part(points(20.0 * np.stack([np.cos(angle), np.sin(angle)], axis=1)), "part.csv")
    assert scale(job).radius == pytest.approx(20e-3, rel=0.03)


def test_corners_turn_too(part, scale):
    """Staircase: four corners of a right angle in five steps of 4 mm."""
    steps = np.array([[0, 0], [4, 0], [4, 4], [8, 4], [8, 8], [12, 8]])
    assert scale(part(points(steps), "part.csv")).radius == pytest.approx(10e-3 / np.pi, rel=0.05)


def test_a_straight_part_has_its_half_diagonal(part, scale):
    found = scale(part("0,0\n30,40\n", "part.csv"))
    assert found.radius == found.half_diagonal
    assert found.half_diagonal == pytest.approx(25e-3, rel=0.02)
    np.testing.assert_allclose(found.low, [15e-3, 20e-3], rtol=0.02)


def test_rapid_moves_do_not_count(part, scale):
    """Two holes of 2 mm radius, 80 mm apart: large part, small curves."""
    holes = "G0 X2 Y0\nG2 I-2 F600\nG0 X82\nG2 I-2\n"
    found = scale(part(holes))
    assert found.radius == pytest.approx(2e-3, rel=0.05)
    assert found.half_diagonal == pytest.approx(0.5e-3 * np.hypot(84, 4), rel=0.02)
    assert found.feed == pytest.approx(0.01, rel=0.01)


@pytest.mark.parametrize(("slow", "feed"), [(30, 1200), (10, 3000)])
def test_feed_of_half_of_the_way(part, scale, slow, feed):
    job = part(f"G1 X{slow} F1200\nG1 X40 F3000\n")
    assert scale(job).feed == pytest.approx(feed / 60e3, rel=0.01)


def test_medians_and_the_box_of_middles(pace, scale):
    jobs = [
        at_constant_feed("circle", circle(radius, [x, -x]), pace._replace(feed=feed))
        for radius, x, feed in ((10e-3, 0.0, 0.1), (20e-3, 0.1, 0.05), (50e-3, 0.3, 0.2))
    ]
    found = scale(*jobs)
    assert found.radius == pytest.approx(20e-3, rel=5e-3)
    assert found.feed == pytest.approx(0.1)
    np.testing.assert_allclose(found.low, [0.0, -0.3], atol=1e-3)
    np.testing.assert_allclose(found.high, [0.3, 0.0], atol=1e-3)


def test_sharpest_corner(pace, part):
    triangle = polygon([[0.0, 0.0], [2e-3, 0.0], [0.0, 2e-3]])
    sharp = at_constant_feed("triangle", triangle, pace)
    assert sharpest_corner(sharp) == pytest.approx(0.75 * np.pi)
    assert sharpest_corner(at_constant_feed("circle", circle(1e-3), pace)) < 1e-6
    assert sharpest_corner(part("0,0\n1,0\n", "line.csv")) == 0.0


def test_where_a_part_ends_is_no_corner(part):
    """From rest to rest around a triangle: two corners are passed, of 135 and 90 degrees."""
    job = part("G1 X4 F600\nG1 X0 Y4\nG1 X0 Y0\n")
    assert sharpest_corner(job) == pytest.approx(0.75 * np.pi)
    assert sharpest_corner(part("G1 X4 F600\nG1 Y4\nG1 X0 Y0\n")) == pytest.approx(0.75 * np.pi)
    right = part("G1 X0 Y4 F600\nG1 X0 Y0\nG1 X4\n")
    assert sharpest_corner(right) == pytest.approx(np.pi)


def test_corners_beside_rapid_moves_do_not_count(part):
    job = part("G1 X10 F600\nG0 Y5\nG1 X0\n")
    assert sharpest_corner(job) == 0.0
