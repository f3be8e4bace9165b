"""How far blends reach, against closed forms and against what a motion on them needs."""

import numpy as np
import pytest

from jcontour.geometry import contours
from jcontour.geometry.contour import unpadded
from jcontour.motion.blending import LEAST, Blends, as_needed, within, without_gaps
from jcontour.motion.jerk_limited.limits import EASE, AxisLimits

RIGHT_ANGLE = unpadded(contours.polyline([[0.0, 0.0], [20e-3, 0.0], [20e-3, 20e-3]]))
LIMITS = AxisLimits.of(2, acceleration=2.0, jerk=100.0, speed=0.5)
ANY = np.array([1.0])  # [m] a tolerance that does not act


def at_corner(reach: float, pieces=RIGHT_ANGLE) -> Blends:
    return Blends(pieces, np.array([0]), np.array([True]), np.array([reach]))


def test_within_a_tolerance_a_right_angle_has_a_closed_form():
    actual = within(at_corner(10e-3), np.array([10e-6]))
    np.testing.assert_allclose(actual.reach, 10e-6 * 8 / np.sqrt(2), rtol=2e-3)


def test_what_is_within_the_tolerance_already_keeps_its_reach():
    assert within(at_corner(1e-6), np.array([10e-6])).reach == 1e-6


@pytest.mark.parametrize("feed", [3e-3, 5e-3, 10e-3])
def test_a_right_angle_reaches_as_far_as_its_feed_needs(feed):
    """Its largest derivatives in arc length are looked for by differences of its points."""
    u = np.linspace(0.0, 1.0, 2001)
    points = np.stack([-((1 - u) ** 3), u**3], axis=1)
    arc = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1)))
    second = np.gradient(np.gradient(points, arc, axis=0), arc, axis=0)
    third = np.gradient(second, arc, axis=0)
    bend, twist = np.abs(second[5:-5]).max(), np.abs(third[5:-5]).max()
    needed = max(feed**2 * bend / (EASE * 2.0), np.sqrt(feed**3 * twist / (EASE * 100.0)))
    actual = as_needed(at_corner(2e-3), ANY, np.array([feed]), LIMITS)
    assert needed * 0.99 <= actual.reach[0] <= needed * 1.05


def test_what_cannot_be_passed_at_the_feed_keeps_its_reach():
    assert as_needed(at_corner(0.1e-3), ANY, np.array([0.1]), LIMITS).reach == 0.1e-3


def test_the_slowest_feed_leaves_a_hundredth():
    actual = as_needed(at_corner(1e-3), ANY, np.array([1e-9]), LIMITS).reach
    assert LEAST * 1e-3 <= actual[0] <= 1.05 * LEAST * 1e-3


def test_a_jump_of_the_curvature_reaches_as_far_as_the_jerk_needs():
    """The curvature goes from 0 to 1 / R as 1/2 + 9/8 x - 5/8 x^3, where x is from -1 to 1.

    That is the cubic that ends in the right place and direction. It is steepest at x = 0.
    """
    radius, feed = 5e-3, 30e-3
    pieces = unpadded(
        contours.chain(
            [
                contours.line([0.0, 0.0], [20e-3, 0.0]),
                contours.arc([20e-3, 0.0], [20e-3, radius], np.pi),
            ]
        )
    )
    blends = Blends(pieces, np.array([0]), np.array([False]), np.array([1e-3]))
    actual = as_needed(blends, ANY, np.array([feed]), LIMITS)
    needed = 9 / 8 * feed**3 / radius / (EASE * 100.0)
    assert needed * 0.99 < actual.reach[0] < needed * 1.05


def test_a_curve_that_limits_the_feed_limits_what_is_needed():
    """Where the arc allows 31.6 mm/s, a feed of 1 m/s needs no more than that speed."""
    radius = 0.5e-3
    pieces = unpadded(
        contours.chain(
            [
                contours.line([0.0, 0.0], [20e-3, 0.0]),
                contours.arc([20e-3, 0.0], [20e-3, radius], np.pi),
            ]
        )
    )
    limits = AxisLimits.of(2, acceleration=2.0, jerk=1e5)
    blends = Blends(pieces, np.array([0]), np.array([False]), np.array([20e-6]))
    quick, slow = (
        as_needed(blends, ANY, np.array([feed]), limits).reach
        for feed in (1.0, np.sqrt(2.0 * radius))
    )
    assert quick < 20e-6
    np.testing.assert_allclose(quick, slow, rtol=1e-6)


def test_an_axis_that_limits_the_speed_limits_what_is_needed():
    """Along X, then Y, at 3 mm/s: all that a feed of 1 m/s comes to where no axis may be faster."""
    slow = AxisLimits.of(2, acceleration=2.0, jerk=100.0, speed=3e-3)
    quick = as_needed(at_corner(2e-3), ANY, np.array([1.0]), slow).reach
    assert quick == as_needed(at_corner(2e-3), ANY, np.array([3e-3]), LIMITS).reach < 0.1e-3


def test_a_blend_that_deviates_more_where_it_is_shorter_stays():
    """Two arcs that bend away from the corner between them."""
    radius, length, turn = 33e-3, 7.9e-3, 0.0245
    first = contours.arc([0.0, 0.0], [0.0, -radius], -length / radius)
    end, heading = np.asarray(first.position(length)), -length / radius + turn
    centre = end + radius * np.array([np.sin(heading), -np.cos(heading)])
    pieces = unpadded(contours.chain([first, contours.arc(end, centre, -length / radius)]))
    whole = within(at_corner(0.5 * length, pieces), np.array([2e-6]))
    limits = AxisLimits.of(2, acceleration=2.0, jerk=100.0)
    for feed in (0.05, 0.08, 0.1, 0.12):
        actual = as_needed(whole, np.array([2e-6]), np.array([feed]), limits)
        assert actual.deviation() <= 2e-6
    unbounded = as_needed(whole, ANY, np.array([0.1]), limits)
    assert unbounded.deviation() > 2.2e-6  # it is the tolerance that keeps it from that


def test_a_blend_without_any_reach_is_left_alone():
    assert as_needed(at_corner(0.0), ANY, np.array([0.1]), LIMITS).reach == 0.0


def test_a_piece_that_two_blends_would_lose_is_left_by_shorter_ones():
    pieces = unpadded(contours.polyline([[0.0, 0.0], [1e-3, 0.0], [1e-3, 1e-3], [2e-3, 1e-3]]))
    two = Blends(pieces, np.array([0, 1]), np.ones(2, bool), np.full(2, 0.5e-3 - 0.2e-9))
    assert without_gaps(two).left()[1] > 1e-9
    met = two._replace(reach=np.full(2, 0.5e-3))
    np.testing.assert_array_equal(without_gaps(met).reach, met.reach)
