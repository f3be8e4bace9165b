"""Limits of the axes of a machine; what they and the joints of a path mean for a motion on it."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from jcontour.geometry.along_pieces import jet
from jcontour.geometry.coordinates import Numbers, per_axis
from jcontour.geometry.pieces import Piece

EASE = 0.5  # of the limits
TURN = 1e-8  # of the speed: a smaller jump of p' is rounding of a file
BEND = 1e-6  # of an axis's acceleration limit: a smaller jump of p'' v^2 is rounding
STRAIGHT = 1e-8  # [1/m] a smaller jump of p'' is rounding: at 1 m/s, 1e-8 m/s^2
SHARP = 1e-9  # of p'': likewise, for rounding is coarse on the smallest curves
SAMPLES = np.linspace(0.0, 1.0, 9)[:, None]  # of a piece


class AxisLimits(NamedTuple):
    """Greatest magnitudes per axis."""

    speed: Float[np.ndarray, " m"]  # [m/s], infinite for none
    acceleration: Float[np.ndarray, " m"]  # [m/s^2]
    jerk: Float[np.ndarray, " m"]  # [m/s^3]

    @property
    def at_ease(self) -> "AxisLimits":
        """What an axis may have where a motion goes on at its feed.

        The rest of the acceleration and of the jerk is for a motion that changes its speed there.
        """
        return AxisLimits(self.speed, EASE * self.acceleration, EASE * self.jerk)

    @classmethod
    def of(
        cls, axes: int, acceleration: Numbers, jerk: Numbers, speed: Numbers = np.inf
    ) -> "AxisLimits":
        """Limits of so many axes, each one number or one for each axis.

        >>> AxisLimits.of(2, acceleration=2.0, jerk=[100.0, 50.0]).jerk.tolist()
        [100.0, 50.0]

        Raises:
            ValueError: wrong shape, not above zero, or not finite (the speed may be infinite).
        """
        return cls(
            per_axis("speed", speed, axes, infinite=True),
            per_axis("acceleration", acceleration, axes),
            per_axis("jerk", jerk, axes),
        )


class Asked(NamedTuple):
    """What is asked of a motion along a path."""

    feed: Float[np.ndarray, " P"]  # of every piece of the path, at most [m/s]
    limits: AxisLimits  # of the axes


class Joints(NamedTuple):
    """What changes from piece to piece."""

    turn: Float[np.ndarray, " joints"]  # (P-1,) jump of p' [1]
    bend: Float[np.ndarray, " joints"]  # (P-1,) jump of p'' [1/m], 0 where it is rounding

    def smooth(self, feed: Float[np.ndarray, " P"], acceleration: float) -> Bool[np.ndarray, "..."]:
        """Which joints can be passed at the feed [m/s] without a jump of the acceleration."""
        passed = np.minimum(feed[:-1], feed[1:])
        return (self.turn < TURN) & (self.bend * passed**2 < BEND * acceleration)


def joints(pieces: Piece) -> Joints:
    """Joints between neighbouring pieces."""
    number = np.arange(pieces.extent.size - 1)
    before = jet(pieces, number, pieces.extent[:-1])
    after = jet(pieces, number + 1, 0.0 * pieces.extent[1:])
    turn, bend = np.linalg.norm(after - before, axis=-1)[1:3]
    curvature = np.maximum(*(np.linalg.norm(side[2], axis=-1) for side in (before, after)))
    rounding = np.maximum(STRAIGHT, SHARP * curvature)
    return Joints(turn, np.where(bend < rounding, 0.0, bend))


def curved(pieces: Piece) -> np.ndarray:
    """Which pieces are no straight lines, (P,)."""
    return (pieces.rate > 0) | pieces.polynomial[:, 2:].any(axis=(1, 2))


def everywhere(pieces: Piece) -> Float[np.ndarray, "3 9 P m"]:
    """First, second and third derivative [1, 1/m, 1/m^2] at nine places of every piece."""
    s = SAMPLES * pieces.extent
    return jet(pieces, np.broadcast_to(np.arange(pieces.extent.size), s.shape), s)[1:]
