"""Time laws in closed form, exact at any time: point to point, and to and fro along a cosine.

A time law gives the arc length at a time since its beginning; `references.in_time` samples it along
a contour, which is a `line` of one axis for a machine with a single one:

    in_time(line([0.0], [0.1]), PointToPoint(0.1, 0.1, 4.0), duration=2.2, dt=1e-3, dwell=0.1)
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from jcontour.geometry.contours import line
from jcontour.geometry.coordinates import positive
from jcontour.motion.references import Reference, in_time


class Phases(NamedTuple):
    """Stretches of constant jerk: time [s] and motion at which each begins."""

    start: Float[np.ndarray, " P"]
    arc: Float[np.ndarray, " P"]
    speed: Float[np.ndarray, " P"]
    acceleration: Float[np.ndarray, " P"]
    jerk: Float[np.ndarray, " P"]


class PointToPoint:
    """The quickest motion over a distance from rest to rest within limits, symmetric in time.

    It is a trapezoid of speed, or an S-curve. With T_j the time in which the acceleration is built
    up and T_a that in which the speed is,

        v = j T_j (T_a - T_j),    distance = v (T_a + T_v),
    where T_v, the cruise, is positive only if the feed is reached, and T_a > 2 T_j only if the
    acceleration is (Biagiotti & Melchiorri, Trajectory Planning for Automatic Machines and Robots,
    sections 3.2 and 3.4).

    Args:
        distance: length of the motion [m].
        feed: greatest speed [m/s].
        acceleration: greatest acceleration [m/s^2].
        jerk: greatest jerk [m/s^3]; infinite for a trapezoid.

    Attributes:
        duration: [s].
        phases: its stretches of constant jerk.

    Raises:
        ValueError: a value is not above zero, or one other than the jerk is not finite.
    """

    def __init__(self, distance: float, feed: float, acceleration: float, jerk: float = np.inf):
        self.distance, feed = positive("distance", distance), positive("feed", feed)
        acceleration = positive("acceleration", acceleration)
        if not jerk > 0:
            raise ValueError(f"jerk: needs to be above zero, received {jerk}")
        jerk_time, rise, cruise, peak = _times(self.distance, feed, acceleration, jerk)
        j = peak / jerk_time if jerk_time > 0 else 0.0
        stretches = (  # duration, acceleration at its beginning, jerk
            (jerk_time, 0.0, j),
            (rise - 2 * jerk_time, peak, 0.0),
            (jerk_time, peak, -j),
            (cruise, 0.0, 0.0),
            (jerk_time, 0.0, -j),
            (rise - 2 * jerk_time, -peak, 0.0),
            (jerk_time, -peak, j),
        )
        self.duration = 2 * rise + cruise
        self.phases = _joined(*zip(*stretches, strict=True))

    def __call__(self, time: Float[np.ndarray, " S"]) -> Float[np.ndarray, " S"]:
        """Arc length [m] at times [s]; the end is held."""
        p = self.phases
        i = np.searchsorted(p.start, time, side="right") - 1
        t = time - p.start[i]
        arc = p.arc[i] + t * (p.speed[i] + t * (p.acceleration[i] / 2 + t * p.jerk[i] / 6))
        return np.where(time < self.duration, np.minimum(arc, self.distance), self.distance)


class ToAndFro:
    """Motion along a distance and back for ever, from rest: distance (1 - cos(frequency t)) / 2.

    Args:
        distance: from end to end [m].
        frequency: [rad/s].

    Raises:
        ValueError: a value is not finite and above zero.
    """

    def __init__(self, distance: float, frequency: float):
        self.distance = positive("distance", distance)
        self.frequency = positive("frequency", frequency)

    def __call__(self, time: Float[np.ndarray, " S"]) -> Float[np.ndarray, " S"]:
        """Arc length [m] at times [s]."""
        return self.distance / 2 * (1 - np.cos(self.frequency * time))


def thesis_task_a(dt: float = 1e-3, preview: int = 1) -> Reference:
    """Task A (Yuan, section 3.4.1): 0.1 m at 0.1 m/s and 4 m/s^2 after 0.1 s at rest; 2.2 s."""
    return in_time(line([0.0], [0.1]), PointToPoint(0.1, 0.1, 4.0), 2.2, dt, preview, dwell=0.1)


def thesis_task_b(dt: float = 1e-3, preview: int = 1) -> Reference:
    """Task B (Yuan, section 3.4.1): 0.05 cos(2 t) + 0.05 m after 0.1 s at rest; 3.3 s."""
    return in_time(line([0.1], [0.0]), ToAndFro(0.1, 2.0), 3.3, dt, preview, dwell=0.1)


def _times(
    distance: float, feed: float, acceleration: float, jerk: float
) -> tuple[float, float, float, float]:
    """Times T_j, T_a, T_v [s], and the greatest acceleration reached [m/s^2]."""
    jerk_time = acceleration / jerk
    if feed < acceleration * jerk_time:  # the acceleration is not reached before the feed is
        jerk_time = np.sqrt(feed / jerk)
    rise = jerk_time + (feed / (jerk * jerk_time) if jerk_time > 0 else feed / acceleration)
    cruise = distance / feed - rise
    if cruise < 0:  # nor is the feed within the distance
        jerk_time, cruise = acceleration / jerk, 0.0
        rise = (jerk_time + np.sqrt(jerk_time**2 + 4 * distance / acceleration)) / 2
        if rise < 2 * jerk_time:
            jerk_time = np.cbrt(distance / (2 * jerk))
            rise = 2 * jerk_time
    return jerk_time, rise, cruise, jerk * jerk_time if jerk_time > 0 else acceleration


def _joined(duration, acceleration, jerk) -> Phases:
    """Stretches one after the other from rest, those of no duration left out."""
    T, a, j = (np.asarray(row)[np.asarray(duration) > 0] for row in (duration, acceleration, jerk))
    speed = np.cumsum(T * (a + T * j / 2)) - T * (a + T * j / 2)
    travelled = T * (speed + T * (a / 2 + T * j / 6))
    return Phases(np.cumsum(T) - T, np.cumsum(travelled) - travelled, speed, a, j)
