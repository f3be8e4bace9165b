"""Figure of a jerk-limited motion: dwells are marked where the tool rests."""

import numpy as np

from experiments.reports.figures.loops.motion import motion_figure
from jcontour.geometry import contours
from jcontour.motion.cornering import cornered
from jcontour.motion.jerk_limited.limits import AxisLimits

LIMITS = AxisLimits.of(2, acceleration=3.0, jerk=150.0, speed=0.2)


def marks(rest):
    line = contours.polyline([[0.0, 0.0], [4e-3, 0.0], [9e-3, 0.0], [9e-3, 2e-3]])
    planned = cornered(line, np.full(3, 0.05), LIMITS, 1e-6, rest)
    figure = motion_figure(planned, "XY")
    assert all(axes.get_legend() is None for axes in figure.axes)  # where it would hide curves
    return [line.get_xdata() for line in figure.axes[0].lines if line.get_label() == "rest"]


def test_dwells_are_marked_where_the_tool_rests_and_stops_are_not():
    (places,) = marks(np.array([0.5, 0.0, np.nan]))
    np.testing.assert_allclose(places, [4.0], atol=1e-6)  # [mm]
    assert marks(np.array([np.nan, 0.0, np.nan])) == []


def test_short_peaks_of_a_long_motion_are_drawn():
    line = contours.polyline([[0.0, 0.0], [0.2, 0.0]])
    figure = motion_figure(cornered(line, np.array([1e-3]), LIMITS, 0.0), "XY")  # 200 s
    jerk = next(line for line in figure.axes[2].lines if line.get_label() == "X")
    assert np.abs(jerk.get_ydata()).max() > 0.99 * LIMITS.jerk[0]


def test_a_motion_of_many_nodes_is_drawn_as_bands_up_to_its_limits():
    zigzag = contours.polyline([[1e-3 * k, 1e-3 * (k % 2)] for k in range(5000)])
    planned = cornered(zigzag, np.full(4999, 0.02), LIMITS, 0.0)
    figure = motion_figure(planned, "XY")
    assert "mean" in figure.axes[0].get_title()
    for axes, limit in zip(figure.axes[1:], (LIMITS.acceleration, LIMITS.jerk), strict=True):
        bands = [np.concatenate([p.vertices for p in one.get_paths()]) for one in axes.collections]
        peak = max(corners[:, 1].max() for corners in bands)
        mean = axes.get_lines()[0].get_ydata()
        assert len(bands) == 2 and 0 < mean.min() < mean.max() < peak <= limit[0]
