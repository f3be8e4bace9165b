"""Blends: corners of a path, and jumps of its curvature, replaced by curves within a tolerance.

A blend leaves the piece before a joint at a distance d and meets the piece after it at the same
distance. Between two lines it is the cubic

    r(u) = corner - d (1 - u)^3 t_0 + d u^3 t_1,        u from 0 to 1,

with t_0 and t_1 the directions of the lines: one axis comes to rest at constant jerk while the
other one leaves it, which is the quickest way around a slow corner. Between curves it is the
quintic with the same derivatives at both ends, the curvature of the path added. Point u belongs to
the point of the path at d (u^3 - (1 - u)^3) from the joint. Where the curvature jumps and the
direction does not, the quintic has no second derivative along the path at its ends, and u belongs
to d (2 u - 1). The greatest distance of two such points bounds the distance of the blend from the
path and of the path from the blend: d |t_1 - t_0| / 8 between lines. A blend reaches as far as its
tolerance allows, but no farther than a feed needs. Blends are written as quintics in their own arc
length, so that the blended path is a contour.
"""

from dataclasses import dataclass
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Bool, Float, Int

from jcontour.geometry.along_pieces import jet
from jcontour.geometry.contour import Contour, unpadded
from jcontour.geometry.contours import NEWTON_STEPS, from_pieces
from jcontour.geometry.coordinates import Numbers, per_piece
from jcontour.geometry.pieces import Piece
from jcontour.geometry.quintics import fitted
from jcontour.motion.jerk_limited.limits import Asked, AxisLimits, joints

SHARE = 0.5  # of a piece, at most, that a blend takes at each of its ends
SAFETY = 0.99  # of the tolerance: the deviation may peak between the places where it is measured
FIT = 1e-3  # of its deviation: what the quintics may be off a blend
FINEST = 1e-12  # [m] of that
SHARPEST = 2 * np.sin(np.radians(120.0) / 2)  # jump of the tangent: beyond it a stop is quicker
ROUNDING = 1e-9  # jump of the tangent that is none
CORNER = 1e-3  # jump of the tangent: a smaller one is rather a jump of the curvature
STEPS = 32  # of a blend, at which it is looked at
SEARCHES = 60  # halvings and secants for the length of a blend
LEAST = 0.01  # of the reach that the tolerance allows
APPROACHES = 7  # halvings of what is not known of the reach, which is then known to 4 %
SWING = 1.1  # of the curvature that a blend meets: it goes 8 % beyond, however long it is
SHORTEST = 1e-9  # [m] of what is left of a piece between two blends
MEETING = 1e-13  # [m] what is left where two blends meet
SHORTER = 0.99  # of a blend, where less than the shortest would be left: a gap, which turns


class Blends(NamedTuple):
    """Blends at joints `at` of pieces, each of a reach d [m] to both sides.

    At a `corner` the direction jumps; elsewhere the curvature alone does.
    """

    pieces: Piece
    at: Int[np.ndarray, " B"]
    corner: Bool[np.ndarray, " B"]
    reach: Float[np.ndarray, " B"]

    def left(self) -> Float[np.ndarray, " P"]:
        """What is left of every piece [m]."""
        left = self.pieces.extent.copy()
        left[self.at] -= self.reach
        left[self.at + 1] -= self.reach
        return left

    def some(self, which: np.ndarray) -> "Blends":
        """Some of the blends."""
        return self._replace(at=self.at[which], corner=self.corner[which], reach=self.reach[which])

    def ends(self) -> Float[np.ndarray, "2 3 B m"]:
        """Point, tangent and curvature vector where the blends begin and end."""
        piece = np.stack([self.at, self.at + 1])
        place = np.stack([self.pieces.extent[self.at] - self.reach, self.reach])
        return np.swapaxes(jet(self.pieces, piece, place)[:3], 0, 1)

    def path(self, u: Float[np.ndarray, " n"]) -> Float[np.ndarray, "B n m"]:
        """Points of the path beside the blends."""
        beyond = self.reach[:, None] * self.beyond(u, self.corner[:, None])
        piece = self.at[:, None] + (u >= 0.5)
        place = beyond + np.where(u < 0.5, self.pieces.extent[piece], 0.0)
        return jet(self.pieces, piece, place)[0]

    def quintics(self) -> Piece:
        """The blends as polynomials in u."""
        (p, v, c), (p1, v1, c1) = self.ends()
        scale = (np.where(self.corner, 3.0, 2.0) * self.reach)[:, None]  # |dr/du| at both ends
        slowing = np.where(self.corner, 2.0, 0.0)[:, None]
        v, v1 = v * scale, v1 * scale
        c, c1 = c * scale**2 - slowing * v, c1 * scale**2 + slowing * v1
        gap, turn, bend = p1 - p - v - c / 2, v1 - v - c, c1 - c
        cubic, quartic = 10 * gap - 4 * turn + bend / 2, -15 * gap + 7 * turn - bend
        quintic = 6 * gap - 3 * turn + bend / 2
        polynomial = np.stack([p, v, c / 2, cubic, quartic, quintic], axis=1)
        return Piece.polynomials(polynomial, np.ones(self.reach.size))

    @staticmethod
    def beyond(u: np.ndarray, corner: np.ndarray) -> np.ndarray:
        """Place on the path beside a point of a blend: from -1, where it begins, to 1."""
        return np.where(corner, u**3 - (1 - u) ** 3, 2 * u - 1)

    def deviation(self) -> Float[np.ndarray, " B"]:
        """Greatest distance of a blend from its path [m]."""
        u = np.arange(1, STEPS) / STEPS
        return np.linalg.norm(self._at(u)[0] - self.path(u), axis=-1).max(axis=1)

    def along(self) -> Float[np.ndarray, "3 B n m"]:
        """First, second and third derivative with respect to the arc length [1, 1/m, 1/m^2]."""
        _, first, second, third = self._at(np.arange(STEPS + 1) / STEPS)
        pace = np.linalg.norm(first, axis=-1, keepdims=True)  # ds/du
        tangent = first / pace
        hurry = np.sum(tangent * second, axis=-1, keepdims=True)
        bend = (second - hurry * tangent) / pace**2
        across = np.sum(second**2 + first * third, axis=-1, keepdims=True)
        twist = third - 3 * pace * hurry * bend - (across - hurry**2) / pace * tangent
        return np.stack([tangent, bend, twist / pace**3])

    def _at(self, u: Float[np.ndarray, " n"]) -> Float[np.ndarray, "4 B n m"]:
        """Points of the blends and their derivatives in u."""
        every = np.broadcast_to(np.arange(self.at.size)[:, None], (self.at.size, u.size))
        return jet(self.quintics(), every, np.broadcast_to(u, every.shape))


