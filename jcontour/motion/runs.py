"""Runs of short pieces, followed along quintic splines; all runs of a path at once.

The runs lie one behind the other on one parameter, their arc length s. A run is followed along the
spline with the least mean square distance from its pieces. Its knots are halved until

    |r(s) - piece(s)| <= tolerance        for all s.

They are halved further, for half of that distance each time, while a motion at the feed v goes on
at ease: on every axis v^2 r_ss and v^3 r_sss are within `AxisLimits.at_ease`. So a tolerance is not
used where no feed needs it. This ends where knots become many: then they follow the rounding of
coordinates.

The condition bounds the distance of the curve from the pieces and of the pieces from the curve.
Between two points that are h apart the difference of the two is at most h^2 / 8 times its second
derivative farther than at both of them.
"""

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from jcontour.geometry.along_pieces import jet
from jcontour.geometry.coordinates import Numbers
from jcontour.geometry.pieces import Piece
from jcontour.geometry.quintics import Fit, fitted
from jcontour.motion.jerk_limited.limits import Asked
from jcontour.motion.spline_fit import fitted_splines

PARTS = 4  # of a piece between two knots, at whose ends the distance is measured and made small
PER_CELL = 32  # pieces between two knots, at first
ROUNDS = 40  # of halving
CLOSEST = 0.05  # of the tolerance: a curve that is so close is close enough
MANY = 4  # times as many knots as the tolerance takes: more would follow the rounding
AT_ONCE = 8192  # pieces of runs, or those of one longer run
FIT = 1e-3  # of the tolerance: what the pieces in arc length may be off the spline


class Runs(NamedTuple):
    """Pieces that stand for curves, run by run."""

    pieces: Piece  # of all runs, n
    of: Int[np.ndarray, " n"]  # run of every piece, from 0
    # parameter at which the pieces begin, and the end of the last one [m]
    ends: Float[np.ndarray, " ends"]
    # unit vectors in which every run begins and ends; NaN where any will do
    tangents: Float[np.ndarray, "2 R m"]

    @property
    def edges(self) -> Int[np.ndarray, " edges"]:
        """Number of the first piece of every run, and n."""
        return np.searchsorted(self.of, np.arange(self.tangents.shape[1] + 1))

    def piece(self, s: Float[np.ndarray, "..."]) -> Int[np.ndarray, "..."]:
        """Number of the piece at a parameter."""
        return np.searchsorted(self.ends, s, side="right") - 1


class Curves(NamedTuple):
    """Runs as quintic pieces."""

    fit: Fit  # pieces, which begin at parameters of the runs
    run: Int[np.ndarray, " P"]  # of every piece; some runs may have none
    deviation: Float[np.ndarray, " R"]  # bound of the distance of every run from its curve [m]


class _Splines(NamedTuple):
    """Splines of some runs."""

    knots: Float[np.ndarray, " K"]  # of the splines, one behind the other [m]
    run: Int[np.ndarray, " K"]  # of every knot

    def only(self, kept: Bool[np.ndarray, " R"]) -> "_Splines":
        """Those of some of the runs."""
        return _Splines(*(values[kept[self.run]] for values in self))

    def halved(self, cells: Int[np.ndarray, " c"]) -> "_Splines":
        """With one more knot in the middle of some cells."""
        middle = 0.5 * (self.knots[cells] + self.knots[cells + 1])
        return _Splines(
            np.insert(self.knots, cells + 1, middle),
            np.insert(self.run, cells + 1, self.run[cells]),
        )

    @property
    def begins(self) -> Bool[np.ndarray, " K"]:
        """Which knots begin a run."""
        return np.diff(self.run, prepend=-1) > 0

    @property
    def last(self) -> Bool[np.ndarray, " K"]:
        """Which knots end a run."""
        return np.append(self.begins[1:], True)

    def within(self) -> Float[np.ndarray, " K"]:
        """The knots, the ends of runs moved to just before: there the next run may begin."""
        return np.where(self.last, np.nextafter(self.knots, 0.0), self.knots)


class _Sampled(NamedTuple):
    """Points of runs: some of every part of a piece between two knots, both its ends included."""

    cell: Int[np.ndarray, " I"]  # knot before every part
    arc: Float[np.ndarray, "I p"]  # parameter [m], just before the end of a part at its last point
    points: Float[np.ndarray, "I p m"]  # there [m]
    bend: Float[np.ndarray, "I p m"]  # second derivative of the piece [1/m]
    fourth: Float[np.ndarray, " I"]  # bound of its fourth derivative in every part [1/m^3]


