"""Corners passed or stopped in, whichever is quicker, against closed forms."""

import numpy as np
import pytest

from jcontour.geometry import contours
from jcontour.geometry.pieces import Piece
from jcontour.geometry.toolpaths import parse_gcode
from jcontour.motion.blending import blended
from jcontour.motion.cornering import FINEST, WORTH, cornered, quickest
from jcontour.motion.feed_laws import SharpTurnError
from jcontour.motion.jerk_limited.limits import AxisLimits
from jcontour.motion.jerk_limited.planning import jerk_limited
from jcontour.motion.point_to_point import PointToPoint

LIMITS = AxisLimits.of(2, acceleration=3.0, jerk=150.0, speed=0.2)
# two lines that turn by 113 degrees: around them within this tolerance is slower than a stop
TIGHT = 1e-8  # [m]
SHARP = 1e-3 * np.array([[0.0, 0.0], [30.0, 0.0], [20.0, 24.0]])


def test_a_corner_that_is_slow_to_pass_is_stopped_in():
    path, feed = contours.polyline(SHARP), 0.1
    passed = jerk_limited(blended(path, TIGHT).path, feed, LIMITS)
    planned = cornered(path, np.full(2, feed), LIMITS, TIGHT)
    stopped = jerk_limited(path, feed, LIMITS)
    assert planned.motion.duration == stopped.duration < passed.duration
    assert planned.around.deviation == 0.0 and planned.motion.stops.size == 3


def test_rests_stop_the_motion_in_corners_and_on_lines():
    """The second joint is a corner that could be blended, the third lies on a line."""
    points = 1e-3 * np.array([[0, 0], [30, 0], [60, 5], [60, 30], [60, 50]])
    path, rest = contours.polyline(points), np.array([np.nan, 0.25, 0.5, 1.0])
    planned = cornered(path, np.full(4, 0.1), LIMITS, 20e-6, rest)
    parts = [points[:3], points[2:4], points[3:]]
    alone = [
        cornered(contours.polyline(part), np.full(len(part) - 1, 0.1), LIMITS, 20e-6).duration
        for part in parts
    ]
    np.testing.assert_allclose(np.diff(planned.motion.stopped), alone, rtol=1e-4)
    np.testing.assert_allclose(planned.rests.begin, np.cumsum(alone), rtol=1e-4)
    assert planned.duration == pytest.approx(planned.motion.duration + 1.75)
    arc = planned.motion.sampled(1e-3, planned.rests)
    held = np.isclose(arc, planned.motion.stops[:, None], rtol=0, atol=1e-13).sum(axis=1)
    np.testing.assert_allclose(held[1:], [250, 500, 1000], atol=3)


def test_a_corner_that_is_quick_to_pass_is_passed():
    path = contours.polyline(1e-3 * np.array([[0.0, 0.0], [30.0, 0.0], [60.0, 5.0]]))
    planned = cornered(path, np.full(2, 0.1), LIMITS, 20e-6)
    assert planned.motion.stops.size == 2 and planned.around.deviation > 0
    assert planned.motion.duration < jerk_limited(path, 0.1, LIMITS).duration


def test_no_stop_between_arcs_of_one_circle():
    """The two half turns are the full circle, which has no joint; on unequal axes, too."""
    limits = AxisLimits.of(2, acceleration=[1.0, 3.0], jerk=[50.0, 150.0])
    start, centre = np.array([1e-3, 0.0]), np.zeros(2)
    halves = [contours.arc(start, centre, np.pi), contours.arc(-start, centre, np.pi)]
    whole = contours.chain([contours.arc(start, centre, 2 * np.pi)])
    planned = cornered(contours.chain(halves), np.full(2, 0.05), limits, 2e-6)
    assert planned.motion.stops.size == 2
    quickest = jerk_limited(whole, 0.05, limits).duration
    np.testing.assert_allclose(planned.motion.duration, quickest, rtol=2e-3)


def test_lines_in_parts_are_stopped_in_as_whole_ones_are():
    """Nothing stops between the parts: the time from rest to rest is that of the whole line."""
    parts = np.linspace(SHARP[:-1], SHARP[1:], 4, endpoint=False)
    path = contours.polyline(np.vstack([*np.swapaxes(parts, 0, 1), SHARP[-1:]]))
    planned = cornered(path, np.full(8, 0.1), LIMITS, TIGHT)
    stopped = jerk_limited(contours.polyline(SHARP), 0.1, LIMITS)
    assert planned.motion.stops.size == 3 and planned.around.deviation == 0.0
    np.testing.assert_allclose(planned.motion.duration, stopped.duration, rtol=1e-9)


