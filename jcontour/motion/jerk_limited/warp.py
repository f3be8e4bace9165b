"""A warp of time: u(tau) = (d tau / dt)^2, quadratic between nodes, with a continuous slope.

The rate's square has one ordinate c_i for every cell; a node between two cells lies on the straight
line between theirs, so that u is a quadratic spline in Bernstein form. Where the motion stops the
spline is cut. Inside a cell u'' is constant, so that tau follows the linear equation
d2 tau / dt2 = u'(tau) / 2, whose solution is a hyperbolic sine or a sine.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

SERIES = 1e-6  # of the argument: below, two terms are exact to rounding


class Ordinates(NamedTuple):
    """How the Bernstein ordinates of a cell follow from the unknowns: a window of three of them.

    Attributes:
        first: number of the first unknown of the window.
        weights: (n, ordinate, unknown).
    """

    first: Int[np.ndarray, " n"]
    weights: Float[np.ndarray, "n 3 3"]

    def of(self, unknowns: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n 3"]:
        """Ordinates of all cells."""
        return np.einsum("nbk,nk->nb", self.weights, self.window(unknowns))

    def window(self, unknowns: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n 3"]:
        """The three unknowns of every cell."""
        return unknowns[self.first[:, None] + np.arange(3)]


def ordinates(length: Float[np.ndarray, " n"], begins: Bool[np.ndarray, " n"]) -> Ordinates:
    """Bernstein ordinates of cells [s]; `begins` says which come after a stop.

    Raises:
        ValueError: fewer than three cells between two stops.
    """
    n = length.size
    stops = np.append(np.flatnonzero(begins), n)
    count = np.diff(stops)
    if count.min() < 3:
        raise ValueError(f"cells: needs at least three between stops, received {count.min()}")
    ends = np.append(begins[1:], True)
    before, after = np.append(0.0, length[:-1]), np.append(length[1:], 0.0)
    weights = np.zeros((n, 3, 5))  # unknowns i-2 .. i+2
    share = np.where(begins, 0.0, length / (length + before))
    weights[:, 0, 1], weights[:, 0, 2] = share, 1.0 - share
    weights[:, 1, 2] = 1.0
    share = np.where(ends, 0.0, length / (length + after))
    weights[:, 2, 3], weights[:, 2, 2] = share, 1.0 - share
    low, high = np.repeat(stops[:-1], count), np.repeat(stops[1:] - 3, count)
    first = np.clip(np.arange(n) - 1, low, high)
    shift = first - np.arange(n) + 2  # 1, but 2 after a stop and 0 before one
    columns = shift[:, None] + np.arange(3)
    return Ordinates(first, np.take_along_axis(weights, columns[:, None, :], axis=2))


class Warp(NamedTuple):
    """Times t of nodes tau, and how tau runs between them.

    Attributes:
        node: tau of the nodes [s].
        time: t of the nodes [s].
        square: (n, 3) Bernstein ordinates of u in every cell.
    """

    node: Float[np.ndarray, " nodes"]
    time: Float[np.ndarray, " nodes"]
    square: Float[np.ndarray, "n 3"]

    @classmethod
    def of(cls, node: Float[np.ndarray, " nodes"], square: Float[np.ndarray, "n 3"]) -> "Warp":
        """Warp of the square of the rate: dt = d tau / sqrt(u), in closed form."""
        length = np.diff(node)
        rates = np.sqrt(square[:, 0]) + np.sqrt(square[:, 2])
        bend = square[:, 0] - 2 * square[:, 1] + square[:, 2]
        duration = 2 * length / rates * _area(bend / rates**2)
        return cls(node, np.concatenate([[0.0], np.cumsum(duration)]), square)

    def at(self, time: np.ndarray):
        """Cell, tau since its beginning [s], d tau/dt [1], and the next two derivatives."""
        last = len(self.square) - 1
        cell = np.clip(np.searchsorted(self.time, time, side="right") - 1, 0, last)
        t, length = time - self.time[cell], np.diff(self.node)[cell]
        first, middle, end = self.square[cell].T
        bend = (first - 2 * middle + end) / length**2  # half of u''
        push = (middle - first) / length  # half of u' at the beginning
        rate = np.sqrt(first)
        whole, half = t * _swing(bend * t**2), 0.5 * t * _swing(0.25 * bend * t**2)
        tau = rate * whole + 2 * push * half**2
        # cosh(w t) = 1 + 2 sinh(w t / 2)^2
        rising = 1 + 2 * bend * half**2
        speed = rate * rising + push * whole
        return cell, np.clip(tau, 0.0, length), speed, push + bend * tau, bend * speed

    def reached(self, cell: np.ndarray, elapsed: np.ndarray) -> np.ndarray:
        """Time t at which tau has run so far [s] into a cell."""
        length = np.diff(self.node)[cell]
        first, middle, end = self.square[cell].T
        bend, push = (first - 2 * middle + end) / length**2, (middle - first) / length
        there = first + elapsed * (2 * push + elapsed * bend)
        rates = np.sqrt(first) + np.sqrt(there)
        return self.time[cell] + 2 * elapsed / rates * _area(bend * (elapsed / rates) ** 2)


def _area(z: np.ndarray) -> np.ndarray:
    """Inverse hyperbolic tangent of sqrt(z) over sqrt(z); an arc tangent below zero."""
    small = np.abs(z) < SERIES
    root = np.sqrt(np.where(small, 1.0, np.abs(z)))
    rounded = np.minimum(root, 1 - 1e-16)
    value = np.where(z > 0, np.arctanh(rounded), np.arctan(root)) / root
    return np.where(small, 1 + z / 3 + z**2 / 5, value)


def _swing(z: np.ndarray) -> np.ndarray:
    """Hyperbolic sine of sqrt(z) over sqrt(z); a sine below zero."""
    small = np.abs(z) < SERIES
    root = np.sqrt(np.where(small, 1.0, np.abs(z)))
    value = np.where(z > 0, np.sinh(np.minimum(root, 700.0)), np.sin(root)) / root
    return np.where(small, 1 + z / 6 + z**2 / 120, value)
