"""The quickest warp of time between two stops, by a primal-dual interior point method, compiled.

Every step solves Newton's equations for

    minimise T(c) = sum weight / sqrt(u)    subject to    g(c) >= 0,    g_i z_i = mu,
with mu sent to zero (Nocedal & Wright, Numerical Optimization, chapter 19). The curvature of g is
left out: it is that of 1 / sqrt(u), whose tangent lies below it, so that a step along which the
tangents stay positive stays within the limits. Unknowns of neighbouring cells alone meet, so that
the equations have two diagonals beside the main one.
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from jcontour._compiled import compiled
from jcontour._native import lanes
from jcontour._native.lanes import WIDTH, drop_stale, part
from jcontour.geometry import along_pieces
from jcontour.motion.jerk_limited.conditions import POINTS, SPEED, SQUARE, STILL, Conditions
from jcontour.motion.jerk_limited.slacks import (
    PER_SLACK,
    PER_UNKNOWN,
    SLOPE,
    Going,
    go,
    nearest_bounds,
    slacks_of,
    solve_equations,
)

_HERE = Path(__file__).parent
drop_stale(_HERE, *_HERE.glob("*.py"), Path(along_pieces.__file__), Path(lanes.__file__))

TO_THE_BOUND = 0.95  # of the way at which a condition would be met
FIRST_GAP = 0.1  # of the duration, the sum of g z of the first multipliers
JAMMED = 0.1  # of a step: less was possible, and the multipliers begin anew
STEPS = 150  # of Newton's method; forty are usual


class _Arrays(NamedTuple):
    """Memory of one solve; see `slacks`."""

    point: np.ndarray
    equations: np.ndarray
    step: np.ndarray
    ahead: np.ndarray
    scratch: np.ndarray


@part
def _centring(moved, gain):
    """Factor on mu: small where Newton's step was taken whole, near one while far from the path."""
    if gain > 0.3:
        return 0.9
    return min(1.0, max(0.1, 2.0 * (1.0 - moved) ** 2))


@part
def _ahead(c, far, step, equations, ahead):
    """Write the unknowns after so much of the step; how much sooner its end is expected [s]."""
    gain = 0.0
    for i in range(c.size):
        gain -= equations[PER_UNKNOWN * i + SLOPE] * step[i]
        ahead[i] = c[i] + far * step[i]
    return gain


@compiled
def _solved(cells, axes, c, steps, near, busy, arrays):
    """Improve unknowns in place; the sum of g_i z_i [s], or -1 where they break a condition."""
    point, equations, step, ahead, scratch = arrays
    count = c.size * slacks_of(axes)
    inside, _, duration = go(
        cells, axes, point, c, step, Going(0.0, 0.0, 0.0, 1.0), equations, scratch
    )
    if not inside:
        return -1.0
    gap = FIRST_GAP * duration
    mu = gap / count
    go(cells, axes, point, c, step, Going(mu, 0.0, 0.0, mu), equations, scratch)
    for _ in range(steps):
        solve_equations(equations, mu, step)
        nearest, nearest_dual = nearest_bounds(cells, axes, point, mu, step, scratch)
        moved = TO_THE_BOUND / max(nearest, TO_THE_BOUND)
        moved_dual = TO_THE_BOUND / max(nearest_dual, TO_THE_BOUND)
        gain = _ahead(c, moved, step, equations, ahead)
        going = Going(mu, 1.0, moved_dual, 0.0)
        if moved < JAMMED:
            going = Going(mu, 0.0, 0.0, gap / count)
        inside, gap_ahead, duration_ahead = go(
            cells, axes, point, ahead, step, going, equations, scratch
        )
        if not inside:  # at rounding: what was found is within all conditions
            return gap
        for i in range(c.size):  # c[:] = ahead compiles more: an error of shapes, its words
            c[i] = ahead[i]
        gap, before, duration = gap_ahead, duration, duration_ahead
        left = near * min(duration, busy)
        if gap < left and before - duration < 0.3 * left:
            return gap
        mu = gap / count * _centring(moved, gain / duration)
    return gap


def quickest(
    parts: Conditions,
    start: Float[np.ndarray, " n"],
    stretch: Int[np.ndarray, " n"],
    wanted: Bool[np.ndarray, " stretches"],
    near: float,
    busy: Float[np.ndarray, " stretches"],
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " stretches"]]:
    """Unknowns of the quickest warp, from unknowns that are within every condition.

    Beside them, for every stretch that is solved, the sum of g_i z_i [s]: zero at the optimum, and
    away from it about the time that is left to gain.

    Args:
        parts: conditions of the cells.
        start: unknowns to begin with.
        stretch: number of the stretch of every cell.
        wanted: stretches that are solved; the others stay as they are.
        near: share of its duration by which the warp may be longer than the quickest.
        busy: time for which the share counts, of a longer duration [s].

    Raises:
        ValueError: the start breaks a condition.
    """
    c = start.copy()
    ends = np.searchsorted(stretch, np.arange(wanted.size + 1))
    gap, per_block = np.zeros(wanted.size), POINTS + PER_SLACK * slacks_of.py_func(parts.axes)
    for k in np.flatnonzero(wanted).tolist():
        blocks, own = parts.blocks[parts.first[k] : parts.first[k + 1]], c[ends[k] : ends[k + 1]]
        arrays = _Arrays(
            point=np.ones(len(blocks) * per_block * WIDTH),
            equations=np.empty(PER_UNKNOWN * own.size),
            step=np.zeros(own.size),
            ahead=np.empty(own.size),
            scratch=np.empty(12 * WIDTH),
        )
        gap[k] = _solved(blocks.ravel(), parts.axes, own, STEPS, near, busy[k], arrays)
        if gap[k] < 0:
            raise ValueError("start: needs to be within every condition")
    return c, gap


def fullest(
    parts: Conditions, unknowns: Float[np.ndarray, " n"]
) -> Float[np.ndarray, " stretches"]:
    """Factor on the unknowns of every stretch at which its first condition is met.

    The speed and the acceleration grow with it, the jerk with its power 3/2.
    """
    values = np.abs(parts.values(unknowns))
    acceleration, jerk = np.split(values[STILL:], 2)
    rate = np.sqrt(values[SQUARE:SPEED])
    jerk = (jerk.reshape(len(rate), parts.axes, *rate.shape[1:]).max(axis=1) * rate).max(axis=0)
    linear = np.maximum(values[SPEED:STILL].max(axis=0), acceleration.max(axis=0))
    most = np.maximum(linear, np.cbrt(jerk) ** 2).max(axis=1)
    return 1.0 / np.maximum.reduceat(most, parts.first[:-1])