def followed(runs: Runs, tolerance: Numbers, asked: Asked | None = None) -> Curves:
    """Runs as curves within a tolerance, which begin and end in the points of their runs.

    A run has no curve where a knot for every piece is not enough.

    Args:
        runs: what is followed.
        tolerance: greatest distance [m], one or one for every run, above 0.
        asked: feed of every piece of the runs, and limits. Curves are about as close as that lets
            them be, as close as the tolerance alone wants them when not given.
    """
    edges = runs.edges
    tolerance = np.broadcast_to(np.asarray(tolerance, float), edges.size - 1)
    # some runs at a time: the arrays of one round then take the place of those of the last
    first = np.flatnonzero(np.diff(edges[:-1] // AT_ONCE, prepend=-1))
    curves = []
    for begin, end in pairwise([*first.tolist(), edges.size - 1]):
        some = slice(edges[begin], edges[end])
        own = Runs(
            runs.pieces.taken(some),
            runs.of[some] - begin,
            runs.ends[edges[begin] : edges[end] + 1],
            runs.tangents[:, begin:end],
        )
        on_own = asked and asked._replace(feed=asked.feed[some])
        part = _followed(own, tolerance[begin:end], on_own, FIT * tolerance.min())
        curves.append(part._replace(run=part.run + begin))
    fits, run, deviation = zip(*curves, strict=True)
    rows = [np.concatenate(row) for row in list(zip(*fits, strict=True))[:-1]]
    fit = Fit(*rows, max(one.error for one in fits))
    return Curves(fit, np.concatenate(run), np.concatenate(deviation))


def _followed(
    runs: Runs, tolerance: Float[np.ndarray, " R"], asked: Asked | None, near_spline: float
) -> Curves:
    """Curves of some runs, whose quintic pieces are so near to the splines [m]."""
    count = np.diff(runs.edges)
    most, wanted = np.full(count.size, np.inf), tolerance
    room = count  # for knots
    size = np.maximum(1, count // PER_CELL) + 1  # knots at first
    run = np.repeat(np.arange(size.size), size)
    number = np.arange(run.size) - (np.cumsum(size) - size)[run]
    splines = _Splines(runs.ends[runs.edges[run] + (number * count[run]) // (size - 1)[run]], run)
    rounds: list[tuple[_Splines, Piece]] = []
    for _ in range(ROUNDS):
        few = np.bincount(splines.run, minlength=count.size) <= room
        splines = splines.only(few)
        if splines.run.size == 0:
            break
        sampled = _sampled(runs, splines)
        of = splines.run[sampled.cell]
        curves, open_ = _fitted(runs, splines, sampled)
        cell = np.broadcast_to(sampled.cell[:, None], sampled.arc.shape)
        along = jet(curves, cell, sampled.arc - splines.knots[cell])
        distance = _distance(curves, along, splines, sampled)
        farthest = np.zeros(count.size)
        np.maximum.at(farthest, of, distance)
        near = open_ & (farthest <= wanted)
        easy = near & _easy(runs, along, sampled, of, near, asked)
        first = near & np.isinf(most)
        knots = np.bincount(splines.run, minlength=count.size)
        room = np.where(first, np.minimum(count, MANY * knots), room)
        most = np.where(first | easy, farthest, most)
        done = first | easy
        rounds.append((splines.only(done), curves.taken(done[splines.run])))
        closer = easy & (farthest > CLOSEST * tolerance)
        wanted = np.where(closer, 0.5 * farthest, wanted)
        far = np.unique(sampled.cell[~(distance <= wanted[of])])
        splines = splines.halved(far).only(closer | (open_ & ~near))
    return _curves(runs, rounds, most, near_spline)


def _easy(
    runs: Runs,
    along: Float[np.ndarray, "4 I p m"],
    sampled: _Sampled,
    of: Int[np.ndarray, " I"],
    near: Bool[np.ndarray, " R"],
    asked: Asked | None,
) -> Bool[np.ndarray, " R"]:
    """Which of the runs that are near go on at their feed at ease; none without a feed."""
    if asked is None:
        return np.zeros(near.size, bool)
    some, ease = near[of], asked.limits.at_ease
    arc, run = sampled.arc[some], of[some]
    first, second, third = np.abs(along[1:, some])
    with np.errstate(divide="ignore"):
        speed = (ease.speed / first).min(axis=2)
    v = np.minimum(asked.feed[runs.piece(arc)], speed)[..., None]
    passed = (second * v**2 <= ease.acceleration) & (third * v**3 <= ease.jerk)
    easy = np.ones(near.size, bool)
    easy[run[~passed.all(axis=(1, 2))]] = False
    return easy


def _sampled(runs: Runs, splines: _Splines) -> _Sampled:
    """Where a piece is longer than a cell, every cell has points: else it would have none."""
    ends = np.union1d(runs.ends[:-1][np.isin(runs.of, splines.run)], splines.knots)
    piece = runs.piece(ends[:-1])
    kept = np.isin(runs.of[piece], splines.run)
    begin, end, piece = ends[:-1][kept], np.nextafter(ends[1:][kept], 0.0), piece[kept]
    arc = begin[:, None] + (end - begin)[:, None] * np.linspace(0.0, 1.0, PARTS + 1)
    arc = np.minimum(arc, end[:, None])
    on = np.broadcast_to(piece[:, None], arc.shape)
    place, _, bend, _ = jet(runs.pieces, on, arc - runs.ends[on])
    quartic, quintic = np.linalg.norm(runs.pieces.polynomial[:, 4:], axis=2).T
    wave = runs.pieces.rate**4 * np.linalg.norm(runs.pieces.cosine, axis=1)
    fourth = wave + 24 * quartic + 120 * quintic * runs.pieces.extent
    cell = np.searchsorted(splines.knots, begin, side="right") - 1
    return _Sampled(cell, arc, place, bend, fourth[piece])


def _fitted(
    runs: Runs, splines: _Splines, sampled: _Sampled
) -> tuple[Piece, Bool[np.ndarray, " R"]]:
    """Splines of all runs that have knots, a polynomial behind every knot; which runs have one.

    The mean square is one over the arc length, by the trapezoidal rule.
    """
    step = np.diff(sampled.arc, axis=1, prepend=sampled.arc[:, :1], append=sampled.arc[:, -1:])
    weight = step[:, 1:] + step[:, :-1]
    numbers = splines.run[splines.begins]
    powers, determined = fitted_splines(
        splines.knots,
        np.bincount(splines.run)[numbers],
        sampled.arc.ravel(),
        sampled.points.reshape(-1, sampled.points.shape[-1]),
        weight.ravel(),
        runs.tangents[:, numbers],
    )
    which = np.zeros(runs.tangents.shape[1], bool)
    which[numbers] = determined
    lengths = np.diff(splines.knots, append=splines.knots[-1:])
    return Piece.polynomials(powers, lengths), which


def _distance(
    curves: Piece, along: Float[np.ndarray, "4 I p m"], splines: _Splines, sampled: _Sampled
) -> Float[np.ndarray, " I"]:
    """Bound of the distance between a spline and a run, for every part [m].

    The second derivative of their difference is bounded by its ends and its own second derivative:
    the fourth one, which for a spline is linear in every cell.
    """
    cell, arc, points, bend, fourth = sampled
    apart = np.linalg.norm(along[0] - points, axis=-1)
    second = np.linalg.norm(along[2] - bend, axis=-1)
    begins, slope = 24 * curves.polynomial[:-1, 4], 120 * curves.polynomial[:-1, 5]
    ends = begins + np.diff(splines.knots)[:, None] * slope
    largest_fourth = np.maximum(*(np.linalg.norm(side, axis=1) for side in (begins, ends)))
    fourth = fourth + largest_fourth[cell]
    between = np.diff(arc, axis=1) ** 2 / 8
    largest, bent = (np.maximum(of[:, 1:], of[:, :-1]) for of in (apart, second))
    return (largest + between * (bent + between * fourth[:, None])).max(axis=1)


def _curves(
    runs: Runs,
    rounds: list[tuple[_Splines, Piece]],
    most: Float[np.ndarray, " R"],
    near: float,
) -> Curves:
    """Quintic pieces near the splines [m] that were found round by round; the last of every run."""
    last = np.full(most.size, -1)
    for number, (one, _) in enumerate(rounds):
        last[one.run] = number
    kept = [last[one.run] == number for number, (one, _) in enumerate(rounds)]
    if not any(some.any() for some in kept):
        none = np.zeros((0, 6, runs.pieces.cosine.shape[-1]))
        return Curves(Fit(none, none[:, 0, 0], none[:, 0, 0], 0.0), np.zeros(0, int), most)
    knots, run, polynomial = (
        np.concatenate([rows[some] for rows, some in zip(column, kept, strict=True)])
        for column in zip(*((*one, curves.polynomial) for one, curves in rounds), strict=True)
    )
    order = np.argsort(run, kind="stable")
    splines = _Splines(knots[order], run[order])
    whole = Piece.polynomials(polynomial[order], np.zeros_like(knots))

    def curve(s):
        cell = np.searchsorted(splines.knots, s, side="right") - 1
        place, first, second, _ = jet(whole, cell, s - splines.knots[cell])
        return place, first, second

    begin, end = splines.knots[~splines.last], splines.within()[~splines.begins]
    fit = fitted("smoothing", curve, _frame(runs, splines), begin, end, near)
    return Curves(fit, runs.of[runs.piece(fit.begin)], most + fit.error)


def _frame(runs: Runs, splines: _Splines):
    """Frames of runs: their own points and directions at both ends, to the last bit."""
    edge = splines.begins | splines.last
    edges, of = splines.within()[edge], splines.run[edge]
    piece = runs.piece(edges)
    side = np.arange(edges.size) % 2
    along = np.where(side > 0, runs.pieces.extent[piece], 0.0)
    points, directions = jet(runs.pieces, piece, along)[0], runs.tangents[side, of]

    def frame(s, inner):
        point, tangent, bend = inner
        k = np.minimum(np.searchsorted(edges, s), edges.size - 1)
        own = (edges[k] == s)[:, None]
        point = np.where(own, points[k], point)
        return point, np.where(own & ~np.isnan(directions[k]), directions[k], tangent), bend

    return frame
