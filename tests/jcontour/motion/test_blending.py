"""Blends against the true geometry, measured both ways, and against closed forms."""

import numpy as np
import pytest

from jcontour.geometry import contours
from jcontour.geometry.contour import unpadded
from jcontour.motion.blending import blended
from jcontour.motion.jerk_limited.limits import Asked, AxisLimits, joints

SQUARE = contours.polygon([(0, 0), (20e-3, 0), (20e-3, 20e-3), (0, 20e-3)])
SLOT = contours.chain(
    [
        contours.line([0.0, 0.0], [20e-3, 0.0]),
        contours.arc([20e-3, 0.0], [20e-3, 5e-3], np.pi),
        contours.line([20e-3, 10e-3], [0.0, 10e-3]),
    ]
)


def farthest(contour, other) -> float:
    """Greatest distance of points of one contour from another [m]."""
    points = contour.position(np.linspace(0.0, float(contour.length), 2001)[1:-1])
    nearest = other.position(other.nearest_anywhere(points))
    return float(np.linalg.norm(points - nearest, axis=1).max())


@pytest.mark.parametrize(("contour", "tolerance"), [(SQUARE, 1e-6), (SLOT, 100e-6)])
def test_deviation_is_within_the_tolerance_both_ways(contour, tolerance):
    actual = blended(contour, tolerance)
    there, back = farthest(actual.path, contour), farthest(contour, actual.path)
    assert max(there, back) <= actual.deviation * (1 + 1e-6) <= tolerance
    assert actual.deviation > 0.9 * tolerance


def test_right_angle_uses_the_whole_tolerance():
    """On a right angle the deviation is d sqrt(2) / 8 at the corner."""
    actual = blended(SQUARE, 10e-6)
    cut = np.asarray(actual.path.extent)[0]
    np.testing.assert_allclose(20e-3 - cut, 0.99 * 10e-6 * 8 / np.sqrt(2), rtol=2e-3)


@pytest.mark.parametrize("contour", [SQUARE, SLOT])
def test_direction_and_curvature_are_continuous(contour):
    inner = joints(unpadded(blended(contour, 20e-6).path))
    assert inner.turn.max() < 1e-9
    assert inner.bend.max() < 1e-6 * (float(blended(contour, 20e-6).path.curvature(0.0)) + 1e4)


def test_true_arc_runs_along_the_contour():
    actual = blended(SLOT, 20e-6)
    arc = actual.true_arc(np.linspace(0.0, float(actual.path.length), 2001))
    assert arc[0] == 0.0 and arc[-1] == float(SLOT.length) and (np.diff(arc) > 0).all()
    apart = actual.path.position(np.linspace(0.0, float(actual.path.length), 2001))
    assert np.linalg.norm(np.subtract(apart, SLOT.position(arc)), axis=1).max() < 100e-6


def test_feed_of_a_blend_is_the_lower_one():
    actual = blended(SQUARE, 10e-6)
    feed = actual.feed(np.array([4.0, 3.0, 2.0, 1.0]))
    assert feed[actual.blend][0] == 3.0 and set(feed[~actual.blend]) == {1.0, 2.0, 3.0, 4.0}


def test_zero_tolerance_leaves_the_contour():
    assert blended(SQUARE, 0.0).path is SQUARE


def test_what_is_not_allowed_stays():
    actual = blended(SQUARE, 10e-6, np.array([True, False, True]))
    assert np.unique(actual.piece[actual.blend]).tolist() == [0, 2]


def test_reversal_stays_a_corner():
    to_and_fro = contours.polyline([[0.0, 0.0], [10e-3, 0.0], [0.0, 0.1e-3]])
    assert not blended(to_and_fro, 10e-6).blend.any()


@pytest.mark.parametrize("tolerance", [-1.0, np.nan, np.inf])
def test_bad_tolerance_is_refused(tolerance):
    with pytest.raises(ValueError, match="tolerance"):
        blended(SQUARE, tolerance)
    with pytest.raises(ValueError, match="allowed"):
        blended(SQUARE, 1e-6, np.ones(5, bool))


