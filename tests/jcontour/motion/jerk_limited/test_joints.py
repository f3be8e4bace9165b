"""Jumps where a line meets an arc, against the arc's radius and the angle between both."""

import numpy as np
import pytest

from jcontour.geometry import contours
from jcontour.geometry.contour import unpadded
from jcontour.motion.jerk_limited.cubic_motion import MotionSamples, composed
from jcontour.motion.jerk_limited.limits import BEND, TURN, everywhere, joints

RADIUS = 5e-3  # [m]
TANGENT = contours.chain(
    [
        contours.line([0.0, 0.0], [20e-3, 0.0]),
        contours.arc([20e-3, 0.0], [20e-3, RADIUS], np.pi / 2),
        contours.line([20e-3 + RADIUS, RADIUS], [20e-3 + RADIUS, 20e-3]),
    ]
)


def test_a_line_and_an_arc_differ_by_the_curvature_alone():
    actual = joints(unpadded(TANGENT))
    np.testing.assert_allclose(actual.turn, 0.0, atol=TURN / 100)
    np.testing.assert_allclose(actual.bend, 1 / RADIUS, rtol=1e-12)


def test_two_lines_differ_by_the_chord_of_their_angle():
    turn = 0.4  # [rad]
    corner = contours.polyline(
        [[0, 0], [1e-2, 0], [1e-2 * (1 + np.cos(turn)), 1e-2 * np.sin(turn)]]
    )
    actual = joints(unpadded(corner))
    np.testing.assert_allclose(actual.turn, 2 * np.sin(turn / 2), rtol=1e-12)
    np.testing.assert_allclose(actual.bend, 0.0, atol=1e-9)
    assert not actual.smooth(np.full(2, 1e-9), 1e9).any()  # it is not passed, however slow


@pytest.mark.parametrize(
    ("feeds", "expected"),
    [([0.9, 2.0, 0.9], [True, True]), ([1.1, 1.1, 0.9], [False, True])],
)
def test_a_joint_is_passed_at_the_lower_feed_of_its_two_pieces(feeds, expected):
    """Feeds in parts of that at which the acceleration jumps by as much as rounding."""
    acceleration = 3.0  # [m/s^2]
    rounding = np.sqrt(BEND * acceleration * RADIUS)  # [m/s]
    actual = joints(unpadded(TANGENT))
    passed = actual.smooth(rounding * np.array(feeds), acceleration)
    np.testing.assert_array_equal(passed, expected)


def test_a_stack_of_contours_is_refused():
    with pytest.raises(ValueError, match="one contour"):
        unpadded(contours.stack([TANGENT, contours.circle(RADIUS)]))


@pytest.mark.parametrize(("off", "jumps"), [(1e-10, False), (1e-7, True)])
def test_a_jump_of_curvature_is_one_where_it_is_more_than_rounding(off, jumps):
    """Of arcs of 0.1 um, at a feed that no machine has there: the curvature counts."""
    first = contours.arc([1e-7, 0.0], [0.0, 0.0], 1.0)
    start = np.asarray(first.position(first.length))
    second = contours.arc(start, -off * start, 1.0)
    actual = joints(unpadded(contours.chain([first, second])))
    assert actual.smooth(np.ones(2), 1.0).all() != jumps
    np.testing.assert_allclose(actual.bend, 1e7 * off if jumps else 0.0, rtol=1e-5)


def test_everywhere_is_nine_places_of_every_piece():
    square = contours.polygon([(0, 0), (20e-3, 0), (20e-3, 20e-3), (0, 20e-3)])
    first, _, _ = everywhere(unpadded(square))
    assert first.shape == (9, 4, 2)
    assert np.allclose(first, [[1, 0], [0, 1], [-1, 0], [0, -1]])


def test_composed_is_the_rule_of_the_chain():
    """(sin s, s^3) with s = t^2 at t = 0.8: derivatives of sin t^2 and t^6 by hand."""
    t = 0.8
    s = t**2
    path = np.array([[np.cos(s), 3 * s**2], [-np.sin(s), 6 * s], [-np.cos(s), 6.0]])
    motion = MotionSamples(*(np.array(value) for value in (s, 2 * t, 2.0, 0.0)))
    first, second, third = composed(path, motion)
    assert first == pytest.approx([2 * t * np.cos(s), 6 * t**5])
    assert second == pytest.approx([2 * np.cos(s) - 4 * s * np.sin(s), 30 * t**4])
    assert third == pytest.approx([-12 * t * np.sin(s) - 8 * t**3 * np.cos(s), 120 * t**3])
