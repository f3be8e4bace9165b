"""Blends: corners of a path, and jumps of its curvature, replaced by curves within a tolerance.

What a blend is: see `blends`; how far it reaches: see `reaches`. Blends are written as quintics in
their own arc length, so that the blended path is a contour.
"""

from dataclasses import dataclass

import jax
import numpy as np
from jaxtyping import Bool, Float, Int

from jcontour.geometry.along_pieces import jet
from jcontour.geometry.contour import Contour
from jcontour.geometry.contours import NEWTON_STEPS, from_pieces
from jcontour.geometry.coordinates import Numbers
from jcontour.geometry.pieces import Piece
from jcontour.geometry.quintics import fitted
from jcontour.motion.blends import Blends
from jcontour.motion.jerk_limited.joints import joints, unpadded
from jcontour.motion.jerk_limited.limits import Asked
from jcontour.motion.reaches import SHORTEST, as_needed, within, without_gaps

SHARE = 0.5  # of a piece, at most, that a blend takes at each of its ends
SAFETY = 0.99  # of the tolerance: the deviation may peak between the places where it is measured
FIT = 1e-3  # of its deviation: what the quintics may be off a blend
FINEST = 1e-12  # [m] of that
SHARPEST = 2 * np.sin(np.radians(120.0) / 2)  # jump of the tangent: beyond it a stop is quicker
ROUNDING = 1e-9  # jump of the tangent that is none
CORNER = 1e-3  # jump of the tangent: a smaller one is rather a jump of the curvature


@dataclass(frozen=True)
class BlendedPath:
    """A path with blends, and where it lies on the true contour.

    Attributes:
        path: contour that is followed.
        contour: the true one.
        piece: (P',) number of the true piece that a piece is part of; of a blend, the one before.
        blend: (P',) which pieces belong to blends.
        place: (P'+1,) arc length on the true contour where each begins, and the end [m].
        apart: (P',) bound of the distance between each and the contour [m].
    """

    path: Contour
    contour: Contour
    piece: Int[np.ndarray, " P"]
    blend: Bool[np.ndarray, " P"]
    place: Float[np.ndarray, " ends"]
    apart: Float[np.ndarray, " P"]

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
    asked = None if asked is None else asked.checked(count)
    found = joints(pieces)
    rough = (found.turn > ROUNDING) | (found.bend > 0)
    at = np.flatnonzero(allowed & rough & (found.turn < SHARPEST))
    at = at[tolerance[at] > 0]
    if at.size > 0:
        most = SHARE * np.minimum(pieces.extent[at], pieces.extent[at + 1])
        blends = Blends(pieces, at, found.turn[at] > CORNER, most)
        left = SAFETY * (tolerance[at] - used[at])
        blends = within(blends, left)
        if asked is not None:
            blends = as_needed(blends, left, asked.lower[at], asked.limits)
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
