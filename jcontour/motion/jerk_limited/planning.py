"""Jerk-limited motion along a contour, planned as a whole in two passes; lines in closed form."""

import os
from concurrent.futures import ThreadPoolExecutor
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
OVERLAP, PER_WINDOW = 512, 8  # cells that windows of a stretch share; overlaps in a window
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
    """Square of the rate in every cell, and about the time that is left to gain [s].

    It is searched window by window, side by side: the conditions of one fit into caches. Where two
    overlap, the rate goes over from one to the next.
    """
    windows = _windows(task, old, cells, begins)
    begin, size = windows[:, 0], windows[:, 1] - windows[:, 0]
    first = np.cumsum(size) - size

    def solved(group: Int[np.ndarray, "w 2"]) -> tuple[np.ndarray, float]:
        inside = np.concatenate([np.arange(*window) for window in group])
        return _solved(task, old, cells.taken(inside), np.diff(group)[:, 0], tightenings)

    groups = np.split(windows, np.flatnonzero(np.diff(first // (PER_WINDOW * OVERLAP))) + 1)
    with ThreadPoolExecutor(os.cpu_count()) as threads:
        rates, gaps = zip(*threads.map(solved, groups), strict=True)
    number = np.arange(size.sum()) - np.repeat(first, size)  # of a cell in its window
    shared = np.append(0, np.maximum(windows[:-1, 1] - begin[1:], 0))  # with the window before
    ahead = np.append(shared[1:], 0)
    share = _risen(number, np.repeat(shared, size))
    share -= _risen(number - np.repeat(size - ahead, size), np.repeat(ahead, size))
    rate = np.bincount(number + np.repeat(begin, size), share * np.concatenate(rates))
    square = ordinates(cells.length, begins).of(rate)
    parts = [slice(k, k + PER_WINDOW * OVERLAP) for k in range(0, rate.size, PER_WINDOW * OVERLAP)]
    path = task.pieces, task.feed, task.limits, old
    less = np.concatenate([slower(*path, cells.taken(part), square[part]) for part in parts])
    most = np.minimum.reduceat(less, np.flatnonzero(begins))
    return square * most[np.cumsum(begins) - 1, None], sum(gaps)


def _risen(cell: Int[np.ndarray, " n"], overlap: Int[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """Share of a window in the rate: from 0 to 1 in the middle half of an overlap."""
    return np.clip(2 * (cell + 0.5) / np.maximum(overlap, 1e-3) - 0.5, 0.0, 1.0)


def _windows(
    task: _Task, old: CubicMotion, cells: Cells, begins: Bool[np.ndarray, " n"]
) -> Int[np.ndarray, "w 2"]:
    """First cell and end of windows: stretches, or parts of long ones that overlap.

    An end is felt up to where the motion has stopped, or started, which is a quarter of an overlap.
    """
    speed, acceleration, jerk = task.limits
    windows = []
    for begin, end in pairwise(np.append(np.flatnonzero(begins), begins.size).tolist()):
        overlap = OVERLAP
        if end - begin > PER_WINDOW * OVERLAP:
            arc = old.on_cell(cells.cell[begin:end], cells.elapsed[begin:end]).arc
            fastest = min(task.feed[cells.piece[begin:end]].max(), float(np.linalg.norm(speed)))
            way = fastest * (fastest / acceleration.min() + (acceleration / jerk).max())
            felt = np.searchsorted(arc, arc + way) - np.arange(arc.size)
            overlap = max(OVERLAP, 4 * int(felt.max()))
        count = max(1, -((overlap + begin - end) // ((PER_WINDOW - 1) * overlap)))
        cuts = np.linspace(begin, end - overlap, count + 1).astype(int)
        windows.append(np.stack([cuts[:-1], cuts[1:] + overlap], axis=1))
    return np.concatenate(windows)


def _solved(
    task: _Task, old: CubicMotion, cells: Cells, sizes: Int[np.ndarray, " w"], tightenings: int
) -> tuple[Float[np.ndarray, " n"], float]:
    """Unknowns of windows of so many cells, and about the time that is left to gain [s]."""
    stretch, every = np.repeat(np.arange(sizes.size), sizes), np.ones(sizes.size, bool)
    unknowns = ordinates(cells.length, np.diff(stretch, prepend=-1) > 0)
    path = task.pieces, task.feed, task.limits, old
    parts = conditions(*path, cells, unknowns, stretch)
    start = _fitted(parts, stretch, np.ones(stretch.size))
    busy = np.bincount(stretch, task.tick[cells.piece])
    rate, gap = quickest(parts, start, stretch, every, NEAR if tightenings else ROUGH, busy)
    for _ in range(tightenings):
        less = slower(*path, cells, unknowns.of(rate))
        exceeds = np.zeros_like(every)
        exceeds[stretch[less < 1 - WORTH]] = True
        again = exceeds[stretch]
        parts.tighten(np.where(again, 1 / less**TIGHTER, 1.0))
        start = np.where(again, _fitted(parts, stretch, rate), rate)
        rate, left = quickest(parts, start, stretch, exceeds, NEAR, busy)
        gap = np.where(exceeds, left, gap)
    return rate, float(gap.sum())


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
