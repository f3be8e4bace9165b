"""What limits a motion, against closed forms."""

import numpy as np
import pytest

from jcontour.geometry import contours
from jcontour.motion.cornering import cornered, limit_shares
from jcontour.motion.jerk_limited.limits import AxisLimits
from jcontour.motion.point_to_point import PointToPoint

LIMITS = AxisLimits.of(2, acceleration=3.0, jerk=150.0, speed=0.2)


def test_shares_of_a_line_are_those_of_its_s_curve():
    """Ramps of jerk, of acceleration, and a cruise at the feed, then half a second of rest."""
    law = PointToPoint(50e-3, 0.1, 3.0, 150.0)
    rest = np.array([0.5])
    planned = cornered(contours.line([0.0, 0.0], [50e-3, 0.0]), np.full(1, 0.1), LIMITS, 0.0, rest)
    shares = limit_shares(planned)
    whole = law.duration + 0.5
    lasting = np.diff(np.append(law.phases.start, law.duration))
    jerk = lasting[law.phases.jerk != 0].sum()
    assert sum(shares.values()) == pytest.approx(1.0)
    assert shares["rest"] == pytest.approx(0.5 / whole)
    assert shares["feed"] >= lasting[3] / whole
    assert shares["jerk"] + shares["acceleration"] == pytest.approx(
        1 - shares["rest"] - shares["feed"]
    )
    assert shares["jerk"] == pytest.approx(jerk / whole, abs=0.05)
    assert shares["tolerance"] == 0.0


@pytest.mark.parametrize("tolerance", [0.0, 5e-6])
def test_what_a_corner_costs_is_under_the_limit_of_the_tolerance(tolerance):
    """Whether it is stopped in or blended: all but the ramps of both ends and the cruise."""
    corner = contours.polyline(1e-3 * np.array([[0.0, 0.0], [30.0, 0.0], [30.0, 30.0]]))
    planned = cornered(corner, np.full(2, 0.1), LIMITS, tolerance)
    shares = limit_shares(planned)
    assert sum(shares.values()) == pytest.approx(1.0)
    ends = shares["acceleration"] + shares["jerk"]
    assert shares["tolerance"] == pytest.approx(ends, rel=0.2 if tolerance else 0.05)


def test_chords_beyond_the_tolerance_are_under_its_limit():
    """Of a circle in chords with a sagitta of 2.5 um; within 5 um they are the circle."""
    angle = np.linspace(0.0, 2 * np.pi, 201)
    chords = contours.polyline(20e-3 * np.stack([np.cos(angle), np.sin(angle)], axis=1))
    actual = [cornered(chords, np.full(200, 0.1), LIMITS, um) for um in (1.5e-6, 5e-6)]
    near, far = (limit_shares(planned) for planned in actual)
    assert near["tolerance"] > 0.9 and far["tolerance"] < 0.01
    assert sum(near.values()) == pytest.approx(1.0)
