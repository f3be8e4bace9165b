"""Cells of a path: about equal times of a quick motion, and then of the motion planned first.

A piece is calm where its feed alone limits the motion. Far away from the ends of calm pieces in a
row nothing happens, however slow they are: cells become longer there, up to a turn of the path, so
that their number depends on the geometry. In the second pass neighbouring times are a tick apart
where jerk acts; elsewhere as far as the path and the time to where they are needed allow.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from jcontour.geometry.contour import Contour
from jcontour.geometry.pieces import Piece
from jcontour.motion.feed_laws import trapezoidal
from jcontour.motion.jerk_limited.conditions import Cells
from jcontour.motion.jerk_limited.cubic_motion import CubicMotion
from jcontour.motion.jerk_limited.limits import AxisLimits, curved, everywhere
from jcontour.motion.jerk_limited.planned_motion import JerkLimitedMotion

PER_RAMP = 8  # cells in the time for which a motion keeps up its jerk
CURVED = 6  # cells of a curved piece at least
WHOLE = 0.5  # of a cell's time: a piece that is passed in less has fewer
PER_STRETCH = 40  # cells between two stops at least
FINE = 4  # launches beside the ends of calm pieces in which cells are not longer
CALM = 0.1  # of the limits of acceleration and jerk: what a calm piece asks for at its feed
TURN = 0.2  # [rad] of the path, in a long cell
TOUCHING = 1e-6  # of a cell: in a shorter one the jerk would be rounding
SHORT = 1e-4  # of the way at the lowest speed: a shorter sample, at an end, counts by its way
MOST_CELLS = MOST_SAMPLES = 2_000_000  # of the mesh, and of the motion that it is made from
LAUNCH = 2.0  # times the ramp's time: how long a stop is felt
SLOW = 4.0  # likewise, times the time for which jerk lasts at a slow feed
QUIET = 0.02  # of an axis's jerk limit: less needs no fine cells
SPARSE = 0.1  # of the cells elsewhere, at most
GROWTH = 1 / 32  # of the time to where they are needed: so long may cells become


def build_up(limits: AxisLimits) -> float:
    """Time in which jerk builds up the acceleration of an axis [s], of the quickest one."""
    return float((limits.acceleration / limits.jerk).min())


def cell_times(
    pieces: Piece, feed: Float[np.ndarray, " P"], limits: AxisLimits
) -> Float[np.ndarray, " P"]:
    """Time of a cell on every piece [s].

    Jerk j lasts for a / j until the acceleration a is built up, but not longer than sqrt(v / j)
    where that takes the motion to half of its feed v: the acceleration sinks again behind it.
    """
    first, _, _ = everywhere(pieces)
    with np.errstate(divide="ignore"):
        speed, jerk = (
            (limit / np.abs(first)).min(axis=-1).max(axis=0)
            for limit in (limits.speed, limits.jerk)
        )
    ramp = np.sqrt(np.minimum(feed, speed) / jerk)
    return np.minimum(ramp, build_up(limits)) / PER_RAMP


def launch_lengths(
    tick: Float[np.ndarray, " P"], limits: AxisLimits, stretch: Int[np.ndarray, " P"]
) -> Float[np.ndarray, " stretches"]:
    """Lengths [m] that constant jerk passes from rest while a stop is felt, on every stretch.

    Both its ends have the same one: the less, where their feeds differ.

    Args:
        tick: time of a cell on every piece [s].
        limits: of the axes.
        stretch: number of the stretch of every piece.
    """
    last = np.flatnonzero(np.diff(stretch, append=stretch[-1] + 1))
    first = np.append(0, last[:-1] + 1)
    lasting = PER_RAMP * np.minimum(tick[first], tick[last])
    ramp = LAUNCH * np.minimum(SLOW * lasting, build_up(limits))
    return limits.jerk.min() * ramp**3 / 6


def calm(
    pieces: Piece, speed: Float[np.ndarray, " P"], limits: AxisLimits
) -> Bool[np.ndarray, " P"]:
    """Which pieces ask for little acceleration and jerk at a speed, and have it on every axis."""
    first, second, third = everywhere(pieces)
    speed = speed[:, None]
    shares = [
        np.abs(first) * speed / limits.speed * CALM,
        np.abs(second) * speed**2 / limits.acceleration,
        np.abs(third) * speed**3 / limits.jerk,
    ]
    return np.max([share.max(axis=(0, 2)) for share in shares], axis=0) < CALM


def turned(pieces: Piece) -> Float[np.ndarray, " P"]:
    """About how much every piece turns [rad]."""
    _, bend, _ = everywhere(pieces)
    return np.linalg.norm(bend, axis=-1).mean(axis=0) * pieces.extent


def cells_of_curve(ticks: Float[np.ndarray, " P"]) -> Float[np.ndarray, " P"]:
    """Least number of cells of curves that are passed in so many of a cell's times."""
    return np.clip(np.ceil(CURVED * ticks / WHOLE), 1, CURVED)


