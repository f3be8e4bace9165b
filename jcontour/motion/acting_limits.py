"""Shares of a planned motion's time under what limits it.

The feed and the speeds of the axes act where they are reached. Elsewhere the motion slows down for
a place, and speeds up again behind it: the nearest one towards which its speed falls. Where that is
a blend, or a stop in a corner, the tolerance limits it: a farther blend would be passed faster. For
its ends, its rests and the curves of the path themselves it is the acceleration or the jerk, the
one that is nearer to its limit.
"""

import numpy as np
from jaxtyping import Bool, Float, Int

from jcontour.motion.cornering import Planned

REACHED = 0.98  # of the feed or of a speed: there it acts
AT_ONE_TIME = 1e-9  # of the duration: times that are so near are the same
LIMITS = ("feed", "speed", "acceleration", "jerk", "tolerance")


def limit_shares(planned: Planned) -> dict[str, float]:
    """Share of the cycle time under every limit, and at rest; together they are 1."""
    motion, lasting = planned.motion, np.diff(planned.motion.nodes)
    middle = motion.nodes[:-1] + 0.5 * lasting
    speed, *forces = (np.abs(rows) for rows in motion.axes_at(middle))
    pace = np.linalg.norm(speed, axis=1)
    piece = _pieces(planned, motion.at(middle).arc)
    load = np.stack(
        [(rows / limit).max(axis=1) for rows, limit in zip(forces, motion.limits[1:], strict=True)]
    )
    acts = 2 + np.argmax(load, axis=0)
    acts[_slows_for_a_blend(planned, pace, piece)] = LIMITS.index("tolerance")
    acts[(speed > REACHED * motion.limits.speed).any(axis=1)] = LIMITS.index("speed")
    acts[pace > REACHED * motion.feed[piece]] = LIMITS.index("feed")
    times = np.bincount(acts, lasting, len(LIMITS)) / planned.duration
    shares = dict(zip(LIMITS, times.tolist(), strict=True))
    return shares | {"rest": planned.rests.total / planned.duration}


def _pieces(planned: Planned, arc: Float[np.ndarray, " n"]) -> Int[np.ndarray, " n"]:
    """Numbers of the pieces of the path at places on it [m]."""
    starts = np.append(0.0, np.cumsum(np.asarray(planned.motion.path.extent)))
    last = planned.motion.feed.size - 1
    return np.clip(np.searchsorted(starts, arc, side="right") - 1, 0, last)


def _slows_for_a_blend(
    planned: Planned, pace: Float[np.ndarray, " n"], piece: Int[np.ndarray, " n"]
) -> Bool[np.ndarray, " n"]:
    """Which cells of a motion, of so much speed [m/s], are slower for a blend or a corner."""
    motion, count = planned.motion, pace.size
    own = np.concatenate([planned.rests.begin, [0.0, motion.duration]])
    corner = np.array([np.abs(own - t).min() for t in motion.stopped]) > (
        AT_ONE_TIME * motion.duration
    )
    corners = np.searchsorted(motion.nodes, motion.stopped[corner])
    # the nodes of all cells: where the speed is least between two rises
    at_node = np.linalg.norm(motion.axes_at(motion.nodes)[0], axis=1)
    rises = np.diff(at_node) > 0
    number = np.arange(count)
    begun = np.maximum.accumulate(np.where(rises, -1, number))  # last cell that falls
    ends = np.minimum.accumulate(np.where(rises, number, count)[::-1])[::-1]  # next that rises
    least = np.where(rises, begun + 1, ends)  # node
    blended = np.zeros(count + 1, bool)
    blended[:-1] |= planned.around.blend[piece]
    blended[1:] |= planned.around.blend[piece]
    stopped = np.searchsorted(motion.nodes, motion.stopped)
    blended[stopped] = False
    blended[corners] = True
    return blended[least]
