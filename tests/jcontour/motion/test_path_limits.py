"""Motions of random toolpaths keep their limits, and one that does not is recognised."""

import dataclasses

import numpy as np
import pytest

from jcontour.geometry import contours
from jcontour.geometry.contour import unpadded
from jcontour.motion.cornering import cornered
from jcontour.motion.jerk_limited.limits import AxisLimits
from tests.jcontour.motion import path_limits
from tests.jcontour.motion.path_limits import ratios_of, stopping_time


def test_time_of_stopping_in_closed_form():
    """Two lines that reach neither feed nor acceleration: each takes cbrt(32 length / jerk)."""
    limits = AxisLimits.of(2, acceleration=1e3, jerk=[1.0, 8.0])
    points = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 2.0]])
    assert stopping_time(points, np.full(2, 1e3), limits) == pytest.approx(4.0 + 2.0, rel=1e-12)


# a curve swings between its points where some moves have too few of them; likewise where the
# distance is known at them alone; a blend of 0.1 um has a curvature that is known to some digits
# only; a jerk turns by its third difference between two places that are looked at; a piece shorter
# than what is left of one between two blends ends the path; a cell of 27 ps is nothing but rounding
@pytest.mark.parametrize(
    ("seed", "kind"),
    [
        *((seed, None) for seed in (1, 3, 7)),
        (18, "rounded outlines in chords"),
        (41, "rounded outlines, feeds differ"),
        (90, "rounded outlines in chords"),
        (2930, "rounded outlines in chords"),
        (1526248, "lines of all lengths"),
        (1138783, "lines and arcs"),
        (15832, "lines back and forth, feeds differ"),
        (1616103, "lines and arcs"),
    ],
)
def test_a_path_keeps_all_limits(seed, kind):
    assert ratios_of(seed, kind).exceeded() == []


def test_a_jerk_above_its_limit_is_found(monkeypatch):
    def loose(contour, feed, limits, tolerance, alike):
        planned = cornered(contour, feed, limits._replace(jerk=1.1 * limits.jerk), tolerance)
        return planned._replace(motion=dataclasses.replace(planned.motion, limits=limits))

    monkeypatch.setattr(path_limits, "cornered", loose)
    assert ratios_of(4, "lines").exceeded() == ["jerk"]


def test_a_corner_cut_too_far_is_found(monkeypatch):
    def loose(contour, feed, limits, tolerance, alike):
        planned = cornered(contour, feed, limits, 2 * tolerance)
        apart = np.zeros_like(planned.around.apart)
        return planned._replace(around=dataclasses.replace(planned.around, apart=apart))

    monkeypatch.setattr(path_limits, "cornered", loose)
    assert ratios_of(4, "lines").exceeded() == ["deviation"]


@pytest.mark.parametrize("turn", [-4.5, -0.3, 0.3, 2.0, 6.0])
def test_the_distance_from_an_arc_is_that_from_its_nearest_point(turn):
    piece = unpadded(contours.arc([3e-3, 1e-3], [1e-3, 2e-3], turn)).taken(0)
    points = np.random.default_rng(1).uniform(-4e-3, 6e-3, (200, 2))
    on = piece.taken(None).jet(np.linspace(0.0, 1.0, 20_001) * piece.extent)[0]
    nearest = np.linalg.norm(points[:, None] - on, axis=2).min(axis=1)
    np.testing.assert_allclose(path_limits._to_arc(points, piece), nearest, atol=1e-7)
