"""Smoothing: runs of short lines or arcs, as CAM systems write curves, become curves.

Two pieces of length l that meet at an angle a, with a jump c of the curvature, stand for a curve
that is about l a / 8 + l^2 c / 16 away from them; one through their middle is half as far. Where
that is within the tolerance, they belong to one run. A run is followed along a quintic spline over
its own arc length s, with the least mean square distance from the pieces. Its knots are halved
until

    |r(s) - piece(s)| <= tolerance        for all s,

which bounds the distance of the curve from the pieces and of the pieces from the curve. Between two
points that are h apart the difference of the two is at most h^2 / 8 times its second derivative
farther than at both of them. So rounding of the coordinates is smoothed away as far as the
tolerance allows, and the curvature is that of the curve. A run begins and ends in its own points,
and tangent to a longer piece beside it that it hardly turns into.
"""

from dataclasses import dataclass
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Bool, Float

from jcontour.geometry.along_pieces import jet
from jcontour.geometry.contour import Contour
from jcontour.geometry.contours import NEWTON_STEPS, from_pieces
from jcontour.geometry.pieces import Piece
from jcontour.geometry.quintics import Fit, fitted
from jcontour.motion.blending import BlendedPath, blended
from jcontour.motion.jerk_limited.joints import joints, unpadded
from jcontour.motion.spline_fit import Tangents, fitted_spline

SHARE = 0.7  # of the tolerance, for the smoothing; what it leaves is for the blends
SHARPEST = np.radians(30.0)  # turn up to which pieces stand for one curve
TANGENT = np.radians(10.0)  # turn up to which a run leaves its neighbour tangentially
FEWEST = 4  # pieces of a run
LONGEST = 1000.0  # piece of a run, in tolerances: a longer one stands for itself
POINTS = 4  # of a piece between two knots at which the distance is measured and made small
PER_CELL = 32  # pieces between two knots, at first
ROUNDS = 40  # of halving
FIT = 1e-3  # of the tolerance: what the pieces in arc length may be off the spline


class Run(NamedTuple):
    """Pieces from `first` to `last`, with the directions in which they begin and end.

    Attributes:
        pieces: of the run.
        ends: (n,) arc lengths from its begin at which they begin, and its own [m].
        tangents: unit vector at the begin and at the end; None where any will do.
    """

    first: int
    last: int
    pieces: Piece
    ends: Float[np.ndarray, " n"]
    tangents: Tangents


@dataclass(frozen=True)
class Smoothed:
    """A run as quintic pieces.

    Attributes:
        fit: pieces, which begin at arc lengths of the run.
        deviation: bound of the distance from the run [m].
    """

    fit: Fit
    deviation: float


def smooth_path(
    contour: Contour,
    tolerance: float,
    allowed: Bool[np.ndarray, " joints"] | None = None,
    alike: Bool[np.ndarray, " joints"] | None = None,
) -> BlendedPath:
    """Path with a continuous curvature within a tolerance: runs smoothed, other joints blended.

    Args:
        contour: one contour, not a stack.
        tolerance: greatest distance [m]; 0 leaves the contour as it is.
        allowed: which of the joints between pieces may be smoothed or blended; all when not given.
        alike: at which of them the feed stays the same; others are blended only.

    Raises:
        ValueError: as `blended`, or a wrong shape.
    """
    every = np.ones(np.asarray(contour.mask).sum() - 1, bool)
    allowed = every if allowed is None else np.asarray(allowed, bool)
    alike = every if alike is None else np.asarray(alike, bool)
    if alike.shape != every.shape:
        raise ValueError(f"alike: needs shape {every.shape}, received {alike.shape}")
    if not tolerance > 0 or allowed.shape != every.shape:
        return blended(contour, tolerance, allowed)
    found, within, apart = smoothed(contour, SHARE * tolerance, allowed & alike)
    joint = np.minimum(found.piece[:-1], allowed.size - 1)  # at the end of each piece
    used = np.maximum(apart[:-1], apart[1:])
    around = blended(found.path, tolerance, within | allowed[joint], used)
    return BlendedPath(
        path=around.path,
        contour=contour,
        piece=found.piece[around.piece],
        blend=around.blend,
        place=found.true_arc(around.place),
        deviation=max(around.deviation, found.deviation),
    )


