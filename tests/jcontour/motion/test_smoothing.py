"""Curves through short moves: within the tolerance both ways, with the curvature of the curve."""

import numpy as np
import pytest

from jcontour.geometry import contours
from jcontour.geometry.contour import unpadded
from jcontour.motion.blending import blended
from jcontour.motion.jerk_limited.limits import Asked, AxisLimits, joints
from jcontour.motion.jerk_limited.planning import jerk_limited
from jcontour.motion.smoothing import smooth_path

RADIUS, TOLERANCE = 20e-3, 2e-6
ROUNDING = 1e-6  # of coordinates in a file
LIMITS = AxisLimits.of(2, acceleration=2.0, jerk=100.0)


def chords(count: int, turn: float = 2 * np.pi, rounding: float = ROUNDING) -> np.ndarray:
    """Points of an arc from (RADIUS, 0), as a CAM system writes them."""
    angle = np.linspace(0.0, turn, count + 1)
    points = RADIUS * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return np.round(points / rounding) * rounding


def farthest(contour, other) -> float:
    """Greatest distance of points of one contour from another [m]."""
    points = contour.position(np.linspace(0.0, float(contour.length), 1501)[1:-1])
    nearest = other.position(other.nearest_anywhere(points))
    return float(np.linalg.norm(np.subtract(points, nearest), axis=1).max())


def curvature(path) -> np.ndarray:
    return np.asarray(path.curvature(np.linspace(0.0, float(path.length), 500)))


def test_short_chords_become_the_curve_that_they_stand_for():
    rough = contours.polyline(chords(600, turn=np.pi))
    actual = smooth_path(rough, TOLERANCE)
    assert max(farthest(actual.path, rough), farthest(rough, actual.path)) <= actual.deviation
    assert actual.deviation <= TOLERANCE
    assert farthest(actual.path, contours.circle(RADIUS)) < TOLERANCE
    assert actual.path.rate.size < 60
    bends = curvature(actual.path)
    np.testing.assert_allclose(bends[5:-5], 1 / RADIUS, rtol=0.2)
    assert bends.max() < 3 / RADIUS  # at the ends, which are kept with their rounding


def test_it_takes_as_long_as_the_curve():
    """Along the chords themselves, blended at every one of them, it takes six times as long."""
    circle, feed = contours.arc([RADIUS, 0.0], [0.0, 0.0], 2 * np.pi), 0.05
    around = smooth_path(contours.polyline(chords(4000)), TOLERANCE)
    taken = jerk_limited(around.path, feed, LIMITS).duration
    assert taken == pytest.approx(jerk_limited(circle, feed, LIMITS).duration, rel=2e-3)


def test_arcs_of_a_cam_system_are_smoothed_too():
    """A spiral in arcs of 2 degrees whose radius jumps by 10 um each."""
    direction, place, parts = np.array([0.0, 1.0]), np.array([5e-3, 0.0]), []
    for k in range(90):
        radius, turn = 5e-3 + 10e-6 * k, np.radians(2.0)
        inward = np.array([-direction[1], direction[0]])
        parts.append(contours.arc(place, place + radius * inward, turn))
        place = np.asarray(parts[-1].position(parts[-1].length))
        direction = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]) @ (
            direction
        )
    rough = contours.chain(parts)
    actual = smooth_path(rough, TOLERANCE)
    assert actual.path.rate.size < 45
    assert max(farthest(actual.path, rough), farthest(rough, actual.path)) <= actual.deviation
    bends = curvature(actual.path)
    assert np.abs(np.diff(bends)).max() < 0.2 * (1 / 5e-3 - 1 / 5.9e-3)  # of the whole change


def test_a_longer_line_is_left_tangentially():
    arc = chords(400, turn=np.pi / 2)
    points = np.vstack([[RADIUS, -10e-3], arc, arc[-1] - [10e-3, 0.0]])
    actual = smooth_path(contours.polyline(points), TOLERANCE)
    inner = joints(unpadded(actual.path))
    assert inner.turn.max() < 1e-9
    lines = np.flatnonzero(np.asarray(actual.path.extent) > 5e-3)
    np.testing.assert_array_equal(actual.piece[lines], [0, 401])
    assert actual.deviation <= TOLERANCE


def test_corners_stay():
    side = np.linspace(0.0, 10e-3, 51)[:-1]
    zero, full = 0 * side, 0 * side + 10e-3
    legs = [(side, zero), (full, side), (10e-3 - side, full), (zero, 10e-3 - side)]
    points = np.vstack([np.stack(leg, axis=1) for leg in legs])
    actual = smooth_path(contours.polygon(points), TOLERANCE)
    expected = blended(contours.polygon(10e-3 * np.array([[0, 0], [1, 0], [1, 1], [0, 1]])), 2e-6)
    assert farthest(actual.path, expected.path) < TOLERANCE
    assert actual.deviation <= TOLERANCE


