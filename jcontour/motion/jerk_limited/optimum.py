"""The quickest warp of time within its conditions, by a primal-dual interior point method.

Every step solves Newton's equations for
    minimise T(c) = sum weight / sqrt(u)    subject to    g(c) >= 0,    g_i z_i = mu,
with mu sent to zero (Nocedal & Wright, Numerical Optimization, chapter 19). The curvature of g is
left out: it is that of 1 / sqrt(u), whose tangent lies below it, so that a step along which the
tangents stay positive stays within the limits. Unknowns of neighbouring cells alone meet, so that
the equations have two diagonals beside the main one.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.linalg import solveh_banded

from jcontour.motion.jerk_limited.conditions import Conditions
from jcontour.motion.jerk_limited.warp import Ordinates

STEPS = 150  # forty are usual
GAP = 1e-3  # of the duration: by so much at most it may be longer than the optimum
TO_THE_BOUND = 0.95  # of the way at which a condition would be met
JAMMED = 0.1  # of a step: less was possible, and the multipliers begin anew
CELLS_AT_ONCE = 20_000  # 100 MB of conditions


class _Values(NamedTuple):
    """Values at unknowns: u at the points, and how far every condition is from its limit."""

    square: Float[np.ndarray, "n 3"]
    room: Float[np.ndarray, "n K"]


def quickest(
    parts: Conditions, ordinates: Ordinates, start: Float[np.ndarray, " n"]
) -> Float[np.ndarray, " n"]:
    """Unknowns of the quickest warp, from unknowns that are within every condition.

    Raises:
        ValueError: the start breaks a condition.
    """
    c, values = start, _values(parts, ordinates, start)
    if not (values.room > 0).all():
        raise ValueError("start: needs to be within every condition")
    duration = _duration(parts, values)
    rows = values.room.size
    mu = 0.1 * duration / rows
    z = mu / values.room
    for _ in range(STEPS):
        try:
            step, change, gain = _newton_step(parts, ordinates, values, z, mu)
        except np.linalg.LinAlgError:  # at rounding: what was found is within all conditions
            break
        moved = min(1.0, TO_THE_BOUND * _reach(values.room, change))
        dual = mu / values.room - z - z / values.room * change
        z = z + min(1.0, TO_THE_BOUND * _reach(z, dual)) * dual
        if not (_values(parts, ordinates, c + moved * step).room > 0).all():  # rounding, likewise
            break
        c = c + moved * step
        values, before = _values(parts, ordinates, c), duration
        duration = _duration(parts, values)
        gap = float(np.sum(values.room * z))
        if gap < GAP * duration and before - duration < 0.3 * GAP * duration:
            break
        mu = gap / rows * _centring(moved, gain / duration)
        if moved < JAMMED:
            mu = gap / rows
            z = mu / values.room
    return c


def within(
    parts: Conditions, ordinates: Ordinates, c: Float[np.ndarray, " n"], margin: float
) -> np.ndarray:
    """Whether every cell keeps all its conditions with that part of each left, (n,)."""
    window = ordinates.window(c)[:, :, None]
    square = (parts.square @ window)[..., 0]
    speed, acceleration, jerk = (
        np.abs((rows @ window)[..., 0]) for rows in (parts.speed, parts.acceleration, parts.jerk)
    )
    bound = np.repeat(1 / np.sqrt(square), jerk.shape[1] // 3, axis=1)
    kept = 1 - margin
    good = (speed < kept).all(axis=1) & (acceleration < kept).all(axis=1)
    return np.logical_and(good, (jerk < kept * bound).all(axis=1))


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


def _duration(parts: Conditions, values: _Values) -> float:
    return float(np.sum(parts.weight / np.sqrt(values.square)))


def _values(parts: Conditions, ordinates: Ordinates, c: Float[np.ndarray, " n"]) -> _Values:
    window = ordinates.window(c)[:, :, None]
    square = (parts.square @ window)[..., 0]
    speed, acceleration, jerk = (
        (rows @ window)[..., 0] for rows in (parts.speed, parts.acceleration, parts.jerk)
    )
    bound = np.repeat(1 / np.sqrt(square), jerk.shape[1] // 3, axis=1)
    middle = (parts.middle @ window)[..., 0]
    room = [middle, 1 - speed, 1 - acceleration, 1 + acceleration, bound - jerk, bound + jerk]
    return _Values(square, np.concatenate(room, axis=1))


def _newton_step(
    parts: Conditions, ordinates: Ordinates, values: _Values, z: np.ndarray, mu: float
) -> tuple[np.ndarray, np.ndarray, float]:
    """Step of the unknowns, what it changes in every condition, and the time that it gains [s]."""
    n = len(parts.weight)
    band, right, slope = np.zeros((3, n)), np.zeros(n), np.zeros((n, 3))
    blocks = [slice(k, k + CELLS_AT_ONCE) for k in range(0, n, CELLS_AT_ONCE)]
    for some in blocks:
        gradient, square = _gradient(parts, values, some), values.square[some]
        speeding = parts.weight[some] * square**-1.5
        slope[some] = -0.5 * np.einsum("np,npk->nk", speeding, parts.square[some])
        scaled = parts.square[some] * (1.5 * 0.5 * speeding / square)[..., None]
        curvature = np.swapaxes(scaled, 1, 2) @ parts.square[some]
        weighted = gradient * (z[some] / values.room[some])[..., None]
        curvature += np.swapaxes(weighted, 1, 2) @ gradient
        pull = np.einsum("nr,nrk->nk", mu / values.room[some], gradient) - slope[some]
        _add(band, right, ordinates.first[some], curvature, pull)
    step = solveh_banded(band, right, check_finite=False)
    window = ordinates.window(step)[:, :, None]
    change = [(_gradient(parts, values, some) @ window[some])[..., 0] for some in blocks]
    return step, np.concatenate(change), float(-np.sum(slope * window[..., 0]))


def _gradient(parts: Conditions, values: _Values, some: slice) -> Float[np.ndarray, "n K 3"]:
    """Gradients of the conditions in the windows of some cells."""
    axes = parts.jerk.shape[1] // 3
    falling = -0.5 * values.square[some, :, None] ** -1.5 * parts.square[some]
    falling = np.repeat(falling, axes, axis=1)
    acceleration, jerk = parts.acceleration[some], parts.jerk[some]
    rows = [
        parts.middle[some],
        -parts.speed[some],
        -acceleration,
        acceleration,
        falling - jerk,
        falling + jerk,
    ]
    return np.concatenate(rows, axis=1)


def _add(band, right, first, curvature, pull) -> None:
    """Add the windows' matrices to the upper band, and their right sides."""
    n = right.size
    for i in range(3):
        right += np.bincount(first + i, pull[:, i], n)
        for j in range(i, 3):
            band[2 - (j - i)] += np.bincount(first + j, curvature[:, i, j], n)
