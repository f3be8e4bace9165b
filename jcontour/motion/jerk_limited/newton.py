"""The quickest warp of time between two stops, by a primal-dual interior point method, compiled.

Every step solves Newton's equations for
    minimise T(c) = sum weight / sqrt(u)    subject to    g(c) >= 0,    g_i z_i = mu,
with mu sent to zero (Nocedal & Wright, Numerical Optimization, chapter 19). The curvature of g is
left out: it is that of 1 / sqrt(u), whose tangent lies below it, so that a step along which the
tangents stay positive stays within the limits. Unknowns of neighbouring cells alone meet, so that
the equations have two diagonals beside the main one.

The conditions g of a cell are 1 + 3 + 12 m for m axes: the middle ordinate, the speed, and the two
sides of the acceleration and of the jerk, at three points each.
"""

import numpy as np
from jaxtyping import Int

from jcontour.compiled import compiled
from jcontour.motion.jerk_limited.conditions import Conditions

POINTS = 3  # of a cell
ROUNDING = 1e-15  # of a diagonal element: a smaller pivot is lost
GAP = 1e-4  # of the duration: by so much at most it may be longer than the optimum
STEPS = 150  # forty are usual
TO_THE_BOUND = 0.95  # of the way at which a condition would be met
JAMMED = 0.1  # of a step: less was possible, and the multipliers begin anew


@compiled
def _dot(rows: np.ndarray, i: int, r: int, c: np.ndarray, first: int) -> float:
    """Row r of cell i times its window of c; a view of the row would cost more than the product."""
    return rows[i, r, 0] * c[first] + rows[i, r, 1] * c[first + 1] + rows[i, r, 2] * c[first + 2]