def rounded(radius: float, chord: float, side: float) -> np.ndarray:
    """Points of half circles in chords with straight sides between them, as around a pad."""
    angle = np.linspace(0.0, np.pi, int(np.pi * radius / chord) + 1)
    half = radius * np.stack([np.sin(angle), -np.cos(angle)], axis=1)
    points = np.vstack([half + [side, 0.0], -half, [side, -radius], [side, -radius - side]])
    return np.round(points, 8)  # 0.01 um


@pytest.mark.parametrize("radius", [0.15e-3, 1.1e-3])
@pytest.mark.parametrize("side", [0.05e-3, 0.175e-3, 1.2e-3])
def test_long_and_short_moves_of_one_run_stay_within_the_tolerance(radius, side):
    """Far from the points that it is fitted to, a curve may swing."""
    rough = contours.polyline(rounded(radius, 10.5e-6, side))
    actual = smooth_path(rough, TOLERANCE)
    assert actual.path.rate.size < rough.rate.size / 2  # it is smoothed at all
    assert max(farthest(actual.path, rough), farthest(rough, actual.path)) <= actual.deviation
    assert actual.deviation <= TOLERANCE


def test_where_the_feed_changes_the_run_ends():
    rough = contours.polyline(chords(800, turn=np.pi))
    feed = np.where(np.arange(800) < 300, 0.05, 0.02)
    actual = smooth_path(rough, TOLERANCE, alike=feed[1:] == feed[:-1])
    np.testing.assert_allclose(
        actual.place[np.flatnonzero(np.diff(actual.feed(feed)))[0] + 1],
        np.sum(np.asarray(rough.extent)[:300]),
        atol=0.5e-3,  # the blend there begins before
    )
    assert set(np.unique(actual.feed(feed))) == {0.02, 0.05}


def test_a_stop_that_is_asked_for_stays_a_joint():
    rough = contours.polyline(chords(800, turn=np.pi, rounding=1e-9))
    allowed = np.ones(799, bool)
    allowed[399] = False
    actual = smooth_path(rough, TOLERANCE, allowed)
    stop = float(np.sum(np.asarray(rough.extent)[:400]))
    at = np.flatnonzero(np.abs(actual.place - stop) < 1e-12)
    assert at.size == 1
    begin = np.asarray(actual.path.start)[at[0]]
    np.testing.assert_allclose(actual.path.position(begin), rough.position(stop), atol=1e-12)


def test_true_arc_runs_along_the_moves():
    rough = contours.polyline(chords(800, turn=np.pi))
    actual = smooth_path(rough, TOLERANCE)
    on_path = np.linspace(0.0, float(actual.path.length), 2001)
    arc = actual.true_arc(on_path)
    assert arc[0] == 0.0 and arc[-1] == float(rough.length) and (np.diff(arc) > 0).all()
    apart = np.asarray(actual.path.position(on_path)) - np.asarray(rough.position(arc))
    assert np.linalg.norm(apart, axis=1).max() < 2 * TOLERANCE


@pytest.mark.parametrize("tolerance", [0.0, TOLERANCE])
def test_without_short_moves_it_is_the_blended_path(tolerance):
    square = contours.polygon(10e-3 * np.array([[0, 0], [1, 0], [1, 1], [0, 1]]))
    actual, expected = smooth_path(square, tolerance), blended(square, tolerance)
    np.testing.assert_array_equal(actual.path.polynomial, expected.path.polynomial)


def test_bad_input_is_named():
    rough = contours.polyline(chords(10))
    with pytest.raises(ValueError, match="tolerance"):
        smooth_path(rough, -1e-6)
    with pytest.raises(ValueError, match="allowed: needs shape"):
        smooth_path(rough, TOLERANCE, allowed=np.ones(3, bool))
    with pytest.raises(ValueError, match="alike: needs shape"):
        smooth_path(rough, TOLERANCE, alike=np.ones(3, bool))


def test_a_run_and_a_corner_share_the_tolerance():
    """Chords with a sagitta of a third of it, and a right angle that uses what they leave."""
    sagitta = TOLERANCE / 3
    turn = 40 * 2 * np.arccos(1 - sagitta / RADIUS)
    points = chords(40, turn, rounding=1e-12)
    ahead = np.array([-np.sin(turn), np.cos(turn)])
    aside = points[-1] + 5e-3 * ahead
    rough = contours.polyline([*points, aside, aside + 5e-3 * np.array([ahead[1], -ahead[0]])])
    actual = smooth_path(rough, TOLERANCE)
    assert actual.blend.any()
    assert sagitta / 2 < farthest(actual.path, rough) <= actual.deviation <= TOLERANCE


@pytest.mark.parametrize("feed", [np.ones(3), np.full(9, np.inf), np.zeros(9), np.ones((9, 1))])
def test_a_feed_that_is_not_of_the_pieces_is_named(any_type, feed):
    rough = contours.polyline(chords(9))
    asked = Asked(feed, LIMITS)
    for path in (smooth_path, blended):
        with pytest.raises(ValueError, match="feed: needs"):
            path(rough, TOLERANCE, asked=asked)
