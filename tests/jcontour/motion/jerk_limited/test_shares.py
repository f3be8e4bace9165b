"""Times of the second pass: what they promise, on a motion past curves and lines."""

import numpy as np

from jcontour.geometry import contours
from jcontour.motion.blending import blended
from jcontour.motion.jerk_limited.limits import AxisLimits
from jcontour.motion.jerk_limited.mesh import shares
from jcontour.motion.jerk_limited.planning import jerk_limited

LIMITS = AxisLimits.of(2, acceleration=3.0, jerk=150.0, speed=0.2)
TICK = 2e-3  # [s]


def ticks(motion):
    """Two of them, by turns: neighbouring pieces have different ones."""
    return TICK * np.where(np.arange(motion.feed.size) % 2, 1.0, 0.5)


def zigzag():
    """Three stretches: past a blend, a line, past a blend."""
    points = 1e-3 * np.array([[0, 0], [10, 0], [12, 9], [0, 0.0], [10, 0], [10, 10]])
    path = blended(contours.polyline(points), 5e-6, np.array([True, False, False, True])).path
    return jerk_limited(path, 0.05, LIMITS)


def test_every_wanted_stretch_is_shared_out_from_stop_to_stop():
    motion = zigzag()
    wanted = np.ones(motion.stopped.size - 1, bool)
    wanted[1] = False
    time, ends = shares(motion, ticks(motion), wanted)
    assert wanted.size > 2 and ends.size == wanted.sum() + 1 and ends[-1] == time.size
    for a, b, k in zip(ends[:-1], ends[1:], np.flatnonzero(wanted), strict=True):
        assert (time[a], time[b - 1]) == tuple(motion.stopped[k : k + 2])
        assert (np.diff(time[a:b]) > 0).all() and b - a > 40


def test_no_time_is_longer_than_a_tick_where_jerk_acts_and_pieces_begin_at_times():
    motion = zigzag()
    wanted = np.ones(motion.stopped.size - 1, bool)
    time, _ = shares(motion, ticks(motion), wanted)
    time = np.unique(time)
    assert np.isin(motion.passed, time).all()
    _, _, jerk = motion.axes_at(0.5 * (time[1:] + time[:-1]))
    acts = (np.abs(jerk) > 0.1 * LIMITS.jerk).any(axis=1)
    piece = np.searchsorted(motion.passed, 0.5 * (time[1:] + time[:-1])) - 1
    assert acts.any() and (np.diff(time) <= ticks(motion)[piece] * (1 + 1e-9))[acts].all()
