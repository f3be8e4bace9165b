"""Smoothing: runs of short lines or arcs, as CAM systems write curves, become curves.

Two pieces of length l that meet at an angle a, with a jump c of the curvature, stand for a curve
that is about l a / 8 + l^2 c / 16 away from them; one through their middle is half as far. Where
that is within the tolerance, they belong to one run, which is followed along a spline within the
tolerance (see `runs`). So rounding of the coordinates is smoothed away as far as the tolerance
allows and the feed needs, and the curvature is that of the curve. A run begins and ends in its own
points, and tangent to a longer piece beside it that it hardly turns into.
"""

import jax
import numpy as np
from jaxtyping import Bool, Float, Int

from jcontour.geometry.along_pieces import jet
from jcontour.geometry.contour import Contour, unpadded
from jcontour.geometry.contours import NEWTON_STEPS, from_pieces
from jcontour.geometry.coordinates import Numbers, per_piece
from jcontour.geometry.pieces import Piece
from jcontour.motion.blending import BlendedPath, blended
from jcontour.motion.jerk_limited.limits import Asked, joints
from jcontour.motion.runs import FIT, Runs, followed

SHARE = 0.7  # of the tolerance, for the smoothing; what it leaves is for the blends
SHARPEST = np.radians(30.0)  # turn up to which pieces stand for one curve
TANGENT = np.radians(10.0)  # turn up to which a run leaves its neighbour tangentially
FEWEST = 4  # pieces of a run
LONGEST = 1000.0  # piece of a run, in tolerances: a longer one stands for itself


def smooth_path(
    contour: Contour,
    tolerance: Numbers,
    allowed: Bool[np.ndarray, " joints"] | None = None,
    alike: Bool[np.ndarray, " joints"] | None = None,
    asked: Asked | None = None,
) -> BlendedPath:
    """Path with a continuous curvature within a tolerance: runs smoothed, other joints blended.

    Args:
        contour: one contour, not a stack.
        tolerance: greatest distance [m], one or one for every joint: a run has the largest of its
            joints; 0 leaves the contour as it is.
        allowed: which of the joints between pieces may be smoothed or blended; all when not given.
        alike: at which of them the feed stays the same; others are blended only.
        asked: what the path is to be passed at. No more of the tolerance is used than that needs,
            as `blended` and `followed` say; all of it when not given.

    Raises:
        ValueError: as `blended`, or a wrong shape.
    """
    every = np.ones(np.asarray(contour.mask).sum() - 1, bool)
    allowed = every if allowed is None else np.asarray(allowed, bool)
    alike = every if alike is None else np.asarray(alike, bool)
    if alike.shape != every.shape:
        raise ValueError(f"alike: needs shape {every.shape}, received {alike.shape}")
    if asked is not None:
        asked = asked._replace(feed=per_piece("feed", asked.feed, every.size + 1))
    tolerance = np.asarray(tolerance, float)
    if not (tolerance > 0).all() or allowed.shape != every.shape:
        return blended(contour, tolerance, allowed, asked=asked)
    tolerance = np.broadcast_to(tolerance, every.shape)
    smooth, within = smoothed(contour, SHARE * tolerance, allowed & alike, asked)
    joint = np.minimum(smooth.piece[:-1], allowed.size - 1)  # at the end of each piece
    used = np.maximum(smooth.apart[:-1], smooth.apart[1:])
    if asked is not None:
        asked = asked._replace(feed=smooth.feed(asked.feed))
    # beside a run that uses more than its joint may, the joint has as much
    left = np.maximum(tolerance[joint], used / SHARE)
    around = blended(smooth.path, left, within | allowed[joint], used, asked)
    return BlendedPath(
        path=around.path,
        contour=contour,
        piece=smooth.piece[around.piece],
        blend=around.blend,
        place=smooth.true_arc(around.place),
        apart=np.maximum(around.apart, smooth.apart[around.piece]),
    )


