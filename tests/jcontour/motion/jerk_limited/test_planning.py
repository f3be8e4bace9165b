"""Jerk-limited motions against closed forms, and their limits at random times."""

import threading

import numpy as np
import pytest

from jcontour.geometry import contours
from jcontour.geometry.contour import unpadded
from jcontour.motion.blending import blended
from jcontour.motion.jerk_limited import mesh, newton, planning
from jcontour.motion.jerk_limited.cubic_motion import ramped
from jcontour.motion.jerk_limited.limits import AxisLimits
from jcontour.motion.jerk_limited.planning import JerkLimitedMotion, jerk_limited
from jcontour.motion.point_to_point import PointToPoint

LIMITS = AxisLimits.of(2, acceleration=3.0, jerk=150.0, speed=0.2)
FEED = 0.1  # [m/s]
ONE_DIGIT_APART = np.array([FEED, np.nextafter(FEED, 1.0)])


def stopping_time(points, feed: float, limits: AxisLimits) -> float:
    """Duration of the motion that stops at every corner, in closed form."""
    total = 0.0
    for delta in np.diff(points, axis=0):
        length = np.linalg.norm(delta)
        with np.errstate(divide="ignore"):
            most = [float((limit / np.abs(delta / length)).min()) for limit in limits]
        total += PointToPoint(length, min(feed, most[0]), *most[1:]).duration
    return total


def check_limits(motion: JerkLimitedMotion, feed: float, seed: int, count: int = 2000) -> None:
    """Limits at random times and at all nodes, by the path's own derivatives."""
    random = np.random.default_rng(seed).uniform(0.0, motion.duration, count)
    speed, acceleration, jerk = motion.axes_at(np.concatenate([random, motion.nodes]))
    slack = 1 + 1e-9
    assert np.linalg.norm(speed, axis=-1).max() <= feed * slack
    for values, limit in zip((speed, acceleration, jerk), motion.limits, strict=True):
        assert (np.abs(values) <= limit * slack).all()


@pytest.mark.parametrize("length", [2e-6, 2e-4, 5e-3, 0.2])
def test_line_takes_as_long_as_in_closed_form(length):
    motion = jerk_limited(contours.line([0.0, 0.0], [0.6 * length, 0.8 * length]), FEED, LIMITS)
    best = stopping_time([[0.0, 0.0], [0.6 * length, 0.8 * length]], FEED, LIMITS)
    assert motion.duration == pytest.approx(best, rel=1e-9) and motion.gap == 0.0
    check_limits(motion, FEED, seed=0)


@pytest.mark.parametrize("length", [2e-6, 2e-4, 5e-3, 0.2])
def test_the_search_finds_the_time_of_a_line(length):
    """The feed of its second half is higher in the last digit, so that no closed form is taken."""
    line = contours.polyline(length * np.array([[0.0, 0.0], [0.3, 0.4], [0.6, 0.8]]))
    motion = jerk_limited(line, ONE_DIGIT_APART, LIMITS)
    best = stopping_time([[0.0, 0.0], [0.6 * length, 0.8 * length]], FEED, LIMITS)
    assert best * (1 - 1e-9) < motion.duration < 1.005 * best
    assert 0 < motion.gap < 2e-3 * best


def test_a_line_cut_into_pieces_of_any_length_takes_as_long():
    random = np.random.default_rng(0)
    cuts = np.concatenate([random.uniform(0, 20e-3, 100), 10e-3 + random.uniform(0, 1e-7, 20)])
    along = np.sort(np.concatenate([[0.0, 20e-3], cuts]))
    line = np.stack([along, 0 * along], axis=1)
    best = stopping_time(line[[0, -1]], 12e-3, LIMITS)
    motion = jerk_limited(contours.polyline(line), 12e-3, LIMITS)
    assert motion.duration == pytest.approx(best, rel=1e-9)
    check_limits(motion, 12e-3, seed=0)
    feed = np.where(np.arange(line.shape[0] - 1) % 2, 12e-3, np.nextafter(12e-3, 1.0))
    searched = jerk_limited(contours.polyline(line), feed, LIMITS)
    assert best * (1 - 1e-9) < searched.duration < 1.005 * best
    assert 0 < searched.gap < 2e-3 * best