def test_a_line_is_stopped_on_where_that_is_the_quicker_change_of_the_feed():
    """Its last micrometre is slow: to come down to that feed takes about as long as to stop."""
    path = contours.polyline([[0.0, 0.0], [10e-3, 0.0], [10.001e-3, 0.0]])
    stopping = PointToPoint(10e-3, 0.01, 3.0, 150.0).duration
    stopping += PointToPoint(1e-6, 1e-4, 3.0, 150.0).duration
    planned = cornered(path, np.array([0.01, 1e-4]), LIMITS, 2e-6)
    assert planned.duration <= stopping * (1 + 1e-9)


def test_a_curve_that_turns_without_end_is_told_by_its_number_on_the_contour():
    """Behind three corners: the path with blends has more pieces before it."""
    polynomial = np.zeros((5, 6, 2))
    polynomial[:4, 0] = 1e-3 * np.array([[0, 0], [10, 0], [10, 10], [20, 10]])
    polynomial[:4, 1] = [[1, 0], [0, 1], [1, 0], [0, 1]]
    polynomial[4, :3] = [[20e-3, 20e-3], [0, 1], [1e9, 0]]  # its bend is 2e9 / m
    flat, none = np.zeros((5, 2)), np.zeros(5)
    path = contours.from_pieces(Piece(polynomial, flat, flat, none, none, np.full(5, 10e-3)))
    with pytest.raises(SharpTurnError) as told:
        cornered(path, np.full(5, 0.05), LIMITS, 2e-6, np.array([np.nan] * 3 + [0.0, np.nan]))
    assert told.value.piece == 4


def test_a_slow_program_leaves_its_tolerance_and_takes_no_longer():
    """Against the same path with blends as long as the tolerance allows."""
    angle = np.linspace(0.0, 2 * np.pi, 41)
    outline = contours.polyline(10e-3 * np.stack([np.cos(angle), np.sin(angle)], axis=1))
    limits = AxisLimits.of(2, acceleration=2.0, jerk=100.0)
    feed = np.full(40, 2e-3)
    whole = blended(outline, 5e-6)
    longest = jerk_limited(whole.path, whole.feed(feed), limits)
    actual = cornered(outline, feed, limits, 5e-6)
    assert actual.motion.stops.size == 2
    assert actual.duration < 1.001 * longest.duration
    assert actual.around.deviation < 0.2 * whole.deviation


def arcs(count: int = 72, radius: float = 4.0, begin: str = "") -> contours.Contour:
    """A circle [mm] in arcs whose ends are rounded to a micrometre, as CAM systems write them."""
    angle = 2 * np.pi * np.arange(count + 1) / count
    x, y = np.round([radius * np.cos(angle), radius * np.sin(angle)], 3)
    lines = [f"G3 X{x[k + 1]:.3f} Y{y[k + 1]:.3f} I{-x[k]:.3f} J{-y[k]:.3f}" for k in range(count)]
    program = "\n".join(["G21 F3000", begin or f"G0 X{radius}", *lines])
    return parse_gcode(program).contour


def test_a_large_tolerance_is_not_used_where_it_saves_no_time():
    """At 50 mm/s around 4 mm the feed takes half of the acceleration, whatever the tolerance."""
    path = arcs()
    limits = AxisLimits.of(2, acceleration=[1.5, 1.25], jerk=[75.0, 62.5], speed=0.2)
    feed = np.full(72, 0.05)
    near, far = (cornered(path, feed, limits, tolerance) for tolerance in (2e-6, 100e-6))
    assert quickest(path, feed, limits, 100e-6).around.deviation > 30e-6
    assert far.duration < (1 + WORTH) * near.duration
    assert far.around.deviation <= FINEST
    time = np.linspace(0, far.motion.duration, 5001)
    for values, limit in zip(far.motion.axes_at(time), limits, strict=True):
        assert (np.abs(values) <= limit * (1 + 1e-9)).all()


def test_a_tolerance_is_used_in_the_corners_that_need_it_alone():
    """Two sides with a corner between them lead to the circle; none is short enough for its run."""
    path = arcs(begin="G1 X-30 Y100\nX4 Y100\nX4 Y0")
    limits = AxisLimits.of(2, acceleration=[1.5, 1.25], jerk=[75.0, 62.5], speed=0.2)
    feed = np.full(path.rate.size, 0.05)
    whole, actual = (plan(path, feed, limits, 100e-6) for plan in (quickest, cornered))
    assert actual.duration < (1 + WORTH) * whole.duration
    assert actual.duration < 0.995 * cornered(path, feed, limits, 2e-6).duration
    in_corner = actual.around.piece <= 2
    assert actual.around.apart[in_corner].max() > 90e-6
    assert actual.around.apart[~in_corner].max() < 0.2 * whole.around.apart[~in_corner].max()
