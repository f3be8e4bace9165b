"""Random contours: runs that a machine can make, the same for the same seed, others held out."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from jcontour.app.catalogue.choices import machine_named
from jcontour.app.jobs.entry import ENTRY
from jcontour.app.jobs.job import Pace, at_constant_feed
from jcontour.app.jobs.pace import ACCELERATION
from jcontour.app.jobs.sets import random_contours
from jcontour.app.jobs.sets.random_contours import FEEDS, SIZES, contour_jobs, random_jobs
from jcontour.app.jobs.sets.random_shapes import KINDS
from jcontour.app.jobs.sets.stretches import greatest_curvature
from jcontour.app.machines.machine import MachineLimits
from jcontour.geometry.contours import circle

EXAMPLE = str(Path(random_contours.__file__).parents[2] / "machines" / "example.json")
MACHINES = ("bridgeport", EXAMPLE, "flexible-axes", "gantry")
FEED, SIZE = 0.05, 2e-3  # [m/s], [m]


@cache
def pace_of(name):
    return Pace(machine_named(name), None, None)


@cache
def both(name="bridgeport"):
    return contour_jobs("random:12", pace_of(name), 1)


def same(one, other):
    """Whether two runs are along the same points."""
    return one.contour.start.shape == other.contour.start.shape and bool(
        np.array_equal(one.contour.polynomial, other.contour.polynomial)
    )


def feed_of(job, dt):
    return np.diff(job.arc).max() / dt


def tightest(jobs):
    """Least radius of curvature [m] of every contour that has curves."""
    bends = [greatest_curvature(job.contour) for job in jobs]
    return [1 / bend for bend in bends if bend > 0]


@pytest.mark.parametrize("name", MACHINES)
def test_runs_are_the_machines_own_within_its_limits(name, moves_within):
    """Size, feed and place against what is known of its usual contours."""
    pace, jobs = pace_of(name), [*both(name)[0], *both(name)[1]]
    limits, dt = pace.machine.limits, pace.machine.model.dt
    speed = None if limits.speed is None else limits.speed.min()
    acceleration = ACCELERATION if limits.acceleration is None else limits.acceleration.min()
    for job in jobs:
        moved = moves_within(job, pace.machine, speed, acceleration)
        assert 150 <= job.samples <= ENTRY + 400, job.name
        assert not job.at_rest
        assert 75 <= job.scored.sum() <= 400
        assert not job.scored[: min(ENTRY, job.samples // 2)].any()
        assert job.feed_law == f"constant {60e3 * feed_of(job, dt):.4g} mm/min"
        assert moved.max() <= feed_of(job, dt) * (1 + 1e-5)  # splines are fitted to 0.1 nm
    sizes = {"flexible-axes": (25e-3, 0.05), "gantry": (0.05, 0.3)}
    radius, feed = sizes.get(name, (1.41e-3, 0.05))
    assert max(feed_of(job, dt) for job in jobs) <= 1.02 * FEEDS * feed
    assert radius / 8 < np.median(tightest(jobs)) < radius
    if radius < 2e-3:  # laps of larger ones take longer than a run
        closed = [float(job.contour.size) for job in jobs if bool(job.contour.closed)]
        assert len(closed) >= 6
        assert 0.5 * radius / SIZES < min(closed) < max(closed) < 3.0 * radius * SIZES
    if name == "gantry":  # contours all along the part of the beam that is usual
        x = [float(np.asarray(job.contour.polynomial)[:, 0, 0].mean()) for job in jobs]
        assert min(x) < -0.3 and max(x) > 0.2
        assert np.all(np.abs(x) < 0.8)


def test_a_slow_machine_has_slow_contours(moves_within):
    machine = pace_of("bridgeport").machine
    limits = MachineLimits(speed=np.array([0.03, 0.02]), acceleration=np.array([0.5, 0.7]))
    slow = replace(machine, limits=limits)
    jobs = random_jobs(12, 3, Pace(slow, None, None), SIZE, FEED)
    fastest = max(moves_within(job, slow, 0.02, 0.5).max() for job in jobs)
    assert fastest > 0.012


def test_acceleration_that_is_asked_for(moves_within):
    machine = pace_of("bridgeport").machine
    for job in random_jobs(6, 3, Pace(machine, None, 0.2), SIZE, FEED):
        moves_within(job, machine, None, 0.2)


def test_every_kind_has_its_share(monkeypatch):
    drawn = []

    def watched(kind):
        def draw(random, size, length):
            drawn.append((kind, size))
            return kind(random, size, length)

        return draw

    monkeypatch.setattr(random_contours, "KINDS", tuple(watched(kind) for kind in KINDS))
    jobs = random_jobs(64, 5, pace_of("bridgeport"), SIZE, FEED)
    closed = [bool(job.contour.closed) for job in jobs]
    assert 5 < sum(closed[:32]) < 27  # open and closed ones are mixed from the first to the last
    shares = [sum(1 for kind, _ in drawn if kind is each) for each in KINDS]
    assert sum(shares) == 64
    assert set(shares) == {10, 11}
    sizes = np.log(np.array([size for _, size in drawn]) / SIZE) / np.log(SIZES)
    assert np.abs(sizes).max() <= 1
    # uniform: quarters of the range are equally filled, for each kind has one in each tenth
    quarters, _ = np.histogram(sizes, bins=[-1, -0.5, 0, 0.5, 1])
    assert np.abs(quarters - 16).max() <= 6


def test_held_out_contours_are_others():
    training, held_out = both()
    assert len(training) == len(held_out) == 12
    assert not any(same(one, other) for one in training for other in held_out)
    assert [job.name for job in held_out] == [f"held-out-{n:02}" for n in range(1, 13)]
    assert [job.name for job in training] == [f"random-{n:02}" for n in range(1, 13)]


def test_the_same_seed_makes_the_same_contours_and_another_one_others():
    again = contour_jobs("random:12", pace_of("bridgeport"), 1)
    for one, other in zip([*both()[0], *both()[1]], [*again[0], *again[1]], strict=True):
        assert same(one, other)
        np.testing.assert_array_equal(one.arc, other.arc)
        np.testing.assert_array_equal(one.scored, other.scored)
    others = contour_jobs("random:12", pace_of("bridgeport"), 2)[0]
    assert not any(same(one, other) for one in both()[0] for other in others)


def test_training_contours_are_those_of_the_seed():
    """Held-out contours have a stream of their own: they do not depend on how training drew."""
    pace = pace_of("bridgeport")
    ring = at_constant_feed("ring", circle(SIZE), pace)
    training, _ = contour_jobs("random:6", pace, 4, [ring])
    scaled = random_jobs(6, 4, pace, 2e-3, FEED)
    for one, other in zip(training, scaled, strict=True):
        assert feed_of(one, 1.0) == pytest.approx(feed_of(other, 1.0), rel=0.05)


def test_contours_like_own_parts():
    """Twenty times the size, at a fifth of the feed, elsewhere."""
    pace = pace_of("bridgeport")
    ring = at_constant_feed("ring", circle(40e-3, [0.5, 0.2]), pace._replace(feed=0.01))
    training, held_out = contour_jobs("random:12", pace, 1, [ring])
    for job in (*training, *held_out):
        assert feed_of(job, pace.machine.model.dt) <= 1.01 * FEEDS * 0.01
        start = np.asarray(job.reference(pace.machine.model.dt, 1).position)[0]
        assert np.linalg.norm(start - [0.5, 0.2]) < 1.05 * SIZES * 40e-3
    assert 40e-3 / 8 < np.median(tightest(training)) < 40e-3


@pytest.mark.parametrize("count", [1, 2, 5, 7])
def test_few_contours(count):
    assert len(random_jobs(count, 1, pace_of("bridgeport"), SIZE, FEED)) == count


@pytest.mark.parametrize(("size", "feed"), [(1e-6, 1.0), (10.0, 1e-4)])
def test_sizes_and_feeds_that_do_not_fit(moves_within, size, feed):
    """Far too fast for its curves, and far too slow to see them."""
    pace = pace_of("bridgeport")
    for job in random_jobs(6, 1, pace, size, feed):
        assert 150 <= job.samples <= ENTRY + 400
        moves_within(job, pace.machine, FEEDS * feed, ACCELERATION)


@pytest.mark.parametrize("count", [0, -1, 1001])
def test_too_few_and_too_many(count):
    with pytest.raises(ValueError, match=f"contours: .*from 1 to 1000, received {count}"):
        random_jobs(count, 1, pace_of("bridgeport"), SIZE, FEED)


def test_negative_seed():
    with pytest.raises(ValueError, match="contours: .*seed.*received -1"):
        random_jobs(3, -1, pace_of("bridgeport"), SIZE, FEED)


@pytest.mark.parametrize("value", [0.0, -1.0, np.nan, np.inf])
def test_size_and_feed_are_above_zero(value):
    pace = pace_of("bridgeport")
    with pytest.raises(ValueError, match="contours: size needs"):
        random_jobs(3, 1, pace, value, FEED)
    with pytest.raises(ValueError, match="contours: feed needs"):
        random_jobs(3, 1, pace, SIZE, value)


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ("random", "needs random:COUNT"),
        ("random:", "needs random:COUNT"),
        ("random:1_0", "needs random:COUNT"),
        ("random:-4", "needs random:COUNT"),
        ("random:6.5", "needs random:COUNT"),
        ("random:٣", "needs random:COUNT"),
        (" random:64", "needs random:COUNT"),
        ("random:64\n", "needs random:COUNT"),
        ("circle", "needs random:COUNT"),
        ("", "needs random:COUNT"),
        ("random:" + "9" * 5000, "needs random:COUNT"),
        ("random:0", "from 1 to 1000, received 0"),
        ("random:999999", "from 1 to 1000, received 999999"),
    ],
)
def test_other_words_are_refused(words, says):
    with pytest.raises(ValueError, match=f"^contours: .*{says}") as refused:
        contour_jobs(words, pace_of("bridgeport"), 0)
    assert len(str(refused.value)) < 120
    assert "\n" not in str(refused.value)


def test_a_single_axis_has_no_contours():
    with pytest.raises(ValueError, match="contours: .*two or three axes, flexible-axis has one"):
        contour_jobs("random:4", pace_of("flexible-axis"), 0)


def test_contours_of_a_machine_of_three_axes(moves_within):
    from jcontour.linear.plant import LinearPlant

    A = np.kron(np.eye(3), [[1.0, 8e-4], [0.0, 0.6]])
    B = np.kron(np.eye(3), [[2e-4], [0.4]])
    C = np.kron(np.eye(3), [[1.0, 0.0]])
    machine = replace(pace_of("bridgeport").machine, model=LinearPlant(A, B, C, 1e-3))
    for job in random_jobs(6, 1, Pace(machine, None, None), SIZE, FEED):
        moves_within(job, machine, None, ACCELERATION)
        assert not np.asarray(job.reference(1e-3, 1).position)[:, 2].any()
