"""Summary of a jerk-limited motion: how long it takes, and what limits it where."""

import numpy as np

from experiments.files.results.run_metrics import MotionSummary
from jcontour.motion.cornering import Planned

POINTS = 20_000  # times at which it is looked at
NEAR = 0.98  # of a limit: there it acts


def motion_summary(planned: Planned) -> MotionSummary:
    """Cycle time, shares of it under every limit, and peaks; the first limit that acts counts."""
    motion = planned.motion
    time = (np.arange(POINTS) + 0.5) / POINTS * motion.duration
    speed, acceleration, jerk = motion.axes_at(time)
    starts = np.append(0.0, np.cumsum(np.asarray(motion.path.extent)))
    piece = np.searchsorted(starts, motion.at(time).arc, side="right") - 1
    feed = motion.feed[np.clip(piece, 0, motion.feed.size - 1)]
    acts = {
        "feed": np.linalg.norm(speed, axis=1) > NEAR * feed,
        "speed": (np.abs(speed) > NEAR * motion.limits.speed).any(axis=1),
        "acceleration": (np.abs(acceleration) > NEAR * motion.limits.acceleration).any(axis=1),
        "jerk": (np.abs(jerk) > NEAR * motion.limits.jerk).any(axis=1),
    }
    free, shares = np.ones(POINTS, bool), {}
    moving = motion.duration / planned.duration
    for name, where in acts.items():
        shares[name] = moving * float(np.mean(where & free))
        free &= ~where
    return MotionSummary(
        cycle_time=planned.duration,
        stops=motion.stops.size - 2,
        deviation=planned.around.deviation,
        shares=shares,
        jerk_limit=tuple(motion.limits.jerk.tolist()),
        peak_jerk=tuple(np.abs(jerk).max(axis=0).tolist()),
        peak_acceleration=tuple(np.abs(acceleration).max(axis=0).tolist()),
        gap=motion.gap,
        dwell=planned.rests.total,
    )
