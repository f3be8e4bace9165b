import numpy as np
import pytest

from jcontour.geometry import contours
from jcontour.motion.jerk_limited.cubic_motion import MotionSamples
from jcontour.motion.jerk_limited.derivatives import composed, everywhere
from jcontour.motion.jerk_limited.joints import unpadded


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