def within(blends: Blends, tolerance: Float[np.ndarray, " B"]) -> Blends:
    """The blends shortened until each is within its tolerance [m].

    Near its end the search takes the deviation to grow with the reach at a corner, and with its
    square where the curvature jumps.
    """
    for _ in range(SEARCHES):
        deviation = blends.deviation()
        over = np.flatnonzero(deviation > tolerance)
        if over.size == 0:
            break
        fewer = blends.some(over)
        nearby = fewer._replace(reach=0.9 * fewer.reach).deviation()
        with np.errstate(divide="ignore", invalid="ignore"):
            power = np.log(deviation[over] / nearby) / np.log(1 / 0.9)
        steep = np.clip(np.nan_to_num(power, nan=1.0), 0.5, 4.0)
        factor = (0.999 * tolerance[over] / deviation[over]) ** (1 / steep)
        reach = blends.reach.copy()
        reach[over] *= np.clip(factor, 1e-3, 0.999)
        blends = blends._replace(reach=reach)
    return blends


def as_needed(
    blends: Blends,
    tolerance: Float[np.ndarray, " B"],
    feed: Float[np.ndarray, " B"],
    limits: AxisLimits,
) -> Blends:
    """The blends shortened to what their feed needs: longer ones would be passed no faster.

    At a speed v along a blend every axis has the acceleration v^2 r_ss and the jerk v^3 r_sss,
    larger ones where it is shorter. They may be as large as `AxisLimits.at_ease`, the acceleration
    also about as large as beside the blend. A blend that is not passed so stays as it is, and one
    that would deviate more where it is shorter, as may be between curves.

    Args:
        blends: as long as the tolerance allows.
        tolerance: of each [m].
        feed: that is asked for in each [m/s]. Where the speed limit of an axis, or the curvature
            and the acceleration limit, allow less beside the blend, v is that.
        limits: of the axes.
    """
    _, tangent, bend = np.swapaxes(blends.ends(), 0, 1)
    with np.errstate(divide="ignore"):
        speed = (limits.speed / np.abs(tangent)).min(axis=(0, 2))
        turning = np.sqrt((limits.acceleration / np.abs(bend)).min(axis=(0, 2)))
    v = np.minimum(np.minimum(feed, speed), turning)[:, None]
    beside = np.abs(bend).max(axis=0) * v**2
    acceleration = np.maximum(limits.at_ease.acceleration, SWING * beside)
    jerk = limits.at_ease.jerk
    enough, short = np.ones(feed.size), np.full(feed.size, LEAST)
    for _ in range(APPROACHES):
        between = np.sqrt(enough * short)
        with np.errstate(divide="ignore", invalid="ignore"):  # a blend that has no reach at all
            along = blends._replace(reach=between * blends.reach).along()
        _, second, third = np.abs(along).max(axis=2)
        easy = (second * v**2 <= acceleration) & (third * v**3 <= jerk)
        passed = easy.all(axis=1)
        enough, short = np.where(passed, between, enough), np.where(passed, short, between)
    shorter = blends._replace(reach=enough * blends.reach)
    near = shorter.deviation() <= tolerance
    return shorter._replace(reach=np.where(near, shorter.reach, blends.reach))