@compiled
def fill_values(
    parts: Conditions,
    first: Int[np.ndarray, " n"],
    c: np.ndarray,
    u: np.ndarray,
    room: np.ndarray,
) -> None:
    """Write u at the points, and how far every condition is from its limit (n, K)."""
    sides = parts.jerk.shape[1]
    axes = sides // POINTS
    for i in range(first.size):
        room[i, 0] = _dot(parts.middle, i, 0, c, first[i])
        for p in range(POINTS):
            u[i, p] = _dot(parts.square, i, p, c, first[i])
            room[i, 1 + p] = 1.0 - _dot(parts.speed, i, p, c, first[i])
        for r in range(sides):
            k = 1 + POINTS + r
            pushed = _dot(parts.acceleration, i, r, c, first[i])
            room[i, k], room[i, k + sides] = 1.0 - pushed, 1.0 + pushed
            jerked, bound = _dot(parts.jerk, i, r, c, first[i]), 1.0 / np.sqrt(u[i, r // axes])
            room[i, k + 2 * sides], room[i, k + 3 * sides] = bound - jerked, bound + jerked


@compiled
def _add_rows(
    rows: np.ndarray,
    i: int,
    held: np.ndarray,
    pull: np.ndarray,
    at: int,
    band: np.ndarray,
    right: np.ndarray,
) -> None:
    """Add held g g' to the equations and pull g to their right side, for all rows g of cell i."""
    a = b = c = d = e = f = x = y = z = 0.0
    for r in range(rows.shape[1]):
        first, second, third, weight = rows[i, r, 0], rows[i, r, 1], rows[i, r, 2], held[r]
        a += weight * first * first
        b += weight * first * second
        c += weight * first * third
        d += weight * second * second
        e += weight * second * third
        f += weight * third * third
        x += pull[r] * first
        y += pull[r] * second
        z += pull[r] * third
    band[2, at] += a
    band[1, at + 1] += b
    band[0, at + 2] += c
    band[2, at + 1] += d
    band[1, at + 2] += e
    band[2, at + 2] += f
    right[at] += x
    right[at + 1] += y
    right[at + 2] += z


@compiled
def _fill_gradients(parts: Conditions, i: int, u: np.ndarray, g: np.ndarray) -> None:
    """Gradients of all rooms of cell i in its window, (1, K, 3)."""
    sides = parts.jerk.shape[1]
    axes = sides // POINTS
    for b in range(3):
        g[0, 0, b] = parts.middle[i, 0, b]
        for p in range(POINTS):
            g[0, 1 + p, b] = -parts.speed[i, p, b]
    for p in range(POINTS):
        slope = -0.5 / (u[i, p] * np.sqrt(u[i, p]))
        for r in range(p * axes, (p + 1) * axes):
            k = 1 + POINTS + r
            for b in range(3):
                pushed, jerked = parts.acceleration[i, r, b], parts.jerk[i, r, b]
                falling = slope * parts.square[i, p, b]
                g[0, k, b], g[0, k + sides, b] = -pushed, pushed
                g[0, k + 2 * sides, b] = falling - jerked
                g[0, k + 3 * sides, b] = falling + jerked


@compiled
def _fill_equations(
    parts: Conditions,
    first: Int[np.ndarray, " n"],
    u: np.ndarray,
    room: np.ndarray,
    z: np.ndarray,
    mu: float,
    band: np.ndarray,
    right: np.ndarray,
    slope: np.ndarray,
) -> None:
    band[:], right[:], slope[:] = 0.0, 0.0, 0.0
    count = room.shape[1]
    g, held, pull = np.empty((1, count, 3)), np.empty(count), np.empty(count)
    bend, speeding = np.empty(POINTS), np.empty(POINTS)
    for i in range(first.size):
        _fill_gradients(parts, i, u, g)
        for k in range(count):
            inverse = 1.0 / room[i, k]
            held[k], pull[k] = z[i, k] * inverse, mu * inverse
        _add_rows(g, 0, held, pull, first[i], band, right)
        for p in range(POINTS):
            speeding[p] = 0.5 * parts.weight[i, p] / (u[i, p] * np.sqrt(u[i, p]))
            bend[p] = 1.5 * speeding[p] / u[i, p]
            for b in range(3):
                slope[first[i] + b] -= speeding[p] * parts.square[i, p, b]
        _add_rows(parts.square, i, bend, speeding, first[i], band, right)


@compiled
def _fill_change(
    parts: Conditions, i: int, first: int, u: np.ndarray, step: np.ndarray, changed: np.ndarray
) -> None:
    """How much a step changes the rooms of cell i (K,)."""
    sides = parts.jerk.shape[1]
    axes = sides // POINTS
    changed[0] = _dot(parts.middle, i, 0, step, first)
    for p in range(POINTS):
        changed[1 + p] = -_dot(parts.speed, i, p, step, first)
        slope = -0.5 / (u[i, p] * np.sqrt(u[i, p]))
        falling = slope * _dot(parts.square, i, p, step, first)
        for r in range(p * axes, (p + 1) * axes):
            k = 1 + POINTS + r
            pushed = _dot(parts.acceleration, i, r, step, first)
            jerked = _dot(parts.jerk, i, r, step, first)
            changed[k], changed[k + sides] = -pushed, pushed
            changed[k + 2 * sides], changed[k + 3 * sides] = falling - jerked, falling + jerked


@compiled
def _fill_duals(
    parts: Conditions,
    first: Int[np.ndarray, " n"],
    u: np.ndarray,
    room: np.ndarray,
    z: np.ndarray,
    mu: float,
    step: np.ndarray,
    dual: np.ndarray,
) -> tuple[float, float]:
    """Write the step of the multipliers; how much of both steps can be made until one meets 0."""
    changed = np.empty(room.shape[1])
    most, most_dual = np.inf, np.inf
    for i in range(first.size):
        _fill_change(parts, i, first[i], u, step, changed)
        for k in range(room.shape[1]):
            if -changed[k] * most > room[i, k]:
                most = -room[i, k] / changed[k]
            dual[i, k] = (mu - z[i, k] * changed[k]) / room[i, k] - z[i, k]
            if -dual[i, k] * most_dual > z[i, k]:
                most_dual = -z[i, k] / dual[i, k]
    return most, most_dual


@compiled
def _solve_equations(band: np.ndarray, right: np.ndarray) -> None:
    """Solve Newton's equations in place by their factors L D L'.

    An unknown whose pivot is lost to rounding stays where it is.

    Args:
        band: (3, n) second diagonal above the main one, the first, and the main one.
        right: (n,) right side, and then the step.
    """
    n = right.size
    for i in range(n):
        far = band[0, i] / band[2, i - 2] if i > 1 else 0.0
        near = band[1, i] - (far * band[1, i - 1] if i > 1 else 0.0)
        pivot = band[2, i] - far * band[0, i]
        if i > 0:
            pivot -= near * near / band[2, i - 1]
        if not pivot > ROUNDING * band[2, i]:
            pivot = np.inf
        band[1, i], band[2, i] = near, pivot
        if i > 0:
            right[i] -= near / band[2, i - 1] * right[i - 1]
        if i > 1:
            right[i] -= far * right[i - 2]
    for i in range(n - 1, -1, -1):
        right[i] /= band[2, i]
        if i + 1 < n:
            right[i] -= band[1, i + 1] / band[2, i] * right[i + 1]
        if i + 2 < n:
            right[i] -= band[0, i + 2] / band[2, i] * right[i + 2]


@compiled
def _centring(moved: float, gain: float) -> float:
    """Factor on mu: small where Newton's step was taken whole, near one while far from the path."""
    if gain > 0.3:
        return 0.9
    return 0.1 if moved > 0.9 else 0.2 if moved > 0.5 else 0.5 if moved > 0.2 else 0.9


@compiled
def solve(
    parts: Conditions,
    first: Int[np.ndarray, " n"],
    c: np.ndarray,
) -> float:
    """Improve the unknowns of one stretch in place; they begin within every condition.

    The sum of g_i z_i is returned [s]: at the optimum it is zero, and away from it about the time
    that is left to gain.
    """
    n, sides = parts.jerk.shape[:2]
    rows = 1 + POINTS + 4 * sides
    u, room = np.empty((n, POINTS)), np.empty((n, rows))
    ahead, beyond = np.empty((n, POINTS)), np.empty((n, rows))
    dual, slope = np.empty((n, rows)), np.empty(n)
    band, step = np.empty((POINTS, n)), np.empty(n)
    fill_values(parts, first, c, u, room)
    duration = np.sum(parts.weight / np.sqrt(u))
    mu = 0.1 * duration / room.size
    z = mu / room
    gap = mu * room.size
    for _ in range(STEPS):
        _fill_equations(parts, first, u, room, z, mu, band, step, slope)
        _solve_equations(band, step)
        gain = -np.sum(slope * step)
        reach, dual_reach = _fill_duals(parts, first, u, room, z, mu, step, dual)
        moved = min(1.0, TO_THE_BOUND * reach)
        z += min(1.0, TO_THE_BOUND * dual_reach) * dual
        fill_values(parts, first, c + moved * step, ahead, beyond)
        if not beyond.min() > 0:  # at rounding: what was found is within all conditions
            return gap
        c += moved * step
        u, ahead = ahead, u
        room, beyond = beyond, room
        before, duration = duration, np.sum(parts.weight / np.sqrt(u))
        gap = np.sum(room * z)
        if gap < GAP * duration and before - duration < 0.3 * GAP * duration:
            return gap
        mu = gap / room.size * _centring(moved, gain / duration)
        if moved < JAMMED:
            mu = gap / room.size
            z = mu / room
    return gap