def smoothed(
    contour: Contour,
    tolerance: Float[np.ndarray, " joints"],
    alike: Bool[np.ndarray, " joints"],
    asked: Asked | None = None,
) -> tuple[BlendedPath, Bool[np.ndarray, " inner"]]:
    """Path with its runs smoothed, and which of its joints lie within a run.

    It is the contour itself where there are no runs. No piece of it counts as a blend.

    Args:
        contour: one contour, not a stack.
        tolerance: greatest distance at every joint [m], above 0.
        alike: joints at which pieces may belong to one run.
        asked: what the path is to be passed at; see `followed`.
    """
    pieces = unpadded(contour)
    every = np.arange(pieces.extent.size)
    none = np.zeros(every.size, bool)
    starts = np.append(0.0, np.cumsum(pieces.extent))
    first, last, runs = _runs(pieces, tolerance, alike)
    if asked is not None:
        asked = asked._replace(feed=asked.feed[_covered(first, last, every.size)])
    curves = None
    if first.size:  # a run is from its first joint up to the one before its last piece
        edges = np.stack([first, last], axis=1).ravel()
        own = np.maximum.reduceat(np.append(tolerance, 0.0), edges)[::2]
        curves = followed(runs, own, asked)
    if curves is None or curves.run.size == 0:
        return BlendedPath(contour, contour, every, none, starts, 0.0 * every), none[:-1]
    smooth = np.unique(curves.run)
    rest = every[~_covered(first[smooth], last[smooth], every.size)]
    fit, run = curves.fit, curves.run
    ends = np.append(run[1:] > run[:-1], True)  # which of the curves' pieces end a run
    within = runs.piece(fit.begin) - runs.edges[run]
    # what comes after a run comes after its last piece
    piece = np.where(ends, last[run], first[run] + within)
    place = starts[first[run]] + (fit.begin - runs.ends[runs.edges[run]])
    order = np.argsort(np.concatenate([rest, piece]), kind="stable")

    def joined(of_rest, of_curves):
        return np.concatenate([of_rest, of_curves])[order]

    goes_on = joined(np.zeros(rest.size, bool), ~ends)
    apart = joined(np.zeros(rest.size), curves.deviation[run])
    whole = jax.tree.map(joined, pieces.taken(rest), fit.pieces())
    path = BlendedPath(
        path=from_pieces(whole, fit_error=FIT * tolerance.min(), newton_steps=NEWTON_STEPS),
        contour=contour,
        piece=joined(rest, piece),
        blend=np.zeros(order.size, bool),
        place=np.append(joined(starts[rest], place), starts[-1]),
        apart=apart,
    )
    return path, goes_on[:-1]


def _covered(first: np.ndarray, last: np.ndarray, count: int) -> Bool[np.ndarray, " count"]:
    """Which of so many numbers lie in one of the ranges."""
    change = np.zeros(count + 1, int)
    change[first] += 1
    change[last + 1] -= 1
    return np.cumsum(change[:-1]) > 0


def _runs(
    pieces: Piece, tolerance: Float[np.ndarray, " joints"], alike: np.ndarray
) -> tuple[Int[np.ndarray, " R"], Int[np.ndarray, " R"], Runs]:
    """First and last piece of every run of pieces that stand for a curve, and the runs."""
    jump, bend = joints(pieces)
    turn = 2 * np.arcsin(np.clip(jump / 2, 0.0, 1.0))
    longer = np.maximum(pieces.extent[:-1], pieces.extent[1:])
    apart = longer * turn / 8 + longer**2 * bend / 16
    short = longer <= LONGEST * tolerance
    together = alike & short & (apart <= tolerance) & (turn <= SHARPEST)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], together, [False]]).astype(int)))
    first, last = edges.reshape(-1, 2).T
    bent = np.append(0, np.cumsum(apart > 0))
    kept = (last - first + 1 >= FEWEST) & (bent[last] > bent[first])
    first, last = first[kept], last[kept]
    inside = np.flatnonzero(_covered(first, last, pieces.extent.size))
    of = np.repeat(np.arange(first.size), last - first + 1)
    ends = np.append(0.0, np.cumsum(pieces.extent[inside]))
    turns = np.concatenate([[np.inf], turn, [np.inf]])  # before every piece, and after the last
    tangents = np.stack(
        [
            _directions(pieces, first - 1, 1.0, turns[first]),
            _directions(pieces, last + 1, 0.0, turns[last + 1]),
        ]
    )
    return first, last, Runs(pieces.taken(inside), of, ends, tangents)


def _directions(
    pieces: Piece, number: Int[np.ndarray, " R"], end: float, turn: Float[np.ndarray, " R"]
) -> Float[np.ndarray, "R m"]:
    """Unit tangents at an end (0 or 1) of the neighbours of runs; NaN where they turn too far."""
    on = np.clip(number, 0, pieces.extent.size - 1)
    velocity = jet(pieces, on, end * pieces.extent[on])[1]
    unit = velocity / np.linalg.norm(velocity, axis=-1, keepdims=True)
    return np.where((turn <= TANGENT)[:, None], unit, np.nan)