def smoothed(
    contour: Contour, tolerance: float, alike: Bool[np.ndarray, " joints"]
) -> tuple[BlendedPath, Bool[np.ndarray, " inner"], Float[np.ndarray, " P"]]:
    """Path with its runs smoothed, which of its joints lie within a run, deviations of its pieces.

    It is the contour itself where there are no runs. No piece of it counts as a blend.

    Args:
        contour: one contour, not a stack.
        tolerance: greatest distance [m], above 0.
        alike: joints at which pieces may belong to one run.
    """
    pieces = unpadded(contour)
    runs = _runs(pieces, tolerance, alike)
    starts = np.append(0.0, np.cumsum(pieces.extent))
    kept, places, numbers, goes_on, apart = [], [], [], [], []
    at = 0
    for run in runs:
        curve = _smooth_run(run, tolerance)
        if curve is None:
            continue
        before = np.arange(at, run.first)
        kept += [pieces.taken(before), curve.fit.pieces()]
        places += [starts[before], starts[run.first] + curve.fit.begin]
        inner = np.searchsorted(run.ends, curve.fit.begin, side="right") - 1 + run.first
        inner[-1] = run.last  # what comes after the run comes after its last piece
        numbers += [before, inner]
        goes_on += [np.zeros(before.size, bool), np.arange(inner.size) < inner.size - 1]
        apart += [np.zeros(before.size), np.full(inner.size, curve.deviation)]
        at = run.last + 1
    if at == 0:
        every = np.arange(pieces.extent.size)
        none = np.zeros(every.size, bool)
        return BlendedPath(contour, contour, every, none, starts, 0.0), none[:-1], 0.0 * every
    rest = np.arange(at, pieces.extent.size)
    kept.append(pieces.taken(rest))
    whole = jax.tree.map(lambda *rows: np.concatenate(rows), *kept)
    within = np.concatenate([*goes_on, np.zeros(rest.size, bool)])
    apart = np.concatenate([*apart, np.zeros(rest.size)])
    path = BlendedPath(
        path=from_pieces(whole, fit_error=FIT * tolerance, newton_steps=NEWTON_STEPS),
        contour=contour,
        piece=np.concatenate([*numbers, rest]),
        blend=np.zeros(within.size, bool),
        place=np.concatenate([*places, starts[rest], starts[-1:]]),
        deviation=float(apart.max()),
    )
    return path, within[:-1], apart


def _runs(pieces: Piece, tolerance: float, alike: np.ndarray) -> list[Run]:
    """Pieces that stand for curves, from the first to the last."""
    jump, bend = joints(pieces)
    turn = 2 * np.arcsin(np.clip(jump / 2, 0.0, 1.0))
    longer = np.maximum(pieces.extent[:-1], pieces.extent[1:])
    apart = longer * turn / 8 + longer**2 * bend / 16
    short = longer <= LONGEST * tolerance
    together = alike & short & (apart <= tolerance) & (turn <= SHARPEST)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], together, [False]]).astype(int)))
    return [
        _run(pieces, int(first), int(last), turn)
        for first, last in edges.reshape(-1, 2)
        if last - first + 1 >= FEWEST and apart[first:last].any()
    ]


def _run(pieces: Piece, first: int, last: int, turn: np.ndarray) -> Run:
    before = after = None
    if first > 0 and turn[first - 1] <= TANGENT:
        neighbour = pieces.taken(first - 1)
        before = _direction(neighbour, neighbour.extent)
    if last < turn.size and turn[last] <= TANGENT:
        after = _direction(pieces.taken(last + 1), np.zeros(()))
    of_run = pieces.taken(slice(first, last + 1))
    return Run(first, last, of_run, np.append(0.0, np.cumsum(of_run.extent)), (before, after))


def _direction(piece: Piece, at) -> np.ndarray:
    velocity = piece.jet(at)[1]
    return velocity / np.linalg.norm(velocity)


