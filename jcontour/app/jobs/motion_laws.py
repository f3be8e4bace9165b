"""Motions of a machine along a programmed path from rest to rest: trapezoidal, or jerk-limited."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from jcontour.app.jobs.pace import Pace
from jcontour.app.plain_numbers import feed_words
from jcontour.geometry.contour import Contour, unpadded
from jcontour.geometry.toolpath_rules import INCH, MM
from jcontour.motion import Planned, cornered, trapezoidal
from jcontour.motion.jerk_limited.limits import AxisLimits
from jcontour.motion.other_controls import as_planned_by
from jcontour.motion.smoothing import SHARPEST

UM = 1e-6  # [m]
# [s] in which an axis builds up its acceleration where the machine states no jerk: of milling
# machines 10 to 50 ms are usual
BUILD_UP = 0.02
AT_ONCE = 200_000  # samples, which take a few hundred bytes each on their way
SAME_FEED = 1e-9  # what a projection rounds


class Aside(NamedTuple):
    """Where a motion leaves its contour, in blended corners."""

    offset: Float[np.ndarray, "T m"]  # (T, m) from the contour's point to the tool [m]
    tangent: Float[np.ndarray, "T m"]  # (T, m) unit vectors along the motion

    def some(self, samples: slice) -> "Aside":
        """Some of the samples."""
        return Aside(self.offset[samples], self.tangent[samples])

    def held(self, samples: int) -> "Aside":
        """The same, its last sample held for so many more."""
        more = ((0, samples), (0, 0))
        return Aside(*(np.pad(rows, more, mode="edge") for rows in self))


class AlongPath(NamedTuple):
    """A motion in samples."""

    arc: Float[np.ndarray, " T"]  # arc length on the contour at every sample [m]
    words: str  # the law in words
    aside: Aside | None = None  # where it leaves the contour; None where it does not
    planned: Planned | None = None  # behind it; None of a trapezoidal motion


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
    words = feed_words(float(np.max(np.where(rapid, 0.0, feed))))
    if pace.planner != "jcontour":
        assert pace.control is not None
        dt = pace.machine.model.dt
        predicted = as_planned_by(pace.control, contour, feed, rapid, rest, dt)
        offset = predicted.place - _on(contour, predicted.arc)[0]
        name = "LinuxCNC" if pace.planner == "linuxcnc" else pace.planner
        law = f"as {name} plans it, {words}"
        return AlongPath(predicted.arc, law, Aside(offset, predicted.tangent))
    if pace.halved:
        words += ", half the stated acceleration"
    if pace.feed_law == "jerk":
        changes = np.append(rapid[1:] != rapid[:-1], False)
        rest = np.where(changes & np.isnan(rest), 0.0, rest)
        alike = np.isclose(feed[1:], feed[:-1], rtol=SAME_FEED, atol=0.0)
        planned = cornered(contour, feed, axis_limits(pace), pace.corner_tolerance, rest, alike)
        around, motion, rests, _ = planned
        followed = motion.sampled(pace.machine.model.dt, rests)
        arc = around.true_arc(followed)
        place, tangent = _on(around.path, followed)
        blend = f"corners within {pace.corner_tolerance / UM:.4g} um"
        law = f"jerk-limited, {words}, {blend if pace.corner_tolerance else 'stops in corners'}"
        return AlongPath(arc, law, Aside(place - _on(contour, arc)[0], tangent), planned)
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


# [m] of the last digit of coordinates in inches and millimetres, the coarsest first
STEPS = sorted((10.0**-k * unit for unit in (INCH, MM) for k in (1, 2, 3, 4)), reverse=True)
# [m]: coarser than three digits of an inch is a grid that is meant
COARSEST = 30e-6
STRAIGHT = 1e-5  # [rad]: what turns less goes on straight
ON_STEP = 1e-3  # of a step
ALMOST_ALL = 0.99  # of the chords
ENOUGH = 0.1  # of the way that is cut


class Coarse(NamedTuple):
    """Step that coordinates are rounded to [m], and how many moves cannot be smoothed for it."""

    step: float
    moves: int


def coarse_coordinates(
    contour: Contour, speed: Float[np.ndarray, " P"], cut: Bool[np.ndarray, " P"], pace: Pace
) -> Coarse | None:
    """Rounding of coordinates that spoils a jerk-limited motion at these speeds [m/s], or None."""
    limits, tolerance = axis_limits(pace), pace.corner_tolerance
    pieces = unpadded(contour)
    # Straight pieces that turn a little from the one before, or into the next
    straight = cut & (pieces.rate == 0) & ~pieces.polynomial[:, 2:].any(axis=(1, 2))
    along = pieces.polynomial[:, 1]
    cosine = np.sum(along[1:] * along[:-1], axis=1)
    turns = (cosine > np.cos(SHARPEST)) & (cosine < np.cos(STRAIGHT))
    smooth = straight[1:] & straight[:-1] & turns
    chords = np.append(smooth, False) | np.append(False, smooth)
    # Coarsest step that almost all of these moves are multiples of
    moves, step = pieces.polynomial[chords, 1] * pieces.extent[chords, None], None
    for one in STEPS if len(moves) else ():
        on = (np.abs(moves / one - np.round(moves / one)) < ON_STEP).all(axis=1)
        if on.mean() >= ALMOST_ALL:
            step = one
            break
    if step is None or not tolerance < (1 - ON_STEP) * step <= COARSEST:
        return None
    by_acceleration = np.sqrt(step / 2 / limits.acceleration.min())  # [s]
    by_jerk = np.cbrt(step / 2 / limits.jerk.min())
    slowed = chords & (pieces.extent < np.pi * speed * max(by_acceleration, by_jerk))
    if pieces.extent[slowed].sum() < ENOUGH * pieces.extent[cut].sum():
        return None
    return Coarse(step, int(slowed.sum()))
