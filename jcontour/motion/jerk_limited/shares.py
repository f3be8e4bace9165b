"""Times that share out a motion evenly: the mesh of the second pass.

Where jerk acts, neighbouring times are a tick apart. Where none does, they lie further apart: as
far as the path lets them, and as the time to where they are needed allows.
"""

import numpy as np
from jaxtyping import Bool, Float, Int

from jcontour.motion.jerk_limited import mesh
from jcontour.motion.jerk_limited.planned_motion import JerkLimitedMotion

QUIET = 0.02  # of an axis's jerk limit: less needs no fine cells
SPARSE = 0.1  # of the cells elsewhere, at most
GROWTH = 1 / 32  # of the time to where they are needed: so long may cells become


def shares(
    motion: JerkLimitedMotion,
    tick: Float[np.ndarray, " P"],
    wanted: Bool[np.ndarray, " stretches"],
) -> tuple[Float[np.ndarray, " n"], Int[np.ndarray, " ends"]]:
    """Times from stop to stop that share out every piece evenly, none longer than `tick`.

    The times of all wanted stretches, one after the other with both ends of each; and the index at
    which every stretch begins, and the end of the last.

    Args:
        motion: that is shared out.
        tick: on every piece, longest time between two of them where jerk acts [s].
        wanted: stretches between stops.
    """
    time, share = _activity(motion, tick)
    stops = motion.stopped
    ends = np.unique(np.concatenate([motion.passed, stops]))
    along = np.interp(ends, time, share)
    part, of = np.diff(along), np.searchsorted(stops, ends[:-1], side="right") - 1
    whole = np.diff(along[np.searchsorted(ends, stops)])
    least = np.maximum(np.ceil(mesh.PER_STRETCH * part / whole[of]), mesh.cells_of_curve(part))
    count = np.maximum(np.ceil(part), least).astype(int) * wanted[of]
    piece = np.repeat(np.arange(count.size), count)
    number = np.arange(piece.size) - (np.cumsum(count) - count)[piece]
    inner = np.interp(along[piece] + number * (part / np.maximum(count, 1))[piece], share, time)
    found = np.where(number == 0, ends[piece], inner)
    last = np.cumsum(np.bincount(of, count, stops.size - 1).astype(int)[wanted])
    begins = np.append(0, last)
    return np.insert(found, last, stops[1:][wanted]), begins + np.arange(begins.size)


def _activity(
    motion: JerkLimitedMotion, tick: Float[np.ndarray, " P"]
) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, " k"]]:
    """Table of times, and of the cells that are due up to each: few where no jerk acts."""
    node, begins = motion.nodes, motion.passed[1:-1]
    centre = 0.5 * (node[1:] + node[:-1])
    speed, acceleration, jerk = motion.axes_at(centre)
    active = np.flatnonzero((np.abs(jerk) / motion.limits.jerk).max(axis=-1) > QUIET)
    ramp = mesh.PER_RAMP * tick[np.searchsorted(begins, centre[active])]
    begin, end = np.sort(node[active] - ramp), np.sort(node[active + 1] + ramp)
    time = np.unique(np.clip(np.concatenate([node, begin, end]), 0.0, node[-1]))
    middle = 0.5 * (time[1:] + time[:-1])
    begun, ended = np.searchsorted(begin, middle), np.searchsorted(end, middle)
    since = middle - np.append(-np.inf, end)[ended]
    until = np.append(begin, np.inf)[begun] - middle
    fine = tick[np.searchsorted(begins, middle)]
    longest = fine / SPARSE + GROWTH * np.minimum(np.minimum(since, until), node[-1])
    turning = np.linalg.norm(acceleration, axis=-1) / np.linalg.norm(speed, axis=-1)
    on = np.searchsorted(node, middle) - 1
    quiet = np.maximum(1 / longest, np.minimum(turning[on] / mesh.TURN, SPARSE / fine))
    density = np.where(begun > ended, 1 / fine, quiet)
    share = np.append(0.0, np.cumsum(density * np.diff(time)))
    return time, share * min(1.0, mesh.MOST_CELLS / share[-1])
