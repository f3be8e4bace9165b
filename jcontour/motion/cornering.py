"""Motion of limited jerk along a contour: past its corners, or with stops where they are quicker.

A blend takes a corner within a tolerance, often at a crawl; far away from it the tool could have
been quicker to a stop in the corner. Both are compared between two stops of the blended motion,
over all of the corners in between, and where the feed changes. Pieces that meet smoothly at one
feed, as two arcs of one circle do, are one leg: nothing makes a motion stop between them. The time
of a line from rest to rest is known in closed form. That of a curve is estimated from its length
and the most that limits allow anywhere on it, so that it is rather too short. Where stops look
quicker, the path is planned again without blends there. A joint that is stopped in once stays so:
there is an end.

A larger tolerance is not used where it saves no time. The motion is planned again with less of it,
everywhere at first. Where a piece of the contour is then passed later than before, its joints keep
what they had. The rest goes on with less, down to the finest.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from jcontour.geometry.contour import Contour, unpadded
from jcontour.geometry.coordinates import Numbers
from jcontour.motion.blending import BlendedPath
from jcontour.motion.feed_laws import Rests, SharpTurnError, rest_of_pieces
from jcontour.motion.jerk_limited.limits import Asked, AxisLimits, everywhere, joints
from jcontour.motion.jerk_limited.planning import JerkLimitedMotion, jerk_limited
from jcontour.motion.point_to_point import PointToPoint
from jcontour.motion.smoothing import smooth_path

WORTH = 1e-3  # of the duration: a smaller gain needs no second plan, unless it decides
FINEST = 2e-6  # [m] of a deviation: to take less of it is not worth another plan
LESS = 7.0  # times less of the tolerance in the next plan
TRIES = 6  # plans with less of the tolerance
REACHED = 0.98  # of the feed or of a speed: there it acts
AT_ONCE = 16_384  # pieces whose limits are looked at
AT_ONE_TIME = 1e-9  # of the duration: times that are so near are the same
LIMITS = ("feed", "speed", "acceleration", "jerk", "tolerance")


class Planned(NamedTuple):
    """A jerk-limited motion, the path with blends that it runs along, and where it rests.

    Attributes:
        passed: joints of the contour that it need not stop in.
    """

    around: BlendedPath
    motion: JerkLimitedMotion
    rests: Rests
    passed: Bool[np.ndarray, " joints"]

    @property
    def duration(self) -> float:
        """Cycle time, rests included [s]."""
        return self.motion.duration + self.rests.total


def cornered(
    contour: Contour,
    feed: Float[np.ndarray, " P"],
    limits: AxisLimits,
    tolerance: float,
    rest: Float[np.ndarray, " P"] | None = None,
    alike: Bool[np.ndarray, " joints"] | None = None,
) -> Planned:
    """Quickest motion within a tolerance of a contour, with no more of it than the time needs.

    The motion is that of `quickest`, or one that is longer by a thousandth at most and nearer to
    the contour: each of its joints has the tolerance, or a seventh of it, or a seventh of that, and
    so on, down to 2 um.

    Its arguments are those of `quickest`.

    Raises:
        ValueError: as `quickest`.
        SharpTurnError: as `quickest`.
    """
    best = quickest(contour, feed, limits, tolerance, rest, alike)
    rest = rest_of_pieces(rest, feed.size)
    most, before = (1 + WORTH) * best.motion.duration, _elapsed(best)
    given = np.full(feed.size - 1, float(tolerance))
    open_ = np.ones(given.size, bool)
    for _ in range(TRIES):
        around = best.around
        begin, end = around.piece, np.append(around.piece[1:], given.size)
        far = around.apart > FINEST
        change = np.zeros(given.size + 3, int)  # of the ranges of joints beside far pieces
        np.add.at(change, begin[far], 1)
        np.add.at(change, end[far] + 2, -1)
        open_ &= (np.cumsum(change)[1:-2] > 0) & (given > FINEST)
        if not open_.any():
            break
        less = np.where(open_, np.maximum(FINEST, given / LESS), given)
        latest = _planned(contour, feed, limits, less, best.passed, rest, alike)
        nearer = latest.around.deviation <= best.around.deviation
        if nearer and latest.motion.duration <= most:
            best, given = latest, less
            continue
        # the fewest pieces without which the excess of all times sums to what is allowed
        excess = np.maximum(_elapsed(latest) - before, 0.0)
        order = np.argsort(-excess)
        left = excess.sum() - np.cumsum(excess[order])
        later = np.zeros(excess.size, bool)
        beyond = np.count_nonzero(left > WORTH / 2 * best.motion.duration)
        later[order[: 1 + beyond]] = True
        still = open_ & ~(later[1:] | later[:-1])
        if (still == open_).all():
            break
        open_ = still
    return best


def _elapsed(planned: Planned) -> Float[np.ndarray, " P"]:
    """Time that a motion takes for every piece of the contour [s]."""
    starts = np.append(0.0, np.cumsum(unpadded(planned.around.contour).extent))
    return np.diff(planned.motion.reached(planned.around.path_arc(starts)))


def quickest(
    contour: Contour,
    feed: Float[np.ndarray, " P"],
    limits: AxisLimits,
    tolerance: float,
    rest: Float[np.ndarray, " P"] | None = None,
    alike: Bool[np.ndarray, " joints"] | None = None,
) -> Planned:
    """Quickest motion that is found within a tolerance of a contour, from rest to rest.

    On lines it is never slower than one that stops in every corner, but for a ten-thousandth where
    a long way at a slow feed is planned as a whole.

    >>> from jcontour.geometry import contours
    >>> limits = AxisLimits.of(2, acceleration=[0.1, 10.0], jerk=[1.0, 1000.0])
    >>> corner = contours.polyline([[0.0, 0.0], [10e-3, 1e-3], [10e-3, 30e-3]])
    >>> quickest(corner, np.full(2, 0.1), limits, 2e-6).motion.stops.size  # one in the corner
    3

    Args:
        contour: one contour, not a stack.
        feed: greatest speed on every piece [m/s].
        limits: of the axes.
        tolerance: greatest distance from the contour [m]; 0 stops in every corner.
        rest: (P,) how long it rests at the end of every piece [s], 0 for a stop alone, NaN where it
            goes on; nowhere when not given.
        alike: see `smooth_path`.

    Raises:
        ValueError: as `smooth_path` and `jerk_limited`.
        SharpTurnError: as `jerk_limited`, with the number of the piece of the contour.
    """
    rest = rest_of_pieces(rest, feed.size)
    passed = np.isnan(rest[:-1])
    best = latest = _planned(contour, feed, limits, tolerance, passed, rest, alike)
    while (stopping := passed & _better_stopped(latest, feed, limits, ~passed)).any():
        passed = passed & ~stopping
        latest = _planned(contour, feed, limits, tolerance, passed, rest, alike)
        best = min(best, latest, key=lambda one: one.motion.duration)
    return best


def _planned(
    contour: Contour,
    feed: Float[np.ndarray, " P"],
    limits: AxisLimits,
    tolerance: Numbers,
    passed: Bool[np.ndarray, " joints"],
    rest: Float[np.ndarray, " P"],
    alike: Bool[np.ndarray, " joints"] | None,
) -> Planned:
    """Motion past some joints, within a tolerance at every one of them; it stops in the others."""
    around = smooth_path(contour, tolerance, passed, alike, Asked(feed, limits))
    stopping = around.joint(np.flatnonzero(~passed))
    try:
        motion = jerk_limited(around.path, around.feed(feed), limits, stopping)
    except SharpTurnError as error:  # with the piece of the contour
        raise SharpTurnError(int(around.piece[error.piece]), error.steps) from None
    pieces = np.flatnonzero(~np.isnan(rest))  # each ends in a stop of the motion
    ends = np.cumsum(unpadded(around.path).extent)[around.joint(pieces)]
    return Planned(around, motion, Rests(motion.reached(ends), rest[pieces]), passed)


def _better_stopped(
    planned: Planned,
    feed: Float[np.ndarray, " P"],
    limits: AxisLimits,
    stopped_in: Bool[np.ndarray, " joints"],
) -> Bool[np.ndarray, " joints"]:
    """Joints between legs that a motion passes, and rather should stop in."""
    around, motion = planned.around, planned.motion
    pieces = unpadded(around.contour)
    smooth = joints(pieces).smooth(feed, float(limits.acceleration.min()))
    stops = ~smooth | (feed[1:] != feed[:-1]) | stopped_in
    first = np.flatnonzero(np.append(True, stops))  # piece of every leg
    starts = np.append(0.0, np.cumsum(pieces.extent))
    ends = starts[np.append(first, feed.size)]
    middle = around.true_arc(motion.stops)[1:-1]
    stretch = np.searchsorted(middle, 0.5 * (ends[1:] + ends[:-1]))
    blended = np.diff(motion.stopped)
    # Length, speed, acceleration and jerk of every leg, and a bound of its time [s]
    allowed = np.empty((4, feed.size))
    with np.errstate(divide="ignore", over="ignore"):
        for part in (slice(k, k + AT_ONCE) for k in range(0, feed.size, AT_ONCE)):
            direction, bend, _ = np.abs(everywhere(pieces.taken(part)))
            rows = [limit / direction for limit in limits] + [limits.acceleration / bend]
            allowed[:, part] = [row.min(-1).max(0) for row in rows]
    speed, acceleration, jerk, turning = *allowed[:3], np.sqrt(allowed[3])
    speed = np.minimum(np.minimum(feed, speed), turning)
    length = np.add.reduceat(pieces.extent, first)
    cruise = np.add.reduceat(pieces.extent / speed, first)
    most = [np.maximum.reduceat(rows, first) for rows in (speed, acceleration, jerk)]
    ramps = np.maximum(2 * np.sqrt(length / most[1]), np.cbrt(32 * length / most[2]))
    law, least = np.stack([length, *most], axis=1), np.maximum(cruise, ramps)
    several = np.bincount(stretch, minlength=blended.size) > 1
    stopped = np.bincount(stretch, least, blended.size)
    for k in np.flatnonzero(several & (stopped < blended)):
        legs = slice(*np.searchsorted(stretch, [k, k + 1]))
        exact = [PointToPoint(*row).duration for row in law[legs]]
        stopped[k] = np.maximum(exact, least[legs]).sum()
    gain = np.where(several, blended - stopped, 0.0)
    slow = gain > 0
    worth = gain[slow].sum() >= WORTH * motion.duration or gain.sum() > 0
    stops[stops] = worth & slow[stretch[1:]] & (stretch[1:] == stretch[:-1])
    return stops


def limit_shares(planned: Planned) -> dict[str, float]:
    """Share of the cycle time under every limit, and at rest; together they are 1.

    The feed and the speeds of the axes act where they are reached. Elsewhere the motion slows down
    for a place, and speeds up again behind it: the nearest one towards which its speed falls. Where
    that is a blend, or a stop in a corner, the tolerance limits it: a farther blend would be passed
    faster. For its ends, its rests and the curves of the path themselves it is the acceleration or
    the jerk, the one that is nearer to its limit.
    """
    motion, lasting = planned.motion, np.diff(planned.motion.nodes)
    middle = motion.nodes[:-1] + 0.5 * lasting
    speed, *forces = (np.abs(rows) for rows in motion.axes_at(middle))
    pace = np.linalg.norm(speed, axis=1)
    starts = np.append(0.0, np.cumsum(np.asarray(motion.path.extent)))
    piece = np.searchsorted(starts, motion.at(middle).arc, side="right") - 1
    piece = np.clip(piece, 0, motion.feed.size - 1)
    load = np.stack(
        [(rows / limit).max(axis=1) for rows, limit in zip(forces, motion.limits[1:], strict=True)]
    )
    acts = 2 + np.argmax(load, axis=0)
    # where the speed is least between two rises; every cell slows down for the nearest such node
    rises, number = (
        np.diff(np.linalg.norm(motion.axes_at(motion.nodes)[0], axis=1)) > 0,
        np.arange(pace.size),
    )
    begun = np.maximum.accumulate(np.where(rises, -1, number))  # last cell that falls
    ends = np.minimum.accumulate(np.where(rises, number, pace.size)[::-1])[::-1]  # next that rises
    least = np.where(rises, begun + 1, ends)
    # nodes beside blends, and stops in corners, which are neither ends nor rests
    blended = np.zeros(pace.size + 1, bool)
    blended[:-1] |= planned.around.blend[piece]
    blended[1:] |= planned.around.blend[piece]
    own = np.concatenate([planned.rests.begin, [0.0, motion.duration]])
    away = np.array([np.abs(own - t).min() for t in motion.stopped])
    blended[np.searchsorted(motion.nodes, motion.stopped)] = away > AT_ONE_TIME * motion.duration
    acts[blended[least]] = LIMITS.index("tolerance")
    acts[(speed > REACHED * motion.limits.speed).any(axis=1)] = LIMITS.index("speed")
    acts[pace > REACHED * motion.feed[piece]] = LIMITS.index("feed")
    times = np.bincount(acts, lasting, len(LIMITS)) / planned.duration
    shares = dict(zip(LIMITS, times.tolist(), strict=True))
    return shares | {"rest": planned.rests.total / planned.duration}
