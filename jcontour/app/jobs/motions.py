"""Motions of a single axis, each with a rest before it."""

import math

import numpy as np

from jcontour.app.jobs.job import AxisMove, Pace
from jcontour.geometry.contour import Contour
from jcontour.geometry.contours import line
from jcontour.motion.point_to_point import PointToPoint, ToAndFro
from jcontour.motion.references import TimeLaw

DWELL = 0.1  # [s] of rest before every motion of the thesis
SETTLING = 1.075  # [s] of rest after its task A


def task_a(pace: Pace) -> AxisMove:
    """Task A of Yuan, section 3.4.1: 0.1 m from rest to rest, and a second of rest.

    Feed is 0.1 m/s and acceleration 4 m/s^2 unless another pace is given.
    """
    return _point_to_point("task-a", pace, 0.1, 0.1, 4.0)


def s_curve(pace: Pace) -> AxisMove:
    """Half the way at twice the speed, with limited jerk."""
    return _point_to_point("s-curve", pace, 0.05, 0.2, 4.0, jerk=100.0)


def task_b(pace: Pace) -> AxisMove:
    """Task B of Yuan, section 3.4.1: 0.05 cos(2 t) + 0.05 m."""
    if pace.feed is not None or pace.acceleration is not None:
        raise ValueError(
            "feed-mm-per-min, acceleration: task-b is a cosine with a speed of its own; "
            "leave them out"
        )
    return _motion("task-b", pace, line([0.1], [0.0]), ToAndFro(0.1, 2.0), 3.3, "cosine, 2 rad/s")


def _point_to_point(
    name: str, pace: Pace, distance: float, feed: float, acceleration: float, jerk: float = np.inf
) -> AxisMove:
    feed, acceleration = pace.feed or feed, pace.acceleration or acceleration
    law = PointToPoint(distance, feed, acceleration, jerk)
    shape = "trapezoidal" if np.isinf(jerk) else "S-curve"
    words = f"{shape}, {feed:g} m/s, {acceleration:g} m/s^2"
    return _motion(name, pace, line([0.0], [distance]), law, DWELL + law.duration + SETTLING, words)


def _motion(
    name: str, pace: Pace, contour: Contour, law: TimeLaw, duration: float, words: str
) -> AxisMove:
    dt = pace.machine.model.dt
    axes = len(pace.machine.axes)
    if axes != 1:
        raise ValueError(
            f"contour: {name} is a motion of a single axis, {pace.machine.name} has {axes}"
        )
    return AxisMove(name, contour, law, dt * math.ceil(duration / dt - 1e-6), DWELL, dt, words)


BUILT_IN = {"task-a": task_a, "task-b": task_b, "s-curve": s_curve}
