"""Curves that follow runs: within the tolerance, from end to end, each as if it were alone."""

import numpy as np
import pytest

from jcontour.geometry import contours
from jcontour.geometry.contour import unpadded
from jcontour.motion import runs as follower
from jcontour.motion.jerk_limited.limits import EASE, Asked, AxisLimits, everywhere
from jcontour.motion.runs import CLOSEST, PER_CELL, Runs, followed

TOLERANCE = 1e-6


def arc_chords(count: int, radius: float, turn: float) -> np.ndarray:
    angle = np.linspace(0.0, turn, count + 1)
    return radius * np.stack([np.sin(angle), 1 - np.cos(angle)], axis=1)


def runs_of(*points: np.ndarray) -> Runs:
    """Runs along points, one behind the other."""
    pieces = [unpadded(contours.polyline(row)) for row in points]
    count = [one.extent.size for one in pieces]
    whole = type(pieces[0])(*(np.concatenate(rows) for rows in zip(*pieces, strict=True)))
    ends = np.append(0.0, np.cumsum(whole.extent))
    none = np.full((2, len(points), 2), np.nan)
    return Runs(whole, np.repeat(np.arange(len(points)), count), ends, none)


def distance_from(points: np.ndarray, where: np.ndarray) -> np.ndarray:
    """Least distance of places from the lines through points, by projection on every line."""
    start, along = points[:-1], np.diff(points, axis=0)
    share = np.einsum("qpm,pm->qp", where[:, None] - start, along) / np.sum(along**2, axis=1)
    nearest = start + np.clip(share, 0.0, 1.0)[..., None] * along
    return np.linalg.norm(where[:, None] - nearest, axis=-1).min(axis=1)


def places_of(fit, which) -> np.ndarray:
    s = fit.extent[which, None] * np.linspace(0.0, 1.0, 9)
    powers = s[..., None] ** np.arange(6)
    return np.einsum("pqk,pkm->pqm", powers, fit.polynomial[which]).reshape(-1, 2)


WAVE = np.stack([np.linspace(0.0, 8e-3, 400), 1e-3 * np.sin(np.linspace(0.0, 9.0, 400))], axis=1)
ROUGH = WAVE + np.random.default_rng(0).uniform(-3e-7, 3e-7, WAVE.shape)
MANY = (arc_chords(90, 5e-3, 2.0), ROUGH, arc_chords(5, 20e-3, 0.05), WAVE[::-1])


def test_every_run_is_followed_within_the_tolerance_from_end_to_end():
    curves = followed(runs_of(*MANY), TOLERANCE)
    assert np.all(np.diff(curves.run) >= 0)
    for k, points in enumerate(MANY):
        where = places_of(curves.fit, curves.run == k)
        np.testing.assert_allclose(where[[0, -1]], points[[0, -1]], atol=1e-13)
        assert distance_from(points, where).max() <= curves.deviation[k] <= 1.01 * TOLERANCE


def test_runs_followed_a_few_at_a_time_are_those_of_all_together(monkeypatch):
    runs, feeds = runs_of(*MANY), np.repeat([0.1, 0.2, 0.3, 0.05], [len(row) - 1 for row in MANY])
    whole = followed(runs, TOLERANCE, Asked(feeds, LIMITS))
    monkeypatch.setattr(follower, "AT_ONCE", 100)
    parts = followed(runs, TOLERANCE, Asked(feeds, LIMITS))
    np.testing.assert_array_equal(parts.run, whole.run)
    np.testing.assert_allclose(parts.deviation, whole.deviation, atol=1e-3 * TOLERANCE)
    np.testing.assert_allclose(parts.fit.begin, whole.fit.begin, rtol=1e-12)
    np.testing.assert_allclose(parts.fit.extent, whole.fit.extent, rtol=1e-9)
    every = np.arange(whole.run.size)
    np.testing.assert_allclose(places_of(parts.fit, every), places_of(whole.fit, every), atol=1e-12)
    assert parts.fit.error == pytest.approx(whole.fit.error, rel=1e-3)


def test_a_run_does_not_feel_the_others():
    together = followed(runs_of(*MANY), TOLERANCE)
    for k, points in enumerate(MANY):
        alone, mine = followed(runs_of(points), TOLERANCE), together.run == k
        np.testing.assert_allclose(together.fit.extent[mine], alone.fit.extent, rtol=1e-9)
        assert together.deviation[k] == pytest.approx(alone.deviation[0], abs=1e-3 * TOLERANCE)


def test_a_run_that_no_curve_follows_has_none():
    """A zigzag needs more knots than it has lines; its neighbours do not."""
    zigzag = np.stack([np.arange(40) * 1e-4, 1e-4 * (np.arange(40) % 2)], axis=1)
    curves = followed(runs_of(ROUGH, zigzag, WAVE), TOLERANCE)
    np.testing.assert_array_equal(np.unique(curves.run), [0, 2])
    assert np.isinf(curves.deviation[1])


