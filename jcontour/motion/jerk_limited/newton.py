"""The quickest warp of time between two stops, by a primal-dual interior point method, compiled.

Every step solves Newton's equations for

    minimise T(c) = sum weight / sqrt(u)    subject to    g(c) >= 0,    g_i z_i = mu,
with mu sent to zero (Nocedal & Wright, Numerical Optimization, chapter 19). The curvature of g is
left out: it is that of 1 / sqrt(u), whose tangent lies below it, so that a step along which the
tangents stay positive stays within the limits. Unknowns of neighbouring cells alone meet, so that
the equations have two diagonals beside the main one.
"""

from pathlib import Path

import numpy as np
from jaxtyping import Float

from jcontour._compiled import compiled
from jcontour._native import lanes
from jcontour._native.lanes import WIDTH, drop_stale, part
from jcontour.geometry import along_pieces
from jcontour.motion.jerk_limited.conditions import POINTS
from jcontour.motion.jerk_limited.equations import PER_UNKNOWN, SLOPE, solve_equations
from jcontour.motion.jerk_limited.slacks import PER_SLACK, Going, go, nearest_bounds, slacks_of

_HERE = Path(__file__).parent
drop_stale(_HERE, *_HERE.glob("*.py"), Path(along_pieces.__file__), Path(lanes.__file__))

TO_THE_BOUND = 0.95  # of the way at which a condition would be met
FIRST_GAP = 0.1  # of the duration, the sum of g z of the first multipliers
JAMMED = 0.1  # of a step: less was possible, and the multipliers begin anew


def solve(
    blocks: Float[np.ndarray, "b entries lanes"],
    axes: int,
    c: Float[np.ndarray, " n"],
    steps: int,
    near: float,
    busy: float,
) -> float:
    """Improve the unknowns of one stretch in place; they begin within every condition.

    The sum of g_i z_i is returned [s]: at the optimum it is zero, and away from it about the time
    that is left to gain. There are so many steps at most; forty are usual.

    Args:
        blocks: those of `Conditions`.
        axes: number m.
        c: unknowns.
        steps: of Newton's method.
        near: share of the duration by which it may be longer than the optimum.
        busy: time for which the share counts, of a longer duration [s].

    Raises:
        ValueError: the unknowns break a condition.
    """
    slacks = slacks_of.py_func(axes)
    point = np.ones(len(blocks) * (POINTS + PER_SLACK * slacks) * WIDTH)
    equations, scratch = np.empty(PER_UNKNOWN * c.size), np.empty(12 * WIDTH)
    step, ahead = np.zeros(c.size), np.empty(c.size)
    gap = _solved(
        blocks.ravel(), axes, c, steps, near, busy, point, equations, step, ahead, scratch
    )
    if gap < 0:
        raise ValueError("start: needs to be within every condition")
    return gap


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
def _solved(cells, axes, c, steps, near, busy, point, equations, step, ahead, scratch):
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