def test_the_slightest_bend_that_would_stop_a_motion_is_blended():
    """A line leads into an arc of 5 km: at 0.1 m/s the acceleration jumps by 2 um/s^2."""
    radius, feed, acceleration = 5e3, 0.1, 0.1
    path = contours.chain(
        [
            contours.line([0.0, 0.0], [10e-3, 0.0]),
            contours.arc([10e-3, 0.0], [10e-3, radius], 10e-3 / radius),
        ]
    )
    assert not joints(unpadded(path)).smooth(np.full(2, feed), acceleration).any()
    actual = blended(path, 2e-6)
    feeds = np.full(actual.piece.size, feed)
    assert joints(unpadded(actual.path)).smooth(feeds, acceleration).all()


def test_two_blends_leave_no_gap_that_turns():
    """Each takes half of the shorter arc beside it: of the middle one 0.5 nm would be left."""
    length, place, heading, arcs = [0.1e-3 - 1e-9, 0.1e-3, 0.15e-3], np.zeros(2), 0.0, []
    for radius, along in zip([0.2e-3, 0.1e-3, 0.2e-3], length, strict=True):
        inward = np.array([-np.sin(heading), np.cos(heading)])
        arcs.append(contours.arc(place, place + radius * inward, along / radius))
        place, heading = np.asarray(arcs[-1].position(along)), heading + along / radius
    actual = blended(contours.chain(arcs), 1e-3)
    assert actual.blend.any()
    changes = joints(unpadded(actual.path))
    assert changes.turn.max() < 1e-12 and changes.bend.max() < 1e-6


def test_the_shortest_piece_stays_where_nothing_is_cut_off_it():
    """It is shorter than what has to be left of a piece between two blends."""
    path = contours.polyline(1e-3 * np.array([[0, 0], [10, 0], [10, 10], [10 + 5e-7, 10]]))
    actual = blended(path, 10e-6, np.array([True, False]))
    assert actual.piece.max() == 2 and actual.joint(np.array([1])) == actual.piece.size - 2
    np.testing.assert_array_equal(np.asarray(actual.path.extent)[-1], np.asarray(path.extent)[2])


def test_rounding_of_a_curvature_is_no_jump_of_it():
    first = contours.arc([1e-3, 0.0], [0.0, 0.0], 1.0)
    start = np.asarray(first.position(first.length))
    for off, blends in ((1e-15, False), (1e-6, True)):
        second = contours.arc(start, -off * start, 1.0)
        assert blended(contours.chain([first, second]), 1e-6).blend.any() == blends


def test_what_is_used_of_the_tolerance_is_not_used_twice():
    used = np.array([0.0, 4e-6, 9e-6])
    actual = blended(SQUARE, 10e-6, used=used)
    sides = np.asarray(actual.path.extent)[~actual.blend]
    reach = 8 / np.sqrt(2) * 0.99 * (10e-6 - used)  # d sqrt(2) / 8 at a right angle
    cut = np.convolve(reach, [1.0, 1.0])  # of every side, at one corner or at both
    np.testing.assert_allclose(20e-3 - sides, cut, rtol=2e-3)
    assert 9.9e-6 < actual.deviation <= 10e-6


def test_a_piece_of_a_nanometre_is_not_lost_where_one_end_of_it_is_cut_off():
    """There and back, then on: nothing blends the turn, and half of 1.2 nm would be left."""
    points = [[0.0, 0.0], [15e-6, 0.0], [15e-6 - 1.2e-9, 0.0], [20e-6, 60e-6], [90e-6, 60e-6]]
    around = blended(contours.polyline(points), 3e-6)
    pieces = unpadded(around.path)
    ends = pieces.taken(slice(None, -1)).jet(pieces.extent[:-1])[0]
    begins = pieces.taken(slice(1, None)).jet(0.0 * pieces.extent[1:])[0]
    assert np.linalg.norm(ends - begins, axis=1).max() < 1e-13
    np.testing.assert_array_equal(np.unique(around.piece[around.blend]), [2])


def test_each_joint_has_the_reach_that_the_slower_side_needs():
    limits, feed = AxisLimits.of(2, acceleration=2.0, jerk=100.0), np.array([0.1, 3e-3, 0.1, 0.1])
    actual = blended(SQUARE, 50e-6, asked=Asked(feed, limits))
    sides = 20e-3 - np.asarray(actual.path.extent)[~actual.blend]
    long, short = sides[3], sides[0]
    assert short < 0.5 * long
    np.testing.assert_allclose(sides, [short, 2 * short, short + long, long], rtol=1e-9)