def _smooth_run(run: Run, tolerance: float) -> Smoothed | None:
    """A run as a spline within the tolerance; None where a knot for every piece is not enough."""
    count = run.ends.size - 1
    cells = max(1, count // PER_CELL)
    knots = run.ends[np.linspace(0, count, cells + 1).astype(int)]
    for _ in range(ROUNDS):
        if knots.size > count:
            return None
        sampled = _sampled(run, knots)
        try:
            spline = fitted_spline(knots, sampled.arc, sampled.points, run.tangents)
        except np.linalg.LinAlgError:  # pieces far too unlike in length
            return None
        distance = _distance(spline, knots, sampled)
        far = np.searchsorted(knots, sampled.arc[:-1][~(distance <= tolerance)], side="right") - 1
        if far.size == 0:
            cells, frame = (knots[:-1], knots[1:]), _frame(run, sampled.points)
            fit = fitted("smoothing", _curve(spline), frame, *cells, FIT * tolerance)
            return Smoothed(fit, float(distance.max()) + fit.error)
        far = np.unique(far)
        knots = np.insert(knots, far + 1, 0.5 * (knots[far] + knots[far + 1]))
    return None


class _Sampled(NamedTuple):
    """Points of a run: some of every part of a piece between two knots, and its end.

    Attributes:
        arc: arc lengths [m], increasing.
        points: there [m].
        bend: second derivative of the piece at both ends of every interval between them [1/m].
        fourth: bound of its fourth derivative in every interval [1/m^3].
    """

    arc: Float[np.ndarray, " S"]
    points: Float[np.ndarray, "S m"]
    bend: Float[np.ndarray, "2 I m"]
    fourth: Float[np.ndarray, " I"]


def _sampled(run: Run, knots: Float[np.ndarray, " K"]) -> _Sampled:
    """Where a piece is longer than a cell, every cell has points: else it would have none."""
    ends, pieces = np.union1d(run.ends, knots), run.pieces
    arc = ends[:-1, None] + np.diff(ends)[:, None] * np.arange(POINTS) / POINTS
    arc = np.append(arc, ends[-1])
    piece = np.repeat(np.searchsorted(run.ends, ends[:-1], side="right") - 1, POINTS)
    both = np.stack([arc[:-1], arc[1:]]) - run.ends[piece]
    place, _, bend, _ = jet(pieces, np.stack([piece, piece]), both)
    *_, quartic, quintic = np.linalg.norm(pieces.polynomial, axis=2).T
    wave = pieces.rate**4 * np.linalg.norm(pieces.cosine, axis=1)
    fourth = wave + 24 * quartic + 120 * quintic * pieces.extent
    return _Sampled(arc, np.vstack([place[0], place[1, -1:]]), bend, fourth[piece])


def _distance(spline, knots: Float[np.ndarray, " K"], sampled: _Sampled) -> Float[np.ndarray, " I"]:
    """Bound of the distance between a spline and a run, for every interval between two points [m].

    The second derivative of their difference is bounded by its ends and its own second derivative:
    the fourth one, which for a spline is linear in every cell.
    """
    arc, points, bend, fourth = sampled
    apart, bent = np.linalg.norm(spline(arc) - points, axis=1), spline(arc, 2)
    ends = np.linalg.norm(spline(knots, 4), axis=1)
    cell = np.searchsorted(knots, arc[:-1], side="right") - 1
    fourth = fourth + np.maximum(ends[:-1], ends[1:])[cell]
    between = np.diff(arc) ** 2 / 8
    second = np.linalg.norm(np.stack([bent[:-1], bent[1:]]) - bend, axis=2).max(axis=0)
    return np.maximum(apart[:-1], apart[1:]) + between * (second + between * fourth)


def _curve(spline):
    return lambda s: (spline(s), spline(s, 1), spline(s, 2))


def _frame(run: Run, points: Float[np.ndarray, "S m"]):
    """Frames of a run: its own points and directions at both ends, to the last bit."""

    def frame(s, inner):
        point, tangent, bend = inner
        for at, where, direction in zip((0, -1), run.ends[[0, -1]], run.tangents, strict=True):
            end = (s == where)[:, None]
            point = np.where(end, points[at], point)
            if direction is not None:
                tangent = np.where(end, direction, tangent)
        return point, tangent, bend

    return frame
