"""Cells of a path for the first pass: about equal times of a quick motion."""

import jax
import numpy as np
from jaxtyping import Float, Int

from jcontour.geometry.contour import Contour
from jcontour.geometry.pieces import Piece
from jcontour.motion.feed_laws import trapezoidal
from jcontour.motion.jerk_limited.conditions import Cells, path_derivatives
from jcontour.motion.jerk_limited.cubic_motion import CubicMotion
from jcontour.motion.jerk_limited.limits import AxisLimits

PER_RAMP = 8  # cells in the time in which an axis builds up its acceleration
CURVED = 6  # cells of a curved piece at least
WHOLE = 0.5  # of a cell's time: a piece that is passed in less has fewer
PER_STRETCH = 40  # cells between two stops at least
FINE = 4  # ramps' times beside the ends of a line in which its cells are not longer
MOST_CELLS = 2_000_000
LAUNCH = 2.0  # times the ramp's time: how long a stop is felt
SAMPLES = np.linspace(0.0, 1.0, 9)[:, None]  # of a piece that limit its speed


def cell_time(limits: AxisLimits) -> float:
    """Time of a cell [s]."""
    return float((limits.acceleration / limits.jerk).min()) / PER_RAMP


def launch_length(limits: AxisLimits) -> float:
    """Length [m] that constant jerk passes from rest while a stop is felt."""
    ramp = LAUNCH * (limits.acceleration / limits.jerk).min()
    return float(limits.jerk.min() * ramp**3 / 6)


def curved(pieces: Piece) -> np.ndarray:
    """Which pieces are no straight lines, (P,)."""
    return (pieces.rate > 0) | pieces.polynomial[:, 2:].any(axis=(1, 2))


def passing_speed(
    pieces: Piece, feed: Float[np.ndarray, " P"], limits: AxisLimits
) -> Float[np.ndarray, " P"]:
    """Greatest constant speed [m/s] on every piece under the feed and the jerk."""
    everywhere = jax.tree.map(lambda rows: rows[None], pieces)
    _, _, third = path_derivatives(everywhere, SAMPLES * pieces.extent)
    with np.errstate(divide="ignore"):
        turning = np.cbrt((limits.jerk / np.abs(third)).min(axis=(0, 2)))
    return np.minimum(feed, turning)


def cells_of_curve(ticks: Float[np.ndarray, " P"]) -> Float[np.ndarray, " P"]:
    """Least number of cells of curves that are passed in so many of a cell's times."""
    return np.clip(np.ceil(CURVED * ticks / WHOLE), 1, CURVED)


def nodes(
    contour: Contour,
    pieces: Piece,
    feed: Float[np.ndarray, " P"],
    limits: AxisLimits,
    stops: Float[np.ndarray, " k"],
) -> tuple[Float[np.ndarray, " n"], Int[np.ndarray, " n"]]:
    """Arc lengths [m] at which cells begin, and the piece of each.

    A cell takes about the same time of the trapezoidal motion, and less beside a stop, where the
    time of constant jerk from rest is added. Every piece begins a cell.
    """
    starts = np.append(0.0, np.cumsum(pieces.extent))
    speed = passing_speed(pieces, feed, limits)
    tick = max(cell_time(limits), float(np.sum(pieces.extent / speed)) / MOST_CELLS)
    axis_speed = np.minimum(limits.speed, np.max(speed))  # no axis is faster than the path
    rest = np.where(np.isin(starts[1:], stops), 0.0, np.nan)
    arc = trapezoidal(contour, speed, tick, 1e9, axis_speed, limits.acceleration, 0.0, rest)
    place, time = _times(arc, tick, stops, limits, starts)
    ends = np.interp(starts, place, time)
    least = np.where(curved(pieces), cells_of_curve(np.diff(ends) / tick), 1)
    stretch = np.searchsorted(stops, 0.5 * (starts[1:] + starts[:-1])) - 1
    share = np.diff(ends) / np.bincount(stretch, np.diff(ends), stops.size - 1)[stretch]
    least = np.maximum(least, np.ceil(PER_STRETCH * share))
    fine = np.where(curved(pieces), np.inf, LAUNCH * FINE * tick * PER_RAMP)
    half = _shortened(0.5 * np.diff(ends), fine)
    count = np.maximum(np.ceil(2 * half / tick), least).astype(int)
    piece = np.repeat(np.arange(count.size), count)
    number = np.arange(piece.size) - np.repeat(np.cumsum(count) - count, count)
    into = 2 * half[piece] * np.minimum(number, count[piece] - number) / count[piece]
    into = _lengthened(into, fine[piece])
    late = 2 * number > count[piece]
    at = np.interp(np.where(late, ends[piece + 1] - into, ends[piece] + into), time, place)
    return np.where(number == 0, starts[piece], at), piece


def _shortened(time: np.ndarray, fine: np.ndarray) -> np.ndarray:
    """Time [s] of which that beyond `fine` counts by its logarithm."""
    with np.errstate(invalid="ignore"):
        beyond = fine * (1 + np.log(np.maximum(time / fine, 1.0)))
    return np.where(time > fine, beyond, time)


def _lengthened(time: np.ndarray, fine: np.ndarray) -> np.ndarray:
    """The inverse of `_shortened`."""
    with np.errstate(invalid="ignore"):
        beyond = fine * np.exp(np.maximum(time / fine, 1.0) - 1)
    return np.where(time > fine, beyond, time)


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
    near = np.clip(np.searchsorted(old.time, time), 1, old.time.size - 1)
    apart = np.minimum(np.abs(old.time[near] - time), np.abs(time - old.time[near - 1]))
    begins = np.append(True, np.diff(piece) > 0)
    kept = np.where(begins, apart > 1e-9 * old.time[-1] / gap.size, apart > 0.3 * gap)
    node = np.sort(np.concatenate([time[kept], old.time]))
    middle = 0.5 * (node[1:] + node[:-1])
    cell = np.searchsorted(old.time, middle, side="right") - 1
    arc = old.on_cell(cell, middle - old.time[cell]).arc
    on = np.clip(np.searchsorted(starts, arc, side="right") - 1, 0, pieces.extent.size - 1)
    return Cells(on, starts[on], node[:-1] - old.time[cell], cell, np.diff(node)), node


def _times(arc, tick, stops, limits, starts):
    """Table of places [m] and times [s] that the cells share out."""
    ramp = LAUNCH * float((limits.acceleration / limits.jerk).min())
    jerk = float(limits.jerk.min())
    launch = jerk * np.linspace(0.0, ramp, 100)[1:] ** 3 / 6
    half = 0.5 * np.diff(stops)
    after = (stops[:-1, None] + np.minimum(launch, half[:, None])).ravel()
    before = (stops[1:, None] - np.minimum(launch, half[:, None])).ravel()
    place = np.unique(np.concatenate([arc, starts, after, before, stops[:-1] + half]))
    quick = np.interp(place, arc, tick * np.arange(arc.size))
    i = np.clip(np.searchsorted(stops, place, side="right") - 1, 0, stops.size - 2)
    far = np.minimum(launch[-1], half)
    lasting = np.cbrt(6 * far / jerk)
    since = np.cbrt(6 * np.clip(place - stops[i], 0.0, far[i]) / jerk)
    until = np.cbrt(6 * np.clip(stops[i + 1] - place, 0.0, far[i]) / jerk)
    begun = np.append(0.0, np.cumsum(2 * lasting))
    time = quick + begun[i] + since + lasting[i] - until
    return place, np.maximum.accumulate(time)
