"""Summary of a jerk-limited motion: how long it takes, and what limits it where."""

import numpy as np

from jcontour.app.files.results.run_metrics import MotionSummary
from jcontour.motion.acting_limits import limit_shares
from jcontour.motion.cornering import Planned


def motion_summary(planned: Planned) -> MotionSummary:
    """Cycle time, shares of it under every limit, and peaks."""
    motion = planned.motion
    begin = motion.nodes[:-1]
    middle = begin + 0.5 * np.diff(motion.nodes)
    _, acceleration, jerk = motion.axes_at(middle)
    _, *first = motion.axes_at(begin)
    peak_acceleration, peak_jerk = (
        np.abs(np.concatenate(both)).max(axis=0)
        for both in zip(first, (acceleration, jerk), strict=True)
    )
    return MotionSummary(
        cycle_time=planned.duration,
        stops=motion.stops.size - 2,
        deviation=planned.around.deviation,
        shares=limit_shares(planned),
        jerk_limit=tuple(motion.limits.jerk.tolist()),
        peak_jerk=tuple(peak_jerk.tolist()),
        peak_acceleration=tuple(peak_acceleration.tolist()),
        gap=motion.gap,
        dwell=planned.rests.total,
    )
