"""The quickest warp of time within its conditions, by a primal-dual interior point method.

Every step solves Newton's equations for
    minimise T(c) = sum weight / sqrt(u)    subject to    g(c) >= 0,    g_i z_i = mu,
with mu sent to zero (Nocedal & Wright, Numerical Optimization, chapter 19). The curvature of g is
left out: it is that of 1 / sqrt(u), whose tangent lies below it, so that a step along which the
tangents stay positive stays within the limits. Unknowns of neighbouring cells alone meet, so that
the equations have two diagonals beside the main one.
"""

import numpy as np
from jaxtyping import Float
from scipy.linalg import solveh_banded

from jcontour.motion.jerk_limited.conditions import Conditions
from jcontour.motion.jerk_limited.newton import POINTS, change, equations, values
from jcontour.motion.jerk_limited.warp import Ordinates

STEPS = 150  # forty are usual
GAP = 1e-3  # of the duration: by so much at most it may be longer than the optimum
TO_THE_BOUND = 0.95  # of the way at which a condition would be met
JAMMED = 0.1  # of a step: less was possible, and the multipliers begin anew


def quickest(
    parts: Conditions, ordinates: Ordinates, start: Float[np.ndarray, " n"]
) -> Float[np.ndarray, " n"]:
    """Unknowns of the quickest warp, from unknowns that are within every condition.

    Raises:
        ValueError: the start breaks a condition.
    """
    c, at = start, values(parts, ordinates, start)
    if not (at.room > 0).all():
        raise ValueError("start: needs to be within every condition")
    duration = _duration(parts, at.square)
    rows = at.room.size
    mu = 0.1 * duration / rows
    z = mu / at.room
    for _ in range(STEPS):
        newton = equations(parts, ordinates, at, z, mu)
        try:
            step = solveh_banded(newton.band, newton.right, check_finite=False)
        except np.linalg.LinAlgError:  # at rounding: what was found is within all conditions
            break
        gain = float(-np.sum(newton.slope * ordinates.window(step)))
        moves = change(parts, ordinates, at.square, step)
        moved = min(1.0, TO_THE_BOUND * _reach(at.room, moves))
        dual = (mu - z * moves) / at.room - z
        z = z + min(1.0, TO_THE_BOUND * _reach(z, dual)) * dual
        there = values(parts, ordinates, c + moved * step)
        if not (there.room > 0).all():  # rounding, likewise
            break
        c, at, before = c + moved * step, there, duration
        duration = _duration(parts, at.square)
        gap = float(np.sum(at.room * z))
        if gap < GAP * duration and before - duration < 0.3 * GAP * duration:
            break
        mu = gap / rows * _centring(moved, gain / duration)
        if moved < JAMMED:
            mu = gap / rows
            z = mu / at.room
    return c


def fullest(
    parts: Conditions, ordinates: Ordinates, c: Float[np.ndarray, " n"]
) -> Float[np.ndarray, " n"]:
    """Factor on the unknowns at which the first condition of every cell is met.

    The speed and the acceleration grow with it, the jerk with its power 3/2.
    """
    at = values(parts, ordinates, c)
    sides = parts.jerk.shape[1]
    axes = sides // POINTS
    speed, faster, jerked = np.split(at.room[:, 1:], [POINTS, POINTS + 2 * sides], axis=1)
    linear = 1.0 - np.concatenate([speed, faster], axis=1).min(axis=1)
    bound = np.repeat(1 / np.sqrt(at.square), axes, axis=1)
    jerk = 1.0 - (jerked / np.tile(bound, 2)).min(axis=1)
    return 1.0 / np.maximum(linear, np.cbrt(jerk) ** 2)


def _centring(moved: float, gain: float) -> float:
    """Factor on mu: small where Newton's step was taken whole, near one while far from the path."""
    if gain > 0.3:
        return 0.9
    return 0.1 if moved > 0.9 else 0.2 if moved > 0.5 else 0.5 if moved > 0.2 else 0.9


def _reach(values: np.ndarray, change: np.ndarray) -> float:
    """How much of a change can be made until a value meets zero."""
    falling = change < 0
    if not falling.any():
        return np.inf
    return float(np.min(-values[falling] / change[falling]))


def _duration(parts: Conditions, square: Float[np.ndarray, "n 3"]) -> float:
    return float(np.sum(parts.weight / np.sqrt(square)))
