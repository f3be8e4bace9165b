"""Intervals of numbers, many at once: sums, products and functions of them contain all results.

Rounding of the last digits is left to whoever uses them: a part in 10^9 of a bound covers it.
"""

from typing import NamedTuple, Union

import numpy as np

Bounds = np.ndarray
Operand = Union["Interval", float, np.ndarray]


class ReachesZero(ValueError):
    """A divisor that may be zero."""


class Interval(NamedTuple):
    """All numbers from `low` to `high`.

    >>> x = Interval(np.array(-1.0), np.array(2.0))
    >>> (x * x).low.item(), x.square().low.item()
    (-2.0, 0.0)
    """

    low: Bounds
    high: Bounds

    @classmethod
    def of(cls, value: Operand) -> "Interval":
        """The interval itself, or that of one number."""
        return value if isinstance(value, Interval) else cls(np.asarray(value), np.asarray(value))

    @property
    def size(self) -> np.ndarray:
        """Largest absolute value."""
        return np.asarray(np.maximum(np.abs(self.low), np.abs(self.high)))

    def plus(self, other: Operand) -> "Interval":
        """All sums."""
        other = Interval.of(other)
        return Interval(self.low + other.low, self.high + other.high)

    def minus(self) -> "Interval":
        """All negatives."""
        return Interval(-self.high, -self.low)

    def times(self, other: Operand) -> "Interval":
        """All products."""
        other = Interval.of(other)
        ends = [a * b for a in self for b in other]
        return Interval(np.minimum.reduce(ends), np.maximum.reduce(ends))

    def __mul__(self, other: Operand) -> "Interval":  # pyright: ignore[reportIncompatibleMethodOverride]
        return self.times(other)

    def square(self) -> "Interval":
        """All squares."""
        around = (self.low <= 0) & (self.high >= 0)
        least = np.where(around, 0.0, np.minimum(np.abs(self.low), np.abs(self.high)))
        return Interval(least**2, self.size**2)

    def reciprocal(self) -> "Interval":
        """All reciprocals.

        Raises:
            ReachesZero: zero is among the numbers.
        """
        if np.any((self.low <= 0) & (self.high >= 0)):
            raise ReachesZero("intervals: one of them reaches zero, and is divided by")
        return Interval(1 / self.high, 1 / self.low)

    def sine(self) -> "Interval":
        """All sines."""
        return _shifted_cosine(self, np.pi / 2)

    def cosine(self) -> "Interval":
        """All cosines."""
        return _shifted_cosine(self, 0.0)

    def at(self, index) -> "Interval":
        """Some of many, by a NumPy index."""
        return Interval(self.low[index], self.high[index])


def _shifted_cosine(x: Interval, shift: float) -> Interval:
    """cos(x - shift): the ends, and 1 or -1 where x - shift passes a multiple of pi."""
    low, high = x.low - shift, x.high - shift
    ends = np.cos(low), np.cos(high)

    def passes(offset):
        return np.floor((high - offset) / (2 * np.pi)) > np.floor((low - offset) / (2 * np.pi))

    return Interval(
        np.where(passes(np.pi), -1.0, np.minimum(*ends)),
        np.where(passes(0.0), 1.0, np.maximum(*ends)),
    )
