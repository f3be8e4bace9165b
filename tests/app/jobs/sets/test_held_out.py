"""Held-out contours like a user's parts: their size, feed, place, feed law and samples."""

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from jcontour.app.catalogue.choices import machine_named
from jcontour.app.jobs.contours import BUILT_IN
from jcontour.app.jobs.entry import ENTRY
from jcontour.app.jobs.job import Pace, at_constant_feed, from_file
from jcontour.app.jobs.pace import ACCELERATION
from jcontour.app.jobs.sets import random_contours
from jcontour.app.jobs.sets.held_out import held_out_like
from jcontour.app.jobs.sets.scale import scale_of
from jcontour.geometry.contours import circle

EXAMPLE = str(Path(random_contours.__file__).parents[2] / "machines" / "example.json")
MACHINES = ("bridgeport", EXAMPLE, "flexible-axes", "gantry")
ROUND = ["circle", "ellipse", "lemniscate"]


@cache
def pace_of(name):
    return Pace(machine_named(name), None, None)


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
def test_size_feed_and_samples_of_a_part(part, moves_within, name, size, feed):
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
    found, *_ = held_out_like([job], pace_of("bridgeport"))
    assert 1e3 / float(found.contour.curvature(0.0)) == pytest.approx(radius, rel=0.03)


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


def test_small_curves_of_a_large_part(part):
    """Two holes of 2 mm radius, 300 mm apart."""
    job = part("G0 X2 Y0\nG2 I-2 F600\nG0 X302\nG2 I-2\n")
    found = held_out_like([job], pace_of("bridgeport"))
    assert 1 / float(found[0].contour.curvature(0.0)) == pytest.approx(2e-3, rel=0.05)
    np.testing.assert_allclose(found[0].contour.position(0.0), [0.152, 0.0], atol=3e-3)


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
def test_parts_at_constant_feed_have_contours_at_constant_feed(name, moves_within):
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
    found = held_out_like([ring], pace)[0]
    assert float(found.contour.length) == pytest.approx(2e-3 * np.pi, rel=1e-3)
    np.testing.assert_array_equal(np.flatnonzero(found.scored), np.arange(ENTRY, ENTRY + 150))
    np.testing.assert_allclose(found.arc, ring.arc[: found.samples], rtol=1e-3)


def test_most_parts_decide(part):
    pace = pace_of("bridgeport")
    ring = at_constant_feed("ring", circle(1e-3), pace)
    job = part(slot(2, 3000))
    assert not held_out_like([ring, job, ring], pace)[0].at_rest
    assert held_out_like([job, ring, job], pace)[0].at_rest


def test_no_parts():
    with pytest.raises(ValueError, match="jobs: needs at least one part"):
        held_out_like([], pace_of("bridgeport"))


def test_a_single_axis():
    with pytest.raises(ValueError, match="jobs: .*flexible-axis has 1"):
        held_out_like(
            [at_constant_feed("c", circle(1e-3), pace_of("bridgeport"))], pace_of("flexible-axis")
        )
