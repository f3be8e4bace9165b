"""Held-out contours like a user's parts: their size, feed, place, feed law and samples."""

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from jcontour.app.catalogue.choices import machine_named
from jcontour.app.jobs import held_out as module
from jcontour.app.jobs.contours import BUILT_IN
from jcontour.app.jobs.held_out import (
    held_out_like,
    rounded_polygon,
    scale_of,
    sharpest_corner,
)
from jcontour.app.jobs.job import ENTRY, Pace, at_constant_feed, from_file
from jcontour.app.jobs.pace import ACCELERATION
from jcontour.app.jobs.stretches import corner_angles, greatest_curvature
from jcontour.geometry.contours import circle, ellipse, lemniscate, polygon

EXAMPLE = str(Path(module.__file__).parents[1] / "machines" / "example.json")
MACHINES = ("bridgeport", EXAMPLE, "flexible-axes", "gantry")
ROUND = ["circle", "ellipse", "lemniscate"]
FEED = 0.05  # [m/s] of contours that have no programme
PREVIEW = 10


@cache
def pace_of(name):
    return Pace(machine_named(name), None, None)


def moves_within(job, machine, speed, acceleration):
    """Speeds and accelerations by differences; at corners, where the velocity jumps, speeds only.

    Limits [m/s], [m/s^2] are None where there are none; beyond one it fails. Returned is the path
    speed (T - 1,) [m/s].
    """
    dt = machine.model.dt
    reference = job.reference(dt, PREVIEW)
    assert reference.steps == job.steps
    assert reference.position.shape == (job.steps + PREVIEW, machine.model.axes)
    position = np.asarray(reference.position)
    assert np.isfinite(position).all()
    assert np.asarray(reference.mask)[: job.samples].any()
    np.testing.assert_allclose(np.linalg.norm(reference.tangent, axis=1), 1.0, rtol=1e-9)
    velocity = np.diff(position[: job.samples], axis=0) / dt
    if speed is not None:
        assert np.abs(velocity).max() <= speed * (1 + 1e-5)  # splines are fitted to 0.1 nm
    passed = _corners_passed(job)
    if acceleration is not None:
        needed = np.abs(np.diff(velocity, axis=0)[~passed]) / dt
        assert needed.max() <= acceleration * 1.02  # a feed law's nodes, and starts within a sample
    return np.linalg.norm(velocity, axis=1)


def _corners_passed(job):
    """Whether a corner lies between the first and the last of every three samples."""
    contour = job.contour
    turned = corner_angles(contour)
    starts = np.asarray(contour.start)
    corners = np.roll(starts, -1)[: turned.size][turned > 1e-6]
    if bool(contour.closed):
        corners = np.concatenate([corners + lap * float(contour.length) for lap in range(4)])
    before = np.searchsorted(corners, job.arc[:-2], side="left")
    after = np.searchsorted(corners, job.arc[2:], side="right")
    return after > before


@pytest.fixture
def part(tmp_path):
    def made(text, name="part.ngc", machine="bridgeport", feed=None):
        path = tmp_path / name
        path.write_text(text)
        return from_file(path, pace_of(machine)._replace(feed=feed))

    return made


def slot(size, feed):
    """Slot of this length [mm], half as wide, one end round."""
    return f"G1 X{size} F{feed}\nG3 Y{size / 2} J{size / 4}\nG1 X0\nG1 Y0\n"


def disc(radius, points=721):
    """Circle of this radius [mm] as a CAM system writes it."""
    angle = np.linspace(0.0, 2 * np.pi, points)
    rows = radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return "\n".join(f"{x:.4f},{y:.4f}" for x, y in rows)


