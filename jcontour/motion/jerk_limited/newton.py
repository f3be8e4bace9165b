"""Newton's equations of the quickest warp of time, cell by cell, compiled.

The conditions of a cell are 1 + 3 + 12 m for m axes: the middle ordinate, the speed, and the two
sides of the acceleration and of the jerk, at three points each.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from jcontour.compiled import compiled
from jcontour.motion.jerk_limited.conditions import Conditions
from jcontour.motion.jerk_limited.warp import Ordinates

POINTS = 3  # of a cell


class Values(NamedTuple):
    """Values at unknowns: u at the points, and how far every condition is from its limit."""

    square: Float[np.ndarray, "n 3"]
    room: Float[np.ndarray, "n K"]


class Equations(NamedTuple):
    """Newton's equations: the matrix's main diagonal and the two above it, and the right side.

    Attributes:
        band: (3, n), as `scipy.linalg.solveh_banded` has it.
        right: (n,).
        slope: (n, 3) of the duration in the windows of the cells.
    """

    band: Float[np.ndarray, "3 n"]
    right: Float[np.ndarray, " n"]
    slope: Float[np.ndarray, "n 3"]


def values(parts: Conditions, ordinates: Ordinates, c: Float[np.ndarray, " n"]) -> Values:
    """u and the rooms at unknowns."""
    n, sides = parts.jerk.shape[:2]
    found = Values(np.empty((n, POINTS)), np.empty((n, 1 + POINTS + 4 * sides)))
    _fill_values(*_arrays(parts), ordinates.first, c, *found)
    return found


def equations(
    parts: Conditions,
    ordinates: Ordinates,
    at: Values,
    z: Float[np.ndarray, "n K"],
    mu: float,
) -> Equations:
    """Newton's equations at unknowns with multipliers z, towards g_i z_i = mu."""
    n = len(parts.weight)
    found = Equations(np.zeros((POINTS, n)), np.zeros(n), np.zeros((n, POINTS)))
    _fill_equations(*_arrays(parts), parts.weight, ordinates.first, *at, z, mu, *found)
    return found


def change(
    parts: Conditions,
    ordinates: Ordinates,
    square: Float[np.ndarray, "n 3"],
    step: Float[np.ndarray, " n"],
) -> Float[np.ndarray, "n K"]:
    """What a step of the unknowns changes in the rooms, to first order."""
    n, sides = parts.jerk.shape[:2]
    found = np.empty((n, 1 + POINTS + 4 * sides))
    _fill_change(*_arrays(parts), ordinates.first, square, step, found)
    return found


def _arrays(parts: Conditions) -> tuple[np.ndarray, ...]:
    return parts.middle, parts.square, parts.speed, parts.acceleration, parts.jerk


@compiled
def _dot(row: np.ndarray, c: np.ndarray, first: int) -> float:
    return row[0] * c[first] + row[1] * c[first + 1] + row[2] * c[first + 2]


@compiled
def _fill_values(
    middle: np.ndarray,
    square: np.ndarray,
    speed: np.ndarray,
    acceleration: np.ndarray,
    jerk: np.ndarray,
    first: Int[np.ndarray, " n"],
    c: np.ndarray,
    u: np.ndarray,
    room: np.ndarray,
) -> None:
    sides = jerk.shape[1]
    axes = sides // POINTS
    for i in range(first.size):
        room[i, 0] = _dot(middle[i, 0], c, first[i])
        for p in range(POINTS):
            u[i, p] = _dot(square[i, p], c, first[i])
            room[i, 1 + p] = 1.0 - _dot(speed[i, p], c, first[i])
        for r in range(sides):
            k = 1 + POINTS + r
            pushed = _dot(acceleration[i, r], c, first[i])
            room[i, k], room[i, k + sides] = 1.0 - pushed, 1.0 + pushed
            jerked, bound = _dot(jerk[i, r], c, first[i]), 1.0 / np.sqrt(u[i, r // axes])
            room[i, k + 2 * sides], room[i, k + 3 * sides] = bound - jerked, bound + jerked


@compiled
def _fill_gradient(
    middle: np.ndarray,
    square: np.ndarray,
    speed: np.ndarray,
    acceleration: np.ndarray,
    jerk: np.ndarray,
    u: np.ndarray,
    g: np.ndarray,
) -> None:
    """Gradients of all rooms of one cell in its window, (K, 3)."""
    sides = jerk.shape[0]
    axes = sides // POINTS
    for b in range(3):
        g[0, b] = middle[0, b]
        for p in range(POINTS):
            g[1 + p, b] = -speed[p, b]
        for r in range(sides):
            k, p = 1 + POINTS + r, r // axes
            g[k, b], g[k + sides, b] = -acceleration[r, b], acceleration[r, b]
            falling = -0.5 * square[p, b] / (u[p] * np.sqrt(u[p]))
            g[k + 2 * sides, b] = falling - jerk[r, b]
            g[k + 3 * sides, b] = falling + jerk[r, b]


@compiled
def _fill_equations(
    middle: np.ndarray,
    square: np.ndarray,
    speed: np.ndarray,
    acceleration: np.ndarray,
    jerk: np.ndarray,
    weight: np.ndarray,
    first: Int[np.ndarray, " n"],
    u: np.ndarray,
    room: np.ndarray,
    z: np.ndarray,
    mu: float,
    band: np.ndarray,
    right: np.ndarray,
    slope: np.ndarray,
) -> None:
    g = np.empty((room.shape[1], 3))
    for i in range(first.size):
        _fill_gradient(middle[i], square[i], speed[i], acceleration[i], jerk[i], u[i], g)
        for p in range(POINTS):
            speeding = 0.5 * weight[i, p] / (u[i, p] * np.sqrt(u[i, p]))
            for a in range(3):
                slope[i, a] -= speeding * square[i, p, a]
                for b in range(a, 3):
                    bend = 1.5 * speeding / u[i, p] * square[i, p, a] * square[i, p, b]
                    band[2 - (b - a), first[i] + b] += bend
        for a in range(3):
            right[first[i] + a] -= slope[i, a]
        for k in range(room.shape[1]):
            held, pull = z[i, k] / room[i, k], mu / room[i, k]
            for a in range(3):
                right[first[i] + a] += pull * g[k, a]
                for b in range(a, 3):
                    band[2 - (b - a), first[i] + b] += held * g[k, a] * g[k, b]


@compiled
def _fill_change(
    middle: np.ndarray,
    square: np.ndarray,
    speed: np.ndarray,
    acceleration: np.ndarray,
    jerk: np.ndarray,
    first: Int[np.ndarray, " n"],
    u: np.ndarray,
    step: np.ndarray,
    changed: np.ndarray,
) -> None:
    g = np.empty((changed.shape[1], 3))
    for i in range(first.size):
        _fill_gradient(middle[i], square[i], speed[i], acceleration[i], jerk[i], u[i], g)
        for k in range(changed.shape[1]):
            changed[i, k] = _dot(g[k], step, first[i])