@pytest.mark.parametrize("slow", [1e-5, 1e-3])
@pytest.mark.parametrize("who", ["feed", "axes"])
def test_a_slow_speed_is_reached_quickly(slow, who):
    """In a tenth of the time for which jerk may last, or less: cells of that made 6 and 0.5 % more.

    The line takes 400 of the times in which jerk reaches half of the speed.
    """
    limits, feed = LIMITS, slow
    if who == "axes":
        limits, feed = LIMITS._replace(speed=np.full(2, slow)), FEED
    length = 400 * slow * np.sqrt(slow / LIMITS.jerk[0])
    line = contours.polyline([[0.0, 0.0], [0.3 * length, 0.0], [length, 0.0]])
    best = stopping_time([[0.0, 0.0], [length, 0.0]], slow, limits)
    motion = jerk_limited(line, [feed, np.nextafter(feed, 1.0)], limits)
    assert best * (1 - 1e-9) < motion.duration < 1.0005 * best
    check_limits(motion, slow, seed=0)


def test_pieces_that_meet_beside_the_middle_of_a_stretch_make_no_cell_of_rounding():
    """The middle is a node; a cell of a picosecond between both had a thousand times the jerk."""
    line = contours.polyline([[0.0, 0.0], [1e-3 + 8e-13, 0.0], [2e-3, 0.0]])
    stops, pieces, feed = np.array([0.0, 2e-3]), unpadded(line), 0.12 * ONE_DIGIT_APART
    tick = mesh.cell_times(pieces, feed, LIMITS)
    old = ramped(stops, mesh.launch_lengths(tick, LIMITS, np.zeros(2, int)))
    place, piece = mesh.nodes(line, pieces, feed, LIMITS, stops, tick)
    _, node = mesh.cells_between(place, piece, pieces, old)
    assert np.isclose(node, 1e-3, rtol=1e-9).sum() == 1
    assert np.diff(node).min() > 1e-9


def test_a_long_way_at_the_feed_does_not_hide_a_slow_start():
    """What is left to gain is a share of the time of cells: that of the whole is two ramps."""
    feed = 1e-3
    path = contours.arc([20e-3, 0.0], [0.0, 0.0], 0.7)
    motion = jerk_limited(path, feed, LIMITS)
    ramps = motion.duration - float(path.length) / feed  # half of the time that both take
    quickest = 2 * np.sqrt(feed / LIMITS.jerk[0])
    assert quickest < ramps < 1.5 * quickest and motion.gap < 0.1 * quickest


def test_a_search_that_ends_early_says_how_much_is_left(monkeypatch):
    """With half of the steps."""
    monkeypatch.setattr(newton, "STEPS", 6)
    line = contours.polyline([[0.0, 0.0], [1e-3, 0.0], [2e-3, 0.0]])
    motion = jerk_limited(line, 0.12 * ONE_DIGIT_APART, LIMITS)
    best = stopping_time(np.array([[0.0, 0.0], [2e-3, 0.0]]), 12e-3, LIMITS)
    left = motion.duration - best
    assert left > 5e-3 * best  # it is not the quickest
    assert 0.5 * left < motion.gap < 50 * left


def test_a_slow_path_has_cells_by_its_geometry():
    """A thousand times slower: a cell for every short time would make two million of them."""
    turn = contours.arc([20e-3, 0.0], [20e-3, 2e-3], np.pi)
    side = contours.line([0.0, 0.0], [20e-3, 0.0])
    back = contours.line([20e-3, 4e-3], [0.0, 4e-3])
    path = blended(contours.chain([side, turn, back]), 2e-6).path
    count = {}
    for feed in (1e-2, 1e-5):
        motion = jerk_limited(path, feed, LIMITS)
        count[feed] = motion.nodes.size
        ideal = float(path.length) / feed
        assert motion.stops.size == 2 and ideal < motion.duration < 1.0003 * ideal + 0.1
        check_limits(motion, feed, seed=0)
    assert count[1e-5] < 3 * count[1e-2]


def test_both_passes_have_no_more_cells_than_they_may(monkeypatch):
    """Sixteen thousand of a cell's times; without the bound the second pass has 1173 nodes."""
    monkeypatch.setattr(mesh, "MOST_CELLS", 300)
    motion = jerk_limited(contours.circle(10e-3), 5.0, AxisLimits.of(2, 3.0, 15e3))
    assert motion.nodes.size < 600


def test_stretches_between_stops_are_as_quick_as_alone():
    """One of them is a hundred times as long as two others."""
    hairpins = 1e-3 * np.array([[0, 0], [5, 0], [4.999, 0], [5, 0], [0, 0], [30, 0]])
    motion = jerk_limited(contours.polyline(hairpins), FEED, LIMITS)
    best = stopping_time(hairpins, FEED, LIMITS)
    assert motion.stops.size == 6
    assert motion.duration == pytest.approx(best, rel=1e-9)