@pytest.mark.parametrize(
    ("name", "size", "feed"),
    [
        *((name, 100, 12000) for name in MACHINES),
        ("bridgeport", 1, 300),
        (EXAMPLE, 1, 3000),
        ("gantry", 100, 3000),
    ],
)
def test_size_feed_and_samples_of_a_part(part, name, size, feed):
    pace, job = pace_of(name), part(slot(size, feed), machine=name)
    machine, held_out = pace.machine, held_out_like([job], pace)
    limits = machine.limits
    speed = None if limits.speed is None else limits.speed.min()
    # without limits of the axes that along and that across the path add up
    along_and_across = np.sqrt(2) * ACCELERATION
    stated = limits.acceleration
    acceleration = along_and_across if stated is None else stated.max()
    fastest = np.diff(job.arc).max() / machine.model.dt
    assert [one.name for one in held_out] == [*ROUND, "square"]
    for one in held_out:
        speeds = moves_within(one, machine, speed, acceleration)
        assert one.at_rest
        assert one.scored.all()
        assert fastest / 3 < speeds.max() < 1.01 * fastest
        assert float(one.contour.size) < 2.6 * size * 1e-3
        middle = np.asarray(one.contour.polynomial)[:, 0].mean(axis=0)
        assert np.linalg.norm(middle - 1e-3 * size * np.array([0.6, 0.25])) < 1.3e-3 * size
    assert np.sum([one.samples for one in held_out]) < 1.4 * max(job.samples, 600)
    radius = 1 / np.asarray(held_out[0].contour.curvature(0.0))  # of the circle
    assert 0.25 * size < 1e3 * radius < size
    dt = machine.model.dt
    longest = max(1.0, 4 * 150 / job.samples) * float(job.contour.length)
    assert all(np.ptp(one.arc) < longest for one in held_out), dt


@pytest.mark.parametrize("radius", [1, 10, 100])
def test_a_disc_has_a_circle_of_its_radius_held_out(part, radius):
    job = part(disc(radius), "part.csv")
    contours, *_ = held_out_like([job], pace_of("bridgeport"))
    assert 1e3 / float(contours.contour.curvature(0.0)) == pytest.approx(radius, rel=0.03)


def test_every_contour_turns_as_much_as_the_part(part):
    """Length over total turning, by hand: 2 pi, or 3 pi for the lemniscate."""
    job = part(disc(1.5), "part.csv", machine=EXAMPLE)  # small enough for whole contours
    jobs = [job] * 20
    for one in held_out_like(jobs, pace_of(EXAMPLE)):
        assert bool(one.contour.closed)
        turned = (3 if one.name == "lemniscate" else 2) * np.pi
        assert float(one.contour.length) / turned == pytest.approx(1.5e-3, rel=0.03)


def test_a_smooth_part_has_a_rounded_square(part):
    held_out = held_out_like([part(disc(5), "part.csv")], pace_of("bridgeport"))
    assert [one.name for one in held_out] == [*ROUND, "rounded-square"]


@pytest.mark.parametrize(("points", "least"), [(721, 0.99), (5, 0.01)])
def test_large_and_slow_parts_have_short_contours(part, points, least):
    """38 s along a circle of 100 mm, or a square: half a second along each, corners passed."""
    job = part(disc(100, points), "part.csv", feed=1 / 60)
    assert job.samples > 60_000
    held_out = held_out_like([job], pace_of("bridgeport"))
    assert sum(one.samples for one in held_out) < 4200
    for one in held_out:
        assert np.diff(one.arc).max() / 5e-4 == pytest.approx(1 / 60, rel=0.01)
    tangent = np.asarray(held_out[-1].reference(5e-4, 1).tangent)
    assert (tangent @ tangent[0]).min() < least  # the square has turned


@pytest.mark.parametrize("name", [name for name in MACHINES if name != EXAMPLE])
def test_parts_at_constant_feed_have_contours_at_constant_feed(name):
    pace = pace_of(name)
    machine = pace.machine
    jobs = [BUILT_IN[one](pace) for one in machine.usual.training]
    limits = machine.limits
    speed = None if limits.speed is None else limits.speed.min()
    acceleration = None if limits.acceleration is None else limits.acceleration.min()
    feed = scale_of(jobs, machine.model.dt).feed
    for one in held_out_like(jobs, pace):
        speeds = moves_within(one, machine, speed, acceleration)
        assert not one.at_rest
        assert one.samples <= ENTRY + 1000
        assert feed / 3 < speeds.max() < feed * (1 + 1e-5)