def test_runs_without_any_curve():
    zigzag = np.stack([np.arange(40) * 1e-4, 1e-4 * (np.arange(40) % 2)], axis=1)
    for points in (zigzag, zigzag[:2]):  # a single line is too few for any knots
        curves = followed(runs_of(points), TOLERANCE)
        assert curves.run.size == curves.fit.extent.size == 0


def test_given_directions_are_kept():
    points = arc_chords(2 * PER_CELL, 5e-3, 1.0)
    begin, end = np.array([1.0, 0.0]), np.array([np.cos(1.0), np.sin(1.0)])
    runs = runs_of(points)._replace(tangents=np.stack([begin, end])[:, None])
    fit = followed(runs, TOLERANCE).fit
    np.testing.assert_allclose(fit.polynomial[0, 1], begin, atol=1e-15)
    slope = (np.arange(6) * fit.extent[-1] ** np.maximum(np.arange(6) - 1, 0)) @ fit.polynomial[-1]
    np.testing.assert_allclose(slope, end, atol=1e-9)


LIMITS = AxisLimits.of(2, acceleration=[2.0, 3.0], jerk=[100.0, 150.0])


def asked_of(runs: Runs, *feed: float) -> Asked:
    """One feed for every run."""
    return Asked(np.array(feed)[runs.of], LIMITS)


def farthest_of(points: np.ndarray, curves, k: int) -> float:
    return distance_from(points, places_of(curves.fit, curves.run == k)).max()


def test_a_slow_feed_is_followed_more_closely_as_far_as_it_is_easy():
    runs, feed = runs_of(*MANY), 2e-3
    far, close = (followed(runs, 20e-6, one) for one in (None, asked_of(runs, *[feed] * 4)))
    _, second, third = np.abs(everywhere(close.fit.pieces()))
    assert (second * feed**2 <= 1.001 * EASE * LIMITS.acceleration).all()
    assert (third * feed**3 <= 1.01 * EASE * LIMITS.jerk).all()
    for k, points in enumerate(MANY):
        assert farthest_of(points, close, k) <= close.deviation[k] <= far.deviation[k]
    for k in (1, 3):  # the other two are near their arcs as they are
        assert close.deviation[k] < 0.1 * far.deviation[k]


def test_a_quick_feed_leaves_the_curve_as_it_is():
    runs = runs_of(*MANY)
    far, quick = followed(runs, TOLERANCE), followed(runs, TOLERANCE, asked_of(runs, *[1.0] * 4))
    np.testing.assert_array_equal(quick.fit.polynomial, far.fit.polynomial)
    np.testing.assert_array_equal(quick.deviation, far.deviation)


def test_axes_that_are_slow_make_a_quick_feed_a_slow_one():
    slow = LIMITS._replace(speed=np.full(2, 2e-3))
    runs = runs_of(WAVE)
    limited = followed(runs, 20e-6, asked_of(runs, 1.0)._replace(limits=slow))
    assert limited.deviation < 0.1 * followed(runs, 20e-6).deviation


def test_each_run_is_followed_as_its_own_feed_asks():
    waves, feeds = (WAVE, WAVE[::-1], ROUGH, ROUGH[::-1]), (1e-3, 1.0, 1.0, 1e-3)
    runs = runs_of(*waves)
    together, whole = followed(runs, 20e-6, asked_of(runs, *feeds)), followed(runs, 20e-6)
    for k, feed in enumerate(feeds):
        alone = followed(runs_of(waves[k]), 20e-6, asked_of(runs_of(waves[k]), feed))
        extent = together.fit.extent[together.run == k]
        np.testing.assert_allclose(extent, alone.fit.extent, rtol=1e-9)
        closer = together.deviation[k] < 0.1 * whole.deviation[k]
        assert closer == (feed < 1.0)


def test_a_run_is_as_close_as_the_quickest_of_its_pieces_lets_it_be():
    runs = runs_of(WAVE)
    feed = np.full(runs.of.size, 2e-3)
    slow = followed(runs, 20e-6, Asked(feed, LIMITS))
    feed[-1] = 1.0
    quick = followed(runs, 20e-6, Asked(feed, LIMITS))
    assert slow.deviation < 0.1 * quick.deviation
    np.testing.assert_array_equal(quick.deviation, followed(runs, 20e-6).deviation)


def test_the_rounding_of_coordinates_is_not_followed():
    """Chords rounded to 1 um: the knots that half of the distance takes would be many."""
    fine = np.round(arc_chords(4000, 20e-3, 2.0) / 1e-6) * 1e-6
    runs = runs_of(fine)
    slow, whole = followed(runs, 20e-6, asked_of(runs, 1e-3)), followed(runs, 20e-6)
    assert slow.run.size <= 4 * whole.run.size
    assert slow.deviation > 0.3e-6


def test_a_curve_that_is_close_enough_is_not_brought_closer():
    """The feed would let it be followed to nanometres."""
    runs = runs_of(WAVE)
    actual = followed(runs, 20e-6, asked_of(runs, 1e-9))
    assert CLOSEST / 8 * 20e-6 < actual.deviation <= CLOSEST * 20e-6