def test_stretches_side_by_side_are_those_one_after_the_other(monkeypatch):
    quarter = contours.arc([10e-3, 0.0], [0.0, 0.0], np.pi / 2)
    path = contours.chain([quarter, contours.arc([0.0, 10e-3], [0.0, 20e-3], -np.pi)])
    alone = jerk_limited(path, FEED, LIMITS)
    seen = set()
    solve = newton._solved

    def watched(*arguments):
        seen.add(threading.current_thread())
        return solve(*arguments)

    monkeypatch.setattr(newton, "_solved", watched)
    monkeypatch.setattr(planning, "OVERLAP", 1)
    beside = jerk_limited(path, FEED, LIMITS)
    assert beside.stops.size == 3 and threading.current_thread() not in seen
    for name in ("duration", "gap"):
        assert getattr(beside, name) == getattr(alone, name)
    np.testing.assert_array_equal(beside.nodes, alone.nodes)


def test_what_is_wrong_in_a_stretch_is_raised_side_by_side_too(monkeypatch):
    monkeypatch.setattr(newton, "_solved", lambda *_: -1.0)
    with pytest.raises(ValueError, match="within every condition"):
        jerk_limited(contours.circle(10e-3), FEED, LIMITS)


def test_windows_of_a_long_stretch_make_the_motion_of_the_whole(monkeypatch):
    """It speeds up to the feed and brakes for corners on the way."""
    random, feed = np.random.default_rng(0), 0.04
    points = np.cumsum(random.uniform([2e-3, -4e-3], [6e-3, 4e-3], (60, 2)), axis=0)
    path = blended(contours.polyline(points), 0.1e-3).path
    limits = AxisLimits.of(2, acceleration=6.0, jerk=600.0)
    solved, solve = [], newton._solved
    monkeypatch.setattr(
        newton, "_solved", lambda *task: solved.append(task[2].size) or solve(*task)
    )
    monkeypatch.setattr(planning, "OVERLAP", 1_000_000)
    whole = jerk_limited(path, feed, limits)
    monkeypatch.setattr(planning, "OVERLAP", 32)
    parts = jerk_limited(path, feed, limits)
    assert whole.stops.size == parts.stops.size == 2
    assert len(solved) > 10 and max(solved[3:]) < 0.5 * min(solved[:3])
    assert parts.duration == pytest.approx(whole.duration, rel=3e-4)
    time = np.linspace(0.0, whole.duration, 500)
    np.testing.assert_allclose(parts.at(time).arc, whole.at(time).arc, atol=1e-3 * feed)
    check_limits(parts, feed, seed=0)


def test_lines_between_curves_are_as_quick_as_alone():
    """The bend at the end stops the motion where its curvature jumps."""
    bend = contours.arc([20e-3, 0.0], [20e-3, 5e-3], np.pi / 2)
    side = contours.polyline([[0.0, 0.0], [5e-3, 0.0], [20e-3, 0.0]])
    motion = jerk_limited(contours.chain([side, bend]), FEED, LIMITS)
    alone = [jerk_limited(one, FEED, LIMITS).duration for one in (side, bend)]
    passed = motion.reached(motion.stops)
    assert passed[1] == pytest.approx(alone[0], rel=1e-9)
    assert passed[2] - passed[1] == pytest.approx(alone[1], rel=2e-3)
    check_limits(motion, FEED, seed=0)


