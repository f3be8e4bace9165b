"""Rests of a motion: how long it stands still where it stops, as in the dwells of a program.

A law of motion is planned without them. Time then stands still for each: with rests r_i that begin
at the law's own times b_i, the time t of the whole is the law's time

    max(t - r_0 - ... - r_i, b_i),

i being the last rest that has begun.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float


class Rests(NamedTuple):
    """Rests of a motion, in order.

    Attributes:
        begin: times at which they begin, of the motion without rests [s].
        lasting: how long each lasts [s].
    """

    begin: Float[np.ndarray, " k"]
    lasting: Float[np.ndarray, " k"]

    @property
    def total(self) -> float:
        """Time that all of them last [s]."""
        return float(self.lasting.sum())

    def moving(self, time: Float[np.ndarray, " T"]) -> Float[np.ndarray, " T"]:
        """Times [s] of the motion without rests at times of the one with them.

        >>> Rests(np.array([2.0]), np.array([0.5])).moving(np.array([1.0, 2.25, 3.0])).tolist()
        [1.0, 2.0, 2.5]
        """
        lasted = np.append(0.0, np.cumsum(self.lasting))
        begun = np.searchsorted(self.begin + lasted[:-1], time, side="right")
        least = np.append(-np.inf, self.begin)
        return np.maximum(time - lasted[begun], least[begun])


NEVER = Rests(np.zeros(0), np.zeros(0))


def rest_of_pieces(rest: Float[np.ndarray, "..."] | None, count: int) -> Float[np.ndarray, " P"]:
    """How long a motion rests at the end of each of so many pieces [s]; NaN where it goes on.

    Raises:
        ValueError: wrong shape, a time below zero, or one that is infinite.
    """
    if rest is None:
        return np.full(count, np.nan)
    if rest.shape != (count,):
        raise ValueError(f"rest: needs shape ({count},), received {rest.shape}")
    wrong = np.isinf(rest) | (rest < 0)
    if wrong.any():
        raise ValueError(f"rest: needs finite times, not below zero, received {rest[wrong][0]}")
    return rest
