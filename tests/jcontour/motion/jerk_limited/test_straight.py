"""Straight stretches in closed form: which ones are taken, and where their nodes are."""

import numpy as np
import pytest

from jcontour.geometry import contours
from jcontour.motion.jerk_limited.joints import unpadded
from jcontour.motion.jerk_limited.limits import AxisLimits
from jcontour.motion.jerk_limited.straight import straight_motions
from jcontour.motion.point_to_point import PointToPoint

LIMITS = AxisLimits.of(2, acceleration=[3.0, 6.0], jerk=[150.0, 90.0], speed=[0.2, 0.05])


def motions(path, feed, stretch):
    pieces = unpadded(path)
    return straight_motions(pieces, np.broadcast_to(feed, pieces.extent.shape), LIMITS, stretch)


def test_a_stretch_is_one_motion_under_the_limits_of_its_direction():
    """Along (0.6, 0.8): speed 0.05 / 0.8, acceleration 3 / 0.6, jerk 90 / 0.8."""
    path = contours.polyline([[0.0, 0.0], [3e-3, 4e-3], [6e-3, 8e-3], [0.0, 8e-3]])
    first, second = motions(path, 0.1, np.array([0, 0, 1]))
    law = PointToPoint(10e-3, 0.05 / 0.8, 5.0, 90.0 / 0.8)
    time = np.linspace(0.0, law.duration, 101)
    np.testing.assert_allclose(first.at(time).arc, law(time), atol=1e-16)
    assert np.any(np.isclose(first.time, law.duration / 2))  # where the second piece begins
    assert second.coefficients[0, 0] == pytest.approx(10e-3, rel=1e-12)


def test_curves_and_changes_of_the_feed_have_no_closed_form():
    bend = contours.arc([20e-3, 0.0], [20e-3, 5e-3], np.pi / 2)
    path = contours.chain([contours.polyline([[0.0, 0.0], [10e-3, 0.0], [20e-3, 0.0]]), bend])
    assert motions(path, 0.1, np.array([0, 0, 1]))[1] is None
    assert motions(path, np.array([0.1, 0.2, 0.1]), np.array([0, 0, 1])) == [None, None]
