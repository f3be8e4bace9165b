"""Figure of a jerk-limited motion: true over the way, with rapid moves apart and stops marked."""

from functools import cache

import numpy as np
import pytest

from jcontour.app.reports.figures.motion import motion_figure
from jcontour.geometry import contours
from jcontour.motion.cornering import cornered
from jcontour.motion.jerk_limited.limits import AxisLimits

LIMITS = AxisLimits.of(2, acceleration=3.0, jerk=150.0, speed=0.2)


NEVER = np.zeros(3, bool)


def drawn(figure, label):
    """Lines of the first row whose label begins so."""
    lines = figure.axes[0].lines
    return [line.get_xydata().T for line in lines if line.get_label().startswith(label)]


def marked(rest):
    line = contours.polyline([[0.0, 0.0], [4e-3, 0.0], [9e-3, 0.0], [9e-3, 2e-3]])
    figure = motion_figure(cornered(line, np.full(3, 0.05), LIMITS, 1e-6, rest), "XY", NEVER)
    assert all(axes.get_legend() is None for axes in figure.axes)  # where it would hide curves
    return drawn(figure, "waits: "), drawn(figure, "stops: ")


def test_waits_are_marked_where_the_tool_rests_and_stops_where_it_stops():
    waits, stops = marked(np.array([0.5, 0.0, np.nan]))
    np.testing.assert_allclose([places for places, _ in waits], [[4.0]], atol=1e-6)  # [mm]
    np.testing.assert_allclose([places for places, _ in stops], [[4.0, 9.0]], atol=1e-6)
    waits, stops = marked(np.array([np.nan, 0.0, np.nan]))
    assert waits == [] and len(stops) == 1


@cache
def cuts_with_a_rapid_move(cut=0.02, fast=0.2):
    """Figure of 20 mm of a zigzag, 60 mm straight, and a zigzag again."""
    steps = np.arange(1, 101)
    there = np.stack([200e-6 * steps, 100e-6 * (steps % 2)], axis=1)
    corners = np.concatenate([[[0.0, 0.0]], there, there + [0.08, 0.0]])
    rapid = np.arange(len(corners) - 1) == steps.size
    feed = np.where(rapid, fast, cut)
    rest = np.where(rapid | np.append(rapid[1:], False), 0.0, np.nan)
    line = contours.polyline(corners)
    planned = cornered(line, feed, LIMITS, 1e-6, rest)
    return motion_figure(planned, "XY", rapid), planned.motion


def test_a_rapid_move_between_slow_cuts_is_as_long_and_as_fast_as_it_is():
    figure, motion = cuts_with_a_rapid_move()
    ((along, fed),) = drawn(figure, "rapid")
    move = 60.0
    begin = 0.5 * (along[np.isfinite(fed)][0] + along[np.isfinite(fed)][-1] - move)
    inside = (along > begin + 0.25 * move) & (along < begin + 0.75 * move)
    np.testing.assert_allclose(fed[inside], 12_000.0, rtol=1e-6)
    # it brakes over v^2 / (2 a) + v a / (2 j) [m] by the jerk-limited law, acceleration reached
    ramp = 1e3 * (0.2**2 / (2 * 3.0) + 0.2 * 3.0 / (2 * 150.0))
    slower = (along > begin) & (along < begin + move) & (fed < 11_900.0)
    assert np.ptp(along[slower & (along < begin + 0.5 * move)]) < ramp
    assert np.nanmax(along) == pytest.approx(1e3 * motion.stops[-1])


def test_the_feed_of_the_cuts_sets_the_scale_and_rapid_moves_are_cut_off_with_a_word():
    figure, _ = cuts_with_a_rapid_move()
    (label,) = (one.get_label() for one in figure.axes[0].lines if "rapid" in one.get_label())
    assert label == "rapid, up to 12,000 mm/min (cut off)"
    assert 1200.0 < figure.axes[0].get_ylim()[1] < 2 * 1200.0
    ((_, fed),) = drawn(figure, "feed")
    assert np.nanmax(fed) <= 1200.0 * (1 + 1e-9)
    figure, _ = cuts_with_a_rapid_move(fast=0.021)
    assert figure.axes[0].get_ylim()[1] > 1260.0 and not any(
        "cut off" in one.get_label() for one in figure.axes[0].lines
    )


def test_short_peaks_of_a_long_motion_are_drawn():
    line = contours.polyline([[0.0, 0.0], [0.2, 0.0]])
    figure = motion_figure(cornered(line, np.array([1e-3]), LIMITS, 0.0), "XY", NEVER[:1])  # 200 s
    jerk = next(line for line in figure.axes[2].lines if line.get_label() == "X")
    assert np.abs(jerk.get_ydata()).max() > 0.99 * LIMITS.jerk[0]


@pytest.mark.slow
def test_a_motion_of_many_nodes_is_drawn_as_bands_up_to_its_limits():
    zigzag = contours.polyline([[1e-3 * k, 1e-3 * (k % 2)] for k in range(5000)])
    planned = cornered(zigzag, np.full(4999, 0.02), LIMITS, 0.0)
    figure = motion_figure(planned, "XY", np.zeros(4999, bool))
    assert "mean" in figure.axes[0].get_title()
    for axes, limit in zip(figure.axes[1:], (LIMITS.acceleration, LIMITS.jerk), strict=True):
        bands = [np.concatenate([p.vertices for p in one.get_paths()]) for one in axes.collections]
        peak = max(corners[:, 1].max() for corners in bands)
        mean = axes.get_lines()[0].get_ydata()
        assert len(bands) == 2 and 0 < mean.min() < mean.max() < peak <= limit[0]