def test_the_same_circle_is_scored_behind_its_entry_as_in_training():
    """Half a lap held out: as many samples as before, none of them of the entry."""
    pace = pace_of("bridgeport")
    ring = at_constant_feed("ring", circle(1e-3), pace)
    contours = held_out_like([ring], pace)[0]
    assert float(contours.contour.length) == pytest.approx(2e-3 * np.pi, rel=1e-3)
    np.testing.assert_array_equal(np.flatnonzero(contours.scored), np.arange(ENTRY, ENTRY + 150))
    np.testing.assert_allclose(contours.arc, ring.arc[: contours.samples], rtol=1e-3)


def test_most_parts_decide(part):
    pace = pace_of("bridgeport")
    ring = at_constant_feed("ring", circle(1e-3), pace)
    job = part(slot(2, 3000))
    assert not held_out_like([ring, job, ring], pace)[0].at_rest
    assert held_out_like([job, ring, job], pace)[0].at_rest


@pytest.mark.parametrize(
    ("name", "parts", "words"),
    [("bridgeport", 0, "needs at least one part"), ("flexible-axis", 1, "flexible-axis has 1")],
)
def test_no_parts_and_a_single_axis_are_refused(name, parts, words):
    ring = at_constant_feed("ring", circle(1e-3), pace_of("bridgeport"))
    with pytest.raises(ValueError, match=f"jobs: .*{words}"):
        held_out_like([ring] * parts, pace_of(name))


@pytest.fixture(scope="module")
def pace():
    return pace_of("bridgeport")


@pytest.fixture(scope="module")
def scale(pace):
    return lambda *jobs: scale_of(jobs, pace.machine.model.dt)


def points(array):
    return "\n".join(f"{x:.3f},{y:.3f}" for x, y in array)  # mm, as a CAM system rounds


@pytest.mark.parametrize(("radius", "x"), [(1e-3, -1.0), (0.1, 0.7)])
def test_circle(pace, scale, radius, x):
    size = scale(at_constant_feed("circle", circle(radius, [x, 0.0]), pace))
    assert size.radius == pytest.approx(radius, rel=5e-3)
    assert size.half_diagonal == pytest.approx(np.sqrt(2) * radius, rel=0.02)
    assert size.feed == pytest.approx(FEED)
    np.testing.assert_allclose(size.low, [x, 0.0], atol=0.02 * radius)
    np.testing.assert_allclose(size.high, size.low)


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
    size = scale(part("0,0\n30,40\n", "part.csv"))
    assert size.radius == size.half_diagonal
    assert size.half_diagonal == pytest.approx(25e-3, rel=0.02)
    np.testing.assert_allclose(size.low, [15e-3, 20e-3], rtol=0.02)


def test_rapid_moves_do_not_count(part, scale):
    """Two holes of 2 mm radius, 80 mm apart: large part, small curves, between the holes."""
    job = part("G0 X2 Y0\nG2 I-2 F600\nG0 X82\nG2 I-2\n")
    size = scale(job)
    assert size.radius == pytest.approx(2e-3, rel=0.05)
    assert size.half_diagonal == pytest.approx(0.5e-3 * np.hypot(84, 4), rel=0.02)
    assert size.feed == pytest.approx(0.01, rel=0.01)
    contour = held_out_like([job], pace_of("bridgeport"))[0].contour
    assert 1 / float(contour.curvature(0.0)) == pytest.approx(2e-3, rel=0.05)
    np.testing.assert_allclose(contour.position(0.0), [0.042, 0.0], atol=3e-3)


@pytest.mark.parametrize(("slow", "feed"), [(30, 1200), (10, 3000)])
def test_feed_of_half_of_the_way(part, scale, slow, feed):
    job = part(f"G1 X{slow} F1200\nG1 X40 F3000\n")
    assert scale(job).feed == pytest.approx(feed / 60e3, rel=0.01)