def without_gaps(blends: Blends) -> Blends:
    """The blends, those a little shortened between which too little of a piece is left.

    A blend that still leaves too little is none: its piece would be lost, and the path have a gap.
    """
    left = blends.left()[blends.at]
    narrow = (left > MEETING) & (left <= SHORTEST)
    blends = blends._replace(reach=np.where(narrow, SHORTER, 1.0) * blends.reach)
    left = blends.left()
    lost = (left > MEETING) & (left <= SHORTEST)
    return blends.some(~(lost[blends.at] | lost[blends.at + 1]))


@dataclass(frozen=True)
class BlendedPath:
    """A path with blends, and where it lies on the true contour."""

    path: Contour  # contour that is followed
    contour: Contour  # the true one
    # (P',) number of the true piece that a piece is part of; of a blend, the one before
    piece: Int[np.ndarray, " P"]
    blend: Bool[np.ndarray, " P"]  # (P',) which pieces belong to blends
    # (P'+1,) arc length on the true contour where each begins, and the end [m]
    place: Float[np.ndarray, " ends"]
    apart: Float[np.ndarray, " P"]  # (P',) bound of the distance between each and the contour [m]

    @property
    def deviation(self) -> float:
        """Bound of the distance between both [m]."""
        return float(self.apart.max())

    def feed(self, feed: Float[np.ndarray, " P"]) -> Float[np.ndarray, " Q"]:
        """Feed [m/s] of the pieces of the path; of a blend, the lower one of both sides."""
        after = np.minimum(self.piece + 1, feed.size - 1)
        lower = np.minimum(feed[self.piece], feed[after])
        return np.where(self.blend, lower, feed[self.piece])

    def joint(self, number: Int[np.ndarray, " k"]) -> Int[np.ndarray, " k"]:
        """Joints of the path at joints of the contour that no blend replaces, by number."""
        return np.searchsorted(self.piece, number, side="right") - 1

    def true_arc(self, arc: Float[np.ndarray, " T"]) -> Float[np.ndarray, " T"]:
        """Arc length on the true contour [m] that belongs to one on the path."""
        mask = np.asarray(self.path.mask)
        starts = np.append(0.0, np.cumsum(np.asarray(self.path.extent)[mask]))
        return np.interp(arc, starts, self.place)

    def path_arc(self, place: Float[np.ndarray, " T"]) -> Float[np.ndarray, " T"]:
        """Arc length on the path [m] that belongs to one on the true contour."""
        mask = np.asarray(self.path.mask)
        starts = np.append(0.0, np.cumsum(np.asarray(self.path.extent)[mask]))
        return np.interp(place, self.place, starts)


def blended(
    contour: Contour,
    tolerance: Numbers,
    allowed: Bool[np.ndarray, " joints"] | None = None,
    used: Float[np.ndarray, " joints"] | None = None,
    asked: Asked | None = None,
) -> BlendedPath:
    """Path with a continuous curvature that stays within a tolerance of a contour.

    Turns by more than 120 degrees stay, as do those that are not allowed: a motion stops there.

    >>> from jcontour import contours
    >>> square = contours.polygon([(0, 0), (20e-3, 0), (20e-3, 20e-3), (0, 20e-3)])
    >>> around = blended(square, 10e-6)
    >>> bool(around.deviation < 10e-6), int(around.blend.sum() > 0)
    (True, 1)

    Args:
        contour: one contour, not a stack.
        tolerance: greatest distance [m], one or one for every joint; 0 leaves the contour as it is.
        allowed: which of the joints between pieces may be blended; all when not given.
        used: of the tolerance beside every joint [m], by a contour that stands for another one;
            nothing when not given. The deviation counts it.
        asked: what the path is to be passed at. Blends are no longer than that needs, and at least
            a hundredth of what the tolerance allows; all of that when not given.

    Raises:
        ValueError: a tolerance below zero or not finite, a feed that is not finite and above zero,
            or a wrong shape.
    """
    tolerance = np.asarray(tolerance, float)
    if not (np.isfinite(tolerance) & (tolerance >= 0)).all():
        raise ValueError(f"tolerance: needs to be finite and not negative, received {tolerance}")
    pieces = unpadded(contour)
    count = pieces.extent.size
    tolerance = np.broadcast_to(tolerance, count - 1)
    allowed = np.ones(count - 1, bool) if allowed is None else np.asarray(allowed, bool)
    if allowed.shape != (count - 1,):
        raise ValueError(f"allowed: needs shape ({count - 1},), received {allowed.shape}")
    used = np.zeros(count - 1) if used is None else used
    if asked is not None:
        asked = asked._replace(feed=per_piece("feed", asked.feed, count))
    corners = joints(pieces)
    rough = (corners.turn > ROUNDING) | (corners.bend > 0)
    at = np.flatnonzero(allowed & rough & (corners.turn < SHARPEST))
    at = at[tolerance[at] > 0]
    if at.size > 0:
        most = SHARE * np.minimum(pieces.extent[at], pieces.extent[at + 1])
        blends = Blends(pieces, at, corners.turn[at] > CORNER, most)
        left = SAFETY * (tolerance[at] - used[at])
        blends = within(blends, left)
        if asked is not None:
            feed = np.minimum(asked.feed[at], asked.feed[at + 1])
            blends = as_needed(blends, left, feed, asked.limits)
        blends = without_gaps(blends)
        if blends.at.size > 0:
            return _assembled(contour, blends, used[blends.at])
    starts, every = np.append(0.0, np.cumsum(pieces.extent)), np.arange(count)
    return BlendedPath(contour, contour, every, np.zeros(count, bool), starts, 0.0 * every)


