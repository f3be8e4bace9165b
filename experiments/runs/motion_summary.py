"""Summary of a jerk-limited motion: how long it takes, and what limits it where."""

import numpy as np

from experiments.files.results.run_metrics import MotionSummary
from jcontour.motion.cornering import Planned

NEAR = 0.98  # of a limit: there it acts


def motion_summary(planned: Planned) -> MotionSummary:
    """Cycle time, shares of it under every limit, and peaks; the first limit that acts counts.

    The motion is smooth in each of its cells: what acts in the middle acts in the whole cell.
    """
    motion = planned.motion
    lasting = np.diff(motion.nodes)
    begin = motion.nodes[:-1]
    middle = begin + 0.5 * lasting
    speed, acceleration, jerk = motion.axes_at(middle)
    starts = np.append(0.0, np.cumsum(np.asarray(motion.path.extent)))
    piece = np.searchsorted(starts, motion.at(middle).arc, side="right") - 1
    feed = motion.feed[np.clip(piece, 0, motion.feed.size - 1)]
    acts = {
        "feed": np.linalg.norm(speed, axis=1) > NEAR * feed,
        "speed": (np.abs(speed) > NEAR * motion.limits.speed).any(axis=1),
        "acceleration": (np.abs(acceleration) > NEAR * motion.limits.acceleration).any(axis=1),
        "jerk": (np.abs(jerk) > NEAR * motion.limits.jerk).any(axis=1),
    }
    free, shares = np.ones(lasting.size, bool), {}
    for name, where in acts.items():
        shares[name] = float(lasting @ (where & free)) / planned.duration
        free &= ~where
    _, *first = motion.axes_at(begin)
    peak_acceleration, peak_jerk = (
        np.abs(np.concatenate(both)).max(axis=0)
        for both in zip(first, (acceleration, jerk), strict=True)
    )
    return MotionSummary(
        cycle_time=planned.duration,
        stops=motion.stops.size - 2,
        deviation=planned.around.deviation,
        shares=shares,
        jerk_limit=tuple(motion.limits.jerk.tolist()),
        peak_jerk=tuple(peak_jerk.tolist()),
        peak_acceleration=tuple(peak_acceleration.tolist()),
        gap=motion.gap,
        dwell=planned.rests.total,
    )