def test_medians_and_the_box_of_middles(pace, scale):
    jobs = [
        at_constant_feed("circle", circle(radius, [x, -x]), pace._replace(feed=feed))
        for radius, x, feed in ((10e-3, 0.0, 0.1), (20e-3, 0.1, 0.05), (50e-3, 0.3, 0.2))
    ]
    size = scale(*jobs)
    assert size.radius == pytest.approx(20e-3, rel=5e-3)
    assert size.feed == pytest.approx(0.1)
    np.testing.assert_allclose(size.low, [0.0, -0.3], atol=1e-3)
    np.testing.assert_allclose(size.high, [0.3, 0.0], atol=1e-3)


def test_sharpest_corner(pace, part):
    triangle = polygon([[0.0, 0.0], [2e-3, 0.0], [0.0, 2e-3]])
    sharp = at_constant_feed("triangle", triangle, pace)
    assert sharpest_corner(sharp) == pytest.approx(0.75 * np.pi)
    assert sharpest_corner(at_constant_feed("circle", circle(1e-3), pace)) < 1e-6
    assert sharpest_corner(part("0,0\n1,0\n", "line.csv")) == 0.0


@pytest.mark.parametrize(
    ("moves", "angle"),
    [
        # from rest to rest around a triangle: two corners are passed
        ("G1 X4 F600\nG1 X0 Y4\nG1 X0 Y0\n", 135),
        ("G1 X4 F600\nG1 Y4\nG1 X0 Y0\n", 135),
        ("G1 X0 Y4 F600\nG1 X0 Y0\nG1 X4\n", 180),
        ("G1 X10 F600\nG0 Y5\nG1 X0\n", 0),  # beside rapid moves
    ],
)
def test_ends_and_rapid_moves_make_no_corner(part, moves, angle):
    assert sharpest_corner(part(moves)) == pytest.approx(np.radians(angle))


@pytest.mark.parametrize(("rounding", "radius"), [(0.0, 0.0), (0.1, 0.2), (0.4, 0.8)])
def test_rounded_square(rounding, radius):
    """Side 2: an arc of a right angle ends as far from the corner as its radius is."""
    corners = np.array([0.0, 2.0, 2.0 + 2.0j, 2.0j])
    contour = rounded_polygon(corners, np.full(4, rounding))
    assert bool(contour.closed)
    assert float(contour.length) == pytest.approx(8 * (1 - radius) + 2 * np.pi * radius)
    np.testing.assert_allclose(contour.position(0.0), [0.0, 1.0], atol=1e-15)
    middle = radius * (1 - np.sqrt(0.5))  # of the arc, along each axis from the corner
    arc = 1 - radius + 0.25 * np.pi * radius
    np.testing.assert_allclose(contour.position(arc), [middle, middle], atol=1e-12)


def test_each_corner_is_rounded_by_itself_to_either_side():
    """A dart: its inner corner turns the other way."""
    corners = np.array([0.0, 2.0 + 2.0j, 4.0 + 0.0j, 2.0 + 5.0j])
    rounding = np.array([0.0, 0.3, 0.0, 0.2])
    turned = corner_angles(rounded_polygon(corners, rounding))
    assert np.sum(turned > 1e-6) == 2
    inner = 0.3 * np.hypot(2, 2) / np.tan(np.pi / 4)  # half the angle that it turns by
    assert 1 / greatest_curvature(rounded_polygon(corners, rounding * [0, 1, 0, 0])) == (
        pytest.approx(inner)
    )


def test_a_corner_that_does_not_turn_needs_no_arc():
    corners = np.array([0.0, 1.0, 2.0, 2.0 + 2.0j, 2.0j])
    contour = rounded_polygon(corners, np.full(5, 0.2))
    assert bool(contour.closed)
    assert np.sum(np.asarray(contour.rate) > 0) == 4