def _assembled(contour: Contour, blends: Blends, used: Float[np.ndarray, " B"]) -> BlendedPath:
    """The pieces between blends, cut, and the blends in arc length, in order."""
    pieces = blends.pieces
    count = pieces.extent.size
    cut_before, left = np.zeros(count), blends.left()
    cut_before[blends.at + 1] = blends.reach
    kept = np.flatnonzero((left > SHORTEST) | (left == pieces.extent))
    cut = _cut(pieces.taken(kept), cut_before[kept], left[kept])
    deviation = blends.deviation()
    fit = fitted("blend", *_curves(blends), np.maximum(FIT * deviation, FINEST))
    number = (0.5 * fit.begin).astype(int)
    joint = blends.at[number]
    curves = fit.pieces()
    order = np.lexsort(
        (
            np.concatenate([np.zeros(kept.size), fit.begin]),
            np.concatenate([np.zeros(kept.size), np.ones(joint.size)]),
            np.concatenate([kept, joint]),
        )
    )
    whole = jax.tree.map(lambda a, b: np.concatenate([a, b])[order], cut, curves)
    starts = np.append(0.0, np.cumsum(pieces.extent))
    into = fit.begin - 2 * number
    along = starts[joint + 1] + blends.reach[number] * blends.beyond(into, blends.corner[number])
    place = np.concatenate([starts[kept] + cut_before[kept], along])[order]
    piece = np.concatenate([kept, joint])[order]
    blend = np.concatenate([np.zeros(kept.size, bool), np.ones(joint.size, bool)])[order]
    path = from_pieces(whole, fit_error=fit.error, newton_steps=NEWTON_STEPS)
    apart = np.concatenate([np.zeros(kept.size), (deviation + used)[number] + fit.error])[order]
    return BlendedPath(path, contour, piece, blend, np.append(place, starts[-1]), apart)


def _cut(pieces: Piece, by, extent) -> Piece:
    """Pieces that begin later by an arc length [m], and are shorter."""
    polynomial = pieces.polynomial.copy()
    for i in range(polynomial.shape[1]):  # Taylor's shift by Horner's rule
        for k in reversed(range(i, polynomial.shape[1] - 1)):
            polynomial[:, k] += by[:, None] * polynomial[:, k + 1]
    turned = (pieces.rate * by)[:, None]
    cos, sin = np.cos(turned), np.sin(turned)
    cosine = pieces.cosine * cos + pieces.sine * sin
    sine = pieces.sine * cos - pieces.cosine * sin
    return Piece(polynomial, cosine, sine, pieces.rate, pieces.start, extent)


def _curves(blends: Blends):
    """The blends as one curve, blend k at parameters 2 k to 2 k + 1; its frames; its intervals.

    The frames at the ends are those of the path itself, to the last bit.
    """
    quintics, ends = blends.quintics(), blends.ends()

    def curve(t):
        number = (0.5 * t).astype(int)
        point, first, second, _ = jet(quintics, number, t - 2 * number)
        return point, first, second

    def frame(t, inner):
        number = (0.5 * t).astype(int)
        u = (t - 2 * number)[..., None]
        first, last = ends
        point, tangent, bend = (
            np.where(u == 0, first[k][number], np.where(u == 1, last[k][number], inner[k]))
            for k in range(3)
        )
        return point, tangent, bend

    begin = 2.0 * np.arange(blends.at.size)
    return curve, frame, begin, begin + 1.0