def nodes(
    contour: Contour,
    pieces: Piece,
    feed: Float[np.ndarray, " P"],
    limits: AxisLimits,
    stops: Float[np.ndarray, " k"],
    tick: Float[np.ndarray, " P"],
) -> tuple[Float[np.ndarray, " n"], Int[np.ndarray, " n"]]:
    """Arc lengths [m] at which cells begin, and the piece of each.

    A cell takes about the same time of the trapezoidal motion, and less beside a stop, where the
    time of constant jerk from rest is added; more far inside calm pieces. Every piece begins a
    cell.
    """
    starts = np.append(0.0, np.cumsum(pieces.extent))
    with np.errstate(divide="ignore"):  # the greatest constant speed under the feed and the jerk
        speed = np.cbrt((limits.jerk / np.abs(everywhere(pieces)[2])).min(axis=(0, 2)))
    speed = np.minimum(feed, speed)
    sample = max(build_up(limits) / PER_RAMP, float(np.sum(pieces.extent / speed)) / MOST_SAMPLES)
    axis_speed = np.minimum(limits.speed, np.max(speed))  # no axis is faster than the path
    rest = np.where(np.isin(starts[1:], stops), 0.0, np.nan)
    arc = trapezoidal(contour, speed, sample, 1e9, axis_speed, limits.acceleration, 0.0, rest)
    far = np.diff(arc) / (SHORT * sample * speed.min())
    sampled = np.append(0.0, np.cumsum(sample * np.minimum(far, 1.0)))
    place, time = _times(arc, sampled, stops, limits, starts)
    ends = np.interp(starts, place, time)
    quiet = calm(pieces, speed, limits)
    apart = ~(quiet[1:] & quiet[:-1]) | (feed[1:] != feed[:-1]) | np.isin(starts[1:-1], stops)
    row = np.append(0, np.cumsum(apart))
    begin, end = ends[np.searchsorted(row, row)], ends[np.searchsorted(row, row, "right")]
    straight = ~curved(pieces)  # along a line nothing changes, even where an axis limits the speed
    fine = np.where(quiet | straight, LAUNCH * FINE * tick * PER_RAMP, np.inf)
    clock = _Clock(begin, end, fine)
    first, last = clock.shortened(ends[:-1]), clock.shortened(ends[1:])
    tick = tick * max(1.0, np.sum((last - first) / tick) / MOST_CELLS)
    least = np.where(straight, 1, cells_of_curve(np.diff(ends) / tick))
    stretch = np.searchsorted(stops, 0.5 * (starts[1:] + starts[:-1])) - 1
    share = np.diff(ends) / np.bincount(stretch, np.diff(ends), stops.size - 1)[stretch]
    least = np.maximum(least, np.ceil(PER_STRETCH * share))
    least = np.maximum(least, np.where(quiet, np.ceil(turned(pieces) / TURN), 1))
    count = np.maximum(np.ceil((last - first) / tick), least).astype(int)
    piece = np.repeat(np.arange(count.size), count)
    number = np.arange(piece.size) - np.repeat(np.cumsum(count) - count, count)
    due = first[piece] + (last - first)[piece] * number / count[piece]
    at = np.interp(clock.of(piece).lengthened(due), time, place)
    return np.where(number == 0, starts[piece], at), piece


