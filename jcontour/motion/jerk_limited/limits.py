"""Limits of the axes of a machine."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from jcontour.geometry.coordinates import Numbers, per_axis, per_piece

EASE = 0.5  # of the limits


class AxisLimits(NamedTuple):
    """Greatest magnitudes per axis.

    Attributes:
        speed: [m/s], infinite for none.
        acceleration: [m/s^2].
        jerk: [m/s^3].
    """

    speed: Float[np.ndarray, " m"]
    acceleration: Float[np.ndarray, " m"]
    jerk: Float[np.ndarray, " m"]

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
    """What is asked of a motion along a path.

    Attributes:
        feed: of every piece of the path, at most [m/s].
        limits: of the axes.
    """

    feed: Float[np.ndarray, " P"]
    limits: AxisLimits

    def checked(self, pieces: int) -> "Asked":
        """The same.

        Raises:
            ValueError: the feed is not of so many pieces, or not finite and above zero.
        """
        return Asked(per_piece("feed", self.feed, pieces), self.limits)

    @property
    def lower(self) -> Float[np.ndarray, " joints"]:
        """Lower feed of both pieces at every joint [m/s]."""
        return np.minimum(self.feed[:-1], self.feed[1:])