@pytest.mark.parametrize("seed", [0, 1])
def test_a_path_takes_as_long_backwards(seed):
    """Chords of 0.1 um to 5 mm, in any order."""
    random = np.random.default_rng(seed)
    length, angle = 10 ** random.uniform(-7, -2.3, 60), np.cumsum(random.normal(0, 0.4, 60))
    chords = length[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    points = np.concatenate([np.zeros((1, 2)), np.cumsum(chords, axis=0)])
    there, back = (
        jerk_limited(blended(contours.polyline(way), 2e-6).path, 12e-3, LIMITS).duration
        for way in (points, points[::-1])
    )
    assert there == pytest.approx(back, rel=5e-3)


def test_it_rests_at_both_ends_exactly():
    motion = jerk_limited(contours.line([0.0, 0.0], [0.03, 0.04]), FEED, LIMITS)
    ends = motion.at(np.array([0.0, motion.duration, 2 * motion.duration]))
    np.testing.assert_array_equal(ends.arc, [0.0, 0.05, 0.05])
    arc = motion.sampled(1e-3)
    assert arc[0] == 0.0 and arc[-1] == 0.05 and (np.diff(arc) >= 0).all()
    assert arc.size - 1 == np.ceil(motion.duration / 1e-3)


def test_derivatives_are_those_of_the_motion():
    points = np.random.default_rng(0).uniform(0, 20e-3, (5, 2))
    path = contours.spline(points)
    motion = jerk_limited(path, FEED, LIMITS)
    time, step = np.linspace(0.01, 0.99, 200) * motion.duration, 1e-5
    values = [np.asarray(path.position(motion.at(time + k * step).arc)) for k in (-1, 0, 1)]
    speed, acceleration, _ = motion.axes_at(time)
    np.testing.assert_allclose((values[2] - values[0]) / (2 * step), speed, atol=1e-6)
    bend = (values[2] - 2 * values[1] + values[0]) / step**2
    np.testing.assert_allclose(bend, acceleration, atol=2e-3)


def test_acceleration_has_no_jumps():
    square = contours.polygon([(0, 0), (10e-3, 0), (10e-3, 10e-3), (0, 10e-3)])
    motion = jerk_limited(blended(square, 20e-6).path, FEED, LIMITS)
    inner, step = motion.nodes[1:-1], 1e-7
    before, after = (motion.axes_at(inner + sign * step)[1] for sign in (-1, 1))
    # what the jerk can change in two steps
    assert np.abs(after - before).max() <= 2.1 * step * LIMITS.jerk.max()
    check_limits(motion, FEED, seed=0)


def test_without_tolerance_it_stops_in_corners_and_where_the_curvature_jumps():
    side = contours.line([0.0, 0.0], [20e-3, 0.0])
    corner = contours.arc([20e-3, 0.0], [20e-3, 5e-3], np.pi / 2)
    motion = jerk_limited(contours.chain([side, corner]), FEED, LIMITS)
    assert motion.stops.size == 3
    at = motion.reached(motion.stops[1:2])
    assert np.abs(motion.axes_at(at)[0]).max() < 1e-6


def test_same_bits_twice():
    path = contours.lemniscate(10e-3)
    first, second = (jerk_limited(path, FEED, LIMITS).sampled(1e-3) for _ in range(2))
    np.testing.assert_array_equal(first, second)


def test_feed_of_every_piece_is_kept():
    path = contours.polyline([[0.0, 0.0], [10e-3, 0.0], [20e-3, 0.0], [30e-3, 0.0]])
    feed = np.array([0.1, 0.02, 0.1])
    motion = jerk_limited(path, feed, LIMITS)
    actual = motion.at(np.linspace(0.0, motion.duration, 5000))
    piece = np.clip((actual.arc / 10e-3).astype(int), 0, 2)
    assert motion.stops.size == 2
    assert (actual.speed <= feed[piece] * (1 + 1e-9)).all()
    assert actual.speed[piece == 1].max() > 0.0199


def test_axes_without_a_limit_of_speed():
    """None of them is faster than the path: a limit above its feed changes nothing."""
    path = contours.polyline([[0.0, 0.0], [10e-3, 0.0], [20e-3, 5e-3]])
    given = {"acceleration": 3.0, "jerk": 150.0}
    free, high = (
        jerk_limited(path, FEED, AxisLimits.of(2, **given, **speed)).sampled(1e-3)
        for speed in ({}, {"speed": 2 * FEED})
    )
    np.testing.assert_array_equal(free, high)


@pytest.mark.parametrize("feed", [0.0, -1.0, np.nan])
def test_bad_feed_is_refused(feed):
    with pytest.raises(ValueError, match="feed"):
        jerk_limited(contours.circle(1e-2), feed, LIMITS)


@pytest.mark.parametrize("jerk", [0.0, np.inf, [np.inf, 1.0], [1.0, -1.0], [1.0, 2.0, 3.0]])
def test_bad_limit_is_refused(jerk):
    with pytest.raises(ValueError, match="jerk"):
        AxisLimits.of(2, 1.0, jerk)


def test_sample_period_has_to_be_positive():
    with pytest.raises(ValueError, match="dt"):
        jerk_limited(contours.circle(1e-2), FEED, LIMITS).sampled(0.0)


def test_ramps_over_a_stretch_of_no_length_take_no_time():
    """Two ramps of 0.1 mm at half a metre a second, 0.8 mm at one."""
    motion = ramped(np.array([0.0, 1e-3, 1e-3]), np.full(2, 1e-4))
    assert motion.time[-1] == pytest.approx(2 * 2e-4 + 0.8e-3)
    assert motion.at(motion.time[-1:]).arc == pytest.approx(1e-3)
