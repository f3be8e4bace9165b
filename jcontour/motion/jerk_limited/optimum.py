"""The quickest warp of time within its conditions, stretch by stretch: a stop parts two of them."""

import os
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from jaxtyping import Bool, Float, Int

from jcontour.motion.jerk_limited.conditions import SPEED, SQUARE, STILL, Conditions
from jcontour.motion.jerk_limited.newton import solve

STEPS = 150  # of Newton's method; forty are usual
MANY = 10_000  # unknowns: fewer are solved sooner than threads have started


def quickest(
    parts: Conditions,
    start: Float[np.ndarray, " n"],
    stretch: Int[np.ndarray, " n"],
    wanted: Bool[np.ndarray, " stretches"],
    near: float,
    busy: Float[np.ndarray, " stretches"],
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " stretches"]]:
    """Unknowns of the quickest warp, from unknowns that are within every condition.

    Beside them, for every stretch that is solved, about the time that is left to gain [s].

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
    gap = np.zeros(wanted.size)

    def improve(k: int) -> None:
        of_stretch = parts.blocks[parts.first[k] : parts.first[k + 1]]
        gap[k] = solve(of_stretch, parts.axes, c[ends[k] : ends[k + 1]], STEPS, near, busy[k])

    numbers = np.flatnonzero(wanted).tolist()
    if c.size < MANY:
        for k in numbers:
            improve(k)
        return c, gap
    with ThreadPoolExecutor(os.cpu_count()) as threads:
        list(threads.map(improve, numbers))  # what is wrong is raised here
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
