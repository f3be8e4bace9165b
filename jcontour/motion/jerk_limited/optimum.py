"""The quickest warp of time within its conditions, stretch by stretch: a stop parts two of them."""

import numpy as np
from jaxtyping import Bool, Float, Int

from jcontour.motion.jerk_limited.conditions import Conditions
from jcontour.motion.jerk_limited.newton import POINTS, fill_values, solve
from jcontour.motion.jerk_limited.warp import Ordinates


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
    if not (fullest(parts, ordinates, start) > 1).all():
        raise ValueError("start: needs to be within every condition")
    c = start.copy()
    ends = np.searchsorted(stretch, np.arange(wanted.size + 1))
    gap = np.zeros(wanted.size)
    for k in np.flatnonzero(wanted):
        some = slice(ends[k], ends[k + 1])
        alone = Conditions(*(rows[some] for rows in parts))
        gap[k] = solve(alone, ordinates.first[some] - ends[k], c[some])
    return c, gap


def fullest(
    parts: Conditions, ordinates: Ordinates, c: Float[np.ndarray, " n"]
) -> Float[np.ndarray, " n"]:
    """Factor on the unknowns at which the first condition of every cell is met.

    The speed and the acceleration grow with it, the jerk with its power 3/2.
    """
    n, sides = parts.jerk.shape[:2]
    u, room = np.empty((n, POINTS)), np.empty((n, 1 + POINTS + 4 * sides))
    fill_values(parts, ordinates.first, c, u, room)
    _, speed, faster, jerked = np.split(room, [1, 1 + POINTS, 1 + POINTS + 2 * sides], axis=1)
    linear = 1.0 - np.concatenate([speed, faster], axis=1).min(axis=1)
    bound = np.repeat(1 / np.sqrt(u), sides // POINTS, axis=1)
    jerk = 1.0 - (jerked / np.tile(bound, 2)).min(axis=1)
    return 1.0 / np.maximum(linear, np.cbrt(jerk) ** 2)
