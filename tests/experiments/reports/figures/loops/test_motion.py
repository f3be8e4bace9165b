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
    upper = motion_figure(planned, "XY").axes[0]
    return [line.get_xdata() for line in upper.lines if line.get_label() == "dwell"]


def test_dwells_are_marked_where_the_tool_rests_and_stops_are_not():
    (places,) = marks(np.array([0.5, 0.0, np.nan]))
    np.testing.assert_allclose(places, [4.0], atol=1e-6)  # [mm]
    assert marks(np.array([np.nan, 0.0, np.nan])) == []