class _Clock(NamedTuple):
    """Times [s] between two others, of which those beyond `fine` of both count by a logarithm."""

    begin: Float[np.ndarray, " n"]
    end: Float[np.ndarray, " n"]
    fine: Float[np.ndarray, " n"]

    def of(self, index: Int[np.ndarray, " k"]) -> "_Clock":
        """Clocks of some of the pieces."""
        return _Clock(*(values[index] for values in self))

    def shortened(self, time: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """Time as it counts, from the begin."""
        half = self._counted(0.5 * (self.end - self.begin))
        since, left = time - self.begin, self.end - time
        return np.where(since < left, self._counted(since), 2 * half - self._counted(left))

    def lengthened(self, counted: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """The inverse of `shortened`."""
        half = self._counted(0.5 * (self.end - self.begin))
        early = counted < half
        near = np.where(early, counted, 2 * half - counted)
        with np.errstate(invalid="ignore"):
            beyond = self.fine * np.exp(np.maximum(near / self.fine, 1.0) - 1)
        near = np.where(near > self.fine, beyond, near)
        return np.where(early, self.begin + near, self.end - near)

    def _counted(self, time: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        with np.errstate(invalid="ignore"):
            beyond = self.fine * (1 + np.log(np.maximum(time / self.fine, 1.0)))
        return np.where(time > self.fine, beyond, time)


def cells_between(
    place: Float[np.ndarray, " n"],
    piece: Int[np.ndarray, " n"],
    pieces: Piece,
    old: CubicMotion,
) -> tuple[Cells, Float[np.ndarray, " nodes"]]:
    """Cells that begin at places [m] and at the old motion's nodes, and the times of all nodes."""
    starts = np.append(0.0, np.cumsum(pieces.extent))
    time = old.reached(place)
    gap = np.diff(np.append(time, old.time[-1]))
    beside = np.minimum(gap, np.append(old.time[-1], gap[:-1]))
    near = np.clip(np.searchsorted(old.time, time), 1, old.time.size - 1)
    apart = np.minimum(np.abs(old.time[near] - time), np.abs(time - old.time[near - 1]))
    begins = np.append(True, np.diff(piece) > 0)
    kept = np.where(begins, apart > TOUCHING * beside, apart > 0.3 * gap)
    node = np.sort(np.concatenate([time[kept], old.time]))
    middle = 0.5 * (node[1:] + node[:-1])
    cell = np.searchsorted(old.time, middle, side="right") - 1
    arc = old.on_cell(cell, middle - old.time[cell]).arc
    on = np.clip(np.searchsorted(starts, arc, side="right") - 1, 0, pieces.extent.size - 1)
    return Cells(on, starts[on], node[:-1] - old.time[cell], cell, np.diff(node)), node


def _times(arc, sampled, stops, limits, starts):
    """Table of places [m] and times [s] that the cells share out."""
    ramp = LAUNCH * build_up(limits)
    jerk = float(limits.jerk.min())
    launch = jerk * np.linspace(0.0, ramp, 100)[1:] ** 3 / 6
    half = 0.5 * np.diff(stops)
    after = (stops[:-1, None] + np.minimum(launch, half[:, None])).ravel()
    before = (stops[1:, None] - np.minimum(launch, half[:, None])).ravel()
    place = np.unique(np.concatenate([arc, starts, after, before, stops[:-1] + half]))
    quick = np.interp(place, arc, sampled)
    i = np.clip(np.searchsorted(stops, place, side="right") - 1, 0, stops.size - 2)
    far = np.minimum(launch[-1], half)
    lasting = np.cbrt(6 * far / jerk)
    since = np.cbrt(6 * np.clip(place - stops[i], 0.0, far[i]) / jerk)
    until = np.cbrt(6 * np.clip(stops[i + 1] - place, 0.0, far[i]) / jerk)
    begun = np.append(0.0, np.cumsum(2 * lasting))
    time = quick + begun[i] + since + lasting[i] - until
    return place, np.maximum.accumulate(time)


def shares(
    motion: JerkLimitedMotion,
    tick: Float[np.ndarray, " P"],
    wanted: Bool[np.ndarray, " stretches"],
) -> tuple[Float[np.ndarray, " n"], Int[np.ndarray, " ends"]]:
    """Times from stop to stop that share out every piece evenly, none longer than `tick`.

    The times of all wanted stretches, one after the other with both ends of each; and the index at
    which every stretch begins, and the end of the last.

    Args:
        motion: that is shared out.
        tick: on every piece, longest time between two of them where jerk acts [s].
        wanted: stretches between stops.
    """
    time, share = _activity(motion, tick)
    stops = motion.stopped
    ends = np.unique(np.concatenate([motion.passed, stops]))
    along = np.interp(ends, time, share)
    part, of = np.diff(along), np.searchsorted(stops, ends[:-1], side="right") - 1
    whole = np.diff(along[np.searchsorted(ends, stops)])
    least = np.maximum(np.ceil(PER_STRETCH * part / whole[of]), cells_of_curve(part))
    count = np.maximum(np.ceil(part), least).astype(int) * wanted[of]
    piece = np.repeat(np.arange(count.size), count)
    number = np.arange(piece.size) - (np.cumsum(count) - count)[piece]
    inner = np.interp(along[piece] + number * (part / np.maximum(count, 1))[piece], share, time)
    times = np.where(number == 0, ends[piece], inner)
    last = np.cumsum(np.bincount(of, count, stops.size - 1).astype(int)[wanted])
    begins = np.append(0, last)
    return np.insert(times, last, stops[1:][wanted]), begins + np.arange(begins.size)


def _activity(
    motion: JerkLimitedMotion, tick: Float[np.ndarray, " P"]
) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, " k"]]:
    """Table of times, and of the cells that are due up to each: few where no jerk acts."""
    node, begins = motion.nodes, motion.passed[1:-1]
    centre = 0.5 * (node[1:] + node[:-1])
    speed, acceleration, jerk = motion.axes_at(centre)
    active = np.flatnonzero((np.abs(jerk) / motion.limits.jerk).max(axis=-1) > QUIET)
    ramp = PER_RAMP * tick[np.searchsorted(begins, centre[active])]
    begin, end = np.sort(node[active] - ramp), np.sort(node[active + 1] + ramp)
    time = np.unique(np.clip(np.concatenate([node, begin, end]), 0.0, node[-1]))
    middle = 0.5 * (time[1:] + time[:-1])
    begun, ended = np.searchsorted(begin, middle), np.searchsorted(end, middle)
    since = middle - np.append(-np.inf, end)[ended]
    until = np.append(begin, np.inf)[begun] - middle
    fine = tick[np.searchsorted(begins, middle)]
    longest = fine / SPARSE + GROWTH * np.minimum(np.minimum(since, until), node[-1])
    turning = np.linalg.norm(acceleration, axis=-1) / np.linalg.norm(speed, axis=-1)
    on = np.searchsorted(node, middle) - 1
    quiet = np.maximum(1 / longest, np.minimum(turning[on] / TURN, SPARSE / fine))
    density = np.where(begun > ended, 1 / fine, quiet)
    share = np.append(0.0, np.cumsum(density * np.diff(time)))
    return time, share * min(1.0, MOST_CELLS / share[-1])
