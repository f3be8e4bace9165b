"""Motions of a machine along a programmed path from rest to rest: trapezoidal, or jerk-limited."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from jcontour.app.jobs.pace import MM_PER_MIN, Pace
from jcontour.geometry.contour import Contour, unpadded
from jcontour.motion.cornering import Planned, cornered
from jcontour.motion.feed_laws import trapezoidal
from jcontour.motion.jerk_limited.limits import AxisLimits
from jcontour.motion.other_controls import as_planned_by

UM = 1e-6  # [m]
# [s] in which an axis builds up its acceleration where the machine states no jerk: of milling
# machines 10 to 50 ms are usual
BUILD_UP = 0.02
AT_ONCE = 200_000  # samples, which take a few hundred bytes each on their way
SAME_FEED = 1e-9  # what a projection rounds


class Aside(NamedTuple):
    """Where a motion leaves its contour, in blended corners.

    Attributes:
        offset: (T, m) from the contour's point to the tool [m].
        tangent: (T, m) unit vectors along the motion.
    """

    offset: Float[np.ndarray, "T m"]
    tangent: Float[np.ndarray, "T m"]

    def some(self, samples: slice) -> "Aside":
        """Some of the samples."""
        return Aside(self.offset[samples], self.tangent[samples])

    def held(self, samples: int) -> "Aside":
        """The same, its last sample held for so many more."""
        more = ((0, samples), (0, 0))
        return Aside(*(np.pad(rows, more, mode="edge") for rows in self))


class AlongPath(NamedTuple):
    """A motion in samples.

    Attributes:
        arc: arc length on the contour at every sample [m].
        words: the law in words.
        aside: where it leaves the contour; None where it does not.
        planned: behind it; None of a trapezoidal motion.
    """

    arc: Float[np.ndarray, " T"]
    words: str
    aside: Aside | None = None
    planned: Planned | None = None


def along_path(
    contour: Contour,
    feed: Float[np.ndarray, " P"],
    rapid: Bool[np.ndarray, " P"],
    pace: Pace,
    rest: Float[np.ndarray, " P"],
) -> AlongPath:
    """Motion from rest to rest by the law that is asked for.

    Args:
        contour: the path.
        feed: of every piece, of rapid moves too [m/s].
        rapid: which pieces are rapid moves. A jerk-limited motion stops where they begin and end,
            as LinuxCNC does (its `tp.c` blends no rapid move with another move).
        pace: limits and law.
        rest: how long it rests at the end of every piece [s]; NaN where it goes on.
    """
    words = f"{float(np.max(np.where(rapid, 0.0, feed))) / MM_PER_MIN:.4g} mm/min"
    if pace.planner != "jcontour":
        return _of_control(contour, feed, rapid, pace, rest, words)
    if pace.halved:
        words += ", half the stated acceleration"
    if pace.feed_law == "jerk":
        return _jerk_limited(contour, feed, rapid, pace, rest, words)
    arc = trapezoidal(
        contour,
        feed,
        pace.machine.model.dt,
        pace.acceleration_or_default,
        pace.axis_speed,
        pace.axis_acceleration,
        rest=rest,
    )
    return AlongPath(arc, f"trapezoidal, {words}")


def axis_limits(pace: Pace) -> AxisLimits:
    """Limits of every axis that a jerk-limited motion keeps."""
    axes, speed = pace.machine.model.axes, pace.axis_speed
    acceleration = np.full(axes, pace.acceleration_or_default)
    if pace.axis_acceleration is not None:
        acceleration = np.minimum(pace.axis_acceleration, acceleration)
        if pace.acceleration is None:
            acceleration = pace.axis_acceleration
    stated = pace.machine.limits.jerk if pace.jerk is None else pace.jerk
    jerk = acceleration / BUILD_UP if stated is None else stated
    return AxisLimits.of(axes, acceleration, jerk, np.inf if speed is None else speed)


def planned_motion(
    contour: Contour,
    feed: Float[np.ndarray, " P"],
    rapid: Bool[np.ndarray, " P"],
    pace: Pace,
    rest: Float[np.ndarray, " P"],
) -> Planned:
    """Jerk-limited motion; see `along_path`."""
    changes = np.append(rapid[1:] != rapid[:-1], False)
    rest = np.where(changes & np.isnan(rest), 0.0, rest)
    alike = np.isclose(feed[1:], feed[:-1], rtol=SAME_FEED, atol=0.0)
    return cornered(contour, feed, axis_limits(pace), pace.corner_tolerance, rest, alike)


def _jerk_limited(contour: Contour, feed, rapid, pace: Pace, rest, words: str) -> AlongPath:
    planned = planned_motion(contour, feed, rapid, pace, rest)
    around, motion, rests, _ = planned
    followed = motion.sampled(pace.machine.model.dt, rests)
    arc = around.true_arc(followed)
    place, tangent = _on(around.path, followed)
    blend = f"corners within {pace.corner_tolerance / UM:.4g} um"
    law = f"jerk-limited, {words}, {blend if pace.corner_tolerance else 'stops in corners'}"
    return AlongPath(arc, law, Aside(place - _on(contour, arc)[0], tangent), planned)


def _of_control(contour: Contour, feed, rapid, pace: Pace, rest, words: str) -> AlongPath:
    assert pace.control is not None
    motion = as_planned_by(pace.control, contour, feed, rapid, rest, pace.machine.model.dt)
    offset = motion.place - _on(contour, motion.arc)[0]
    name = "LinuxCNC" if pace.planner == "linuxcnc" else pace.planner
    law = f"as {name} plans it, {words}"
    return AlongPath(motion.arc, law, Aside(offset, motion.tangent))


def _on(contour: Contour, arc: Float[np.ndarray, " T"]) -> tuple[np.ndarray, np.ndarray]:
    """Points and unit tangents of an open run along a contour, in NumPy."""
    pieces = unpadded(contour)
    starts = np.append(0.0, np.cumsum(pieces.extent))
    place, tangent = np.empty((2, arc.size, contour.axes))
    for some in (slice(k, k + AT_ONCE) for k in range(0, arc.size, AT_ONCE)):
        index = np.searchsorted(starts, arc[some], side="right") - 1
        index = np.clip(index, 0, pieces.extent.size - 1)
        position, velocity, _ = pieces.taken(index).jet(arc[some] - starts[index])
        speed = np.linalg.norm(velocity, axis=1, keepdims=True)
        place[some], tangent[some] = position, velocity / speed
    return place, tangent
