"""Motions of piecewise constant jerk against splines of SciPy."""

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline

from jcontour.geometry import contours
from jcontour.geometry.contour import unpadded
from jcontour.motion.jerk_limited.cubic_motion import straight_motions, through
from jcontour.motion.jerk_limited.limits import AxisLimits
from jcontour.motion.point_to_point import PointToPoint


def ramp(count: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Uneven times, and places of a smooth motion from rest to rest."""
    steps = np.random.default_rng(seed).uniform(0.5, 1.5, count)
    time = 3.0 + np.append(0.0, np.cumsum(steps)) / steps.sum()
    q = time - time[0]
    return time, 0.1 * (10 * q**3 - 15 * q**4 + 6 * q**5)


def spline_from_rest(time: np.ndarray, arc: np.ndarray):
    """Cubic spline with one more knot in the first and in the last interval, at rest at both."""
    middle = 0.5 * (time[[0, -2]] + time[[1, -1]])
    nodes = np.sort(np.concatenate([time, middle]))
    knots = np.concatenate([[nodes[0]] * 3, nodes, [nodes[-1]] * 3])
    still = [(1, 0.0), (2, 0.0)]
    return make_interp_spline(time, arc, k=3, t=knots, bc_type=(still, still)), nodes


@pytest.mark.parametrize("counts", [[40], [5, 12, 30], [2, 3]])
def test_splines_of_several_motions_are_those_of_each(counts):
    parts = [ramp(count, seed) for seed, count in enumerate(counts)]
    time, arc = (np.concatenate(rows) for rows in zip(*parts, strict=True))
    actual = through(time, arc, np.cumsum([0, *(one[0].size for one in parts)]))
    assert actual is not None and len(actual) == len(counts)
    for motion, part in zip(actual, parts, strict=True):
        expected, nodes = spline_from_rest(*part)
        np.testing.assert_allclose(motion.time, nodes, rtol=1e-15)
        at = np.linspace(nodes[0], nodes[-1], 201)
        samples = motion.at(at)
        for k, size in ((0, 1e-14), (1, 1e-13), (2, 1e-11)):
            np.testing.assert_allclose(samples[k], expected(at, nu=k), atol=size)
        assert samples.speed[0] == 0 and samples.acceleration[0] == 0


def test_a_motion_that_goes_back_is_none():
    time, arc = ramp(20, seed=0)
    arc[10] = arc[9]  # it stands still for a moment: the spline overshoots
    assert through(time, arc, np.array([0, time.size])) is None


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
