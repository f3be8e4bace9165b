"""The quickest warp of time within its conditions, stretch by stretch: a stop parts two of them."""

import numpy as np
from jaxtyping import Bool, Float, Int

from jcontour.compiled import compiled
from jcontour.motion.jerk_limited.conditions import Conditions
from jcontour.motion.jerk_limited.newton import POINTS, solve
from jcontour.motion.jerk_limited.warp import Ordinates
from jcontour.native.lanes import part

STEPS = 150  # of Newton's method; forty are usual


def quickest(
    parts: Conditions,
    ordinates: Ordinates,
    start: Float[np.ndarray, " n"],
    stretch: Int[np.ndarray, " n"],
    wanted: Bool[np.ndarray, " stretches"],
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " stretches"]]:
    """Unknowns of the quickest warp, from unknowns that are within every condition.

    Beside them, for every stretch that is solved, about the time that is left to gain [s].

    Args:
        parts: conditions of the cells.
        ordinates: of the cells.
        start: unknowns to begin with.
        stretch: number of the stretch of every cell.
        wanted: stretches that are solved; the others stay as they are.

    Raises:
        ValueError: the start breaks a condition.
    """
    if not (fullest(parts, ordinates.first, start) > 1).all():
        raise ValueError("start: needs to be within every condition")
    c = start.copy()
    ends = np.searchsorted(stretch, np.arange(wanted.size + 1))
    gap = np.zeros(wanted.size)
    for k in np.flatnonzero(wanted):
        some = slice(ends[k], ends[k + 1])
        alone = Conditions(*(rows[some] for rows in parts))
        gap[k] = solve(alone, ordinates.first[some] - ends[k], c[some], STEPS)
    return c, gap


@part
def _times(rows, i, r, x, y, z):
    """Row r of cell i times a window."""
    return rows[i, r, 0] * x + rows[i, r, 1] * y + rows[i, r, 2] * z


@compiled
def fullest(
    parts: Conditions, first: Int[np.ndarray, " n"], c: Float[np.ndarray, " n"]
) -> Float[np.ndarray, " n"]:
    """Factor on the unknowns at which the first condition of every cell is met.

    The speed and the acceleration grow with it, the jerk with its power 3/2.
    """
    factor = np.empty(first.size)
    axes = parts.jerk.shape[1] // POINTS
    for i in range(first.size):
        x, y, z = c[first[i]], c[first[i] + 1], c[first[i] + 2]
        linear, jerk = 0.0, 0.0
        for p in range(POINTS):
            linear = max(linear, _times(parts.speed, i, p, x, y, z))
            rate = np.sqrt(_times(parts.square, i, p, x, y, z))
            for r in range(p * axes, (p + 1) * axes):
                linear = max(linear, abs(_times(parts.acceleration, i, r, x, y, z)))
                jerk = max(jerk, rate * abs(_times(parts.jerk, i, r, x, y, z)))
        factor[i] = 1.0 / max(linear, np.cbrt(jerk) ** 2)
    return factor
