"""Jerk-limited motion along a contour, planned as a whole in two passes; lines in closed form."""

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from jcontour.geometry.contour import Contour, unpadded
from jcontour.geometry.coordinates import Numbers, per_piece
from jcontour.geometry.pieces import Piece
from jcontour.motion.jerk_limited import mesh
from jcontour.motion.jerk_limited.conditions import Cells, Conditions, conditions, ordinates, slower
from jcontour.motion.jerk_limited.cubic_motion import (
    CubicMotion,
    joined,
    ramped,
    straight_motions,
    through,
)
from jcontour.motion.jerk_limited.limits import AxisLimits, joints
from jcontour.motion.jerk_limited.mesh import shares
from jcontour.motion.jerk_limited.newton import fullest, quickest
from jcontour.motion.jerk_limited.planned_motion import JerkLimitedMotion, Warp, begins_of

MARGIN = 0.02  # of every limit that is left at the start of a pass
ROUGH, NEAR = 1e-3, 1e-4  # of the duration, what a pass leaves to gain: the first, the last
TIGHTENINGS = 1  # of cells that exceed a limit between their points, in the last pass
TIGHTER = 1.5  # power of the excess
WORTH = 3e-3  # of the rate's square: what the whole may lose for one cell
EXACT = 1 - 1e-10  # of the rate's square where the old motion is the quickest: limits keep a gap


def jerk_limited(
    contour: Contour,
    feed: Numbers,
    limits: AxisLimits,
    stopping: Int[np.ndarray, " k"] | None = None,
) -> JerkLimitedMotion:
    """Quickest motion from rest to rest along a contour, within limits of the axes and the feed.

    It stops where the direction or the curvature jumps; see `blending` for paths on which neither
    does. The limits hold at every time, not only at samples.

    Args:
        contour: one contour, not a stack.
        feed: greatest speed [m/s], one number or one for each piece (P,).
        limits: of the axes.
        stopping: numbers of joints at which it stops though it could pass; none when not given.

    Raises:
        ValueError: a feed that is not above zero, or a wrong shape.
    """
    pieces = unpadded(contour)
    feed = per_piece("feed", feed, pieces.extent.size)
    starts = np.append(0.0, np.cumsum(pieces.extent))
    smooth = joints(pieces).smooth(feed, float(limits.acceleration.min()))
    if stopping is not None:
        smooth[stopping] = False
    stretch = np.append(0, np.cumsum(~smooth))
    stops = starts[np.concatenate([[True], ~smooth, [True]])]
    tick = mesh.cell_times(pieces, feed, limits)
    task = _Task(contour, limits, feed, stops, pieces, tick)
    lines = straight_motions(pieces, feed, limits, stretch)
    bends = np.array([line is None for line in lines])
    ramps = mesh.launch_lengths(tick, limits, stretch)
    old = joined(
        [
            ramped(np.array(ends), ramp) if line is None else line
            for ends, ramp, line in zip(pairwise(stops), ramps[:, None], lines, strict=True)
        ]
    )
    if not bends.any():
        return _planned(task, old, *_own_cells(task, old), bends, tightenings=0)
    place, piece = mesh.nodes(contour, pieces, feed, limits, stops, tick)
    kept = bends[stretch[piece]] | (place == starts[piece])
    cells, node = mesh.cells_between(place[kept], piece[kept], pieces, old)
    motion = _planned(task, old, cells, node, bends, tightenings=0)
    time, ends = shares(motion, tick, bends)
    splines = through(time, motion.at(time).arc, ends)
    if splines is None:
        return motion
    bent = iter(splines)
    old = joined([line or next(bent) for line in lines])  # planned again, as a warp of itself
    again = _planned(task, old, *_own_cells(task, old), bends, TIGHTENINGS)
    return min(motion, again, key=lambda one: one.duration)


class _Task(NamedTuple):
    """What is planned: the fields of a motion that come first, and the time of cells [s]."""

    path: Contour
    limits: AxisLimits
    feed: Float[np.ndarray, " P"]
    stops: Float[np.ndarray, " k"]
    pieces: Piece
    tick: Float[np.ndarray, " P"]


def _planned(
    task: _Task,
    old: CubicMotion,
    cells: Cells,
    node: Float[np.ndarray, " n"],
    bends: Bool[np.ndarray, " stretches"],
    tightenings: int,
) -> JerkLimitedMotion:
    """Quickest warp of an old motion; the old one is it already in stretches that do not bend."""
    begins = begins_of(old, cells)
    open_ = bends[np.cumsum(begins) - 1]
    square = np.full((open_.size, 3), EXACT)
    gap = 0.0
    if bends.any():
        square[open_], gap = _quickest(task, old, cells.taken(open_), begins[open_], tightenings)
    return JerkLimitedMotion(*task[:-1], old, cells, Warp.of(node, square), gap)


def _quickest(
    task: _Task,
    old: CubicMotion,
    cells: Cells,
    begins: Bool[np.ndarray, " n"],
    tightenings: int,
) -> tuple[Float[np.ndarray, "n 3"], float]:
    """Square of the rate in every cell, and about the time that is left to gain [s]."""
    unknowns = ordinates(cells.length, begins)
    stretch = np.cumsum(begins) - 1
    every = np.ones(stretch[-1] + 1, bool)
    parts = conditions(task.pieces, task.feed, task.limits, old, cells, unknowns, stretch)
    start = _fitted(parts, stretch, np.ones(stretch.size))
    busy = np.bincount(stretch, task.tick[cells.piece])
    rate, gap = quickest(parts, start, stretch, every, NEAR if tightenings else ROUGH, busy)
    less = slower(task.pieces, task.feed, task.limits, old, cells, unknowns.of(rate))
    for _ in range(tightenings):
        exceeds = np.zeros_like(every)
        exceeds[stretch[less < 1 - WORTH]] = True
        again = exceeds[stretch]
        parts.tighten(np.where(again, 1 / less**TIGHTER, 1.0))
        start = np.where(again, _fitted(parts, stretch, rate), rate)
        rate, left = quickest(parts, start, stretch, exceeds, NEAR, busy)
        gap = np.where(exceeds, left, gap)
        less[again] = slower(
            task.pieces, task.feed, task.limits, old, cells.taken(again), unknowns.of(rate)[again]
        )
    most = np.ones(every.size)
    np.minimum.at(most, stretch, less)
    return unknowns.of(rate) * most[stretch, None], float(gap.sum())


def _fitted(parts: Conditions, stretch, shape) -> Float[np.ndarray, " n"]:
    """Unknowns of a shape, stretch by stretch as fast as leaves a margin in every condition."""
    return (1 - MARGIN) * fullest(parts, shape)[stretch] * shape


def _own_cells(task: _Task, old: CubicMotion) -> tuple[Cells, Float[np.ndarray, " nodes"]]:
    """Cells of a motion's own nodes, and the times of these."""
    middle = 0.5 * np.diff(old.time)
    count = np.arange(middle.size)
    starts = np.append(0.0, np.cumsum(task.pieces.extent))
    arc = old.on_cell(count, middle).arc
    piece = np.clip(np.searchsorted(starts, arc, side="right") - 1, 0, task.feed.size - 1)
    return Cells(piece, starts[piece], np.zeros(middle.size), count, 2 * middle), old.time
