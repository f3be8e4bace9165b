"""A planned motion of limited jerk: a slow motion along the path, and a warp of its time.

The warp is u(tau) = (d tau / dt)^2, quadratic between nodes, with a continuous slope: a quadratic
spline in Bernstein form. Where the motion stops the spline is cut. Inside a cell u'' is constant,
so that tau follows the linear equation d2 tau / dt2 = u'(tau) / 2, whose solution is a hyperbolic
sine or a sine.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from jcontour.geometry.along_pieces import jet
from jcontour.geometry.contour import Contour
from jcontour.geometry.coordinates import positive
from jcontour.geometry.pieces import Piece
from jcontour.motion.feed_laws import NEVER, Rests, sample_count
from jcontour.motion.jerk_limited.conditions import Cells
from jcontour.motion.jerk_limited.cubic_motion import CubicMotion, MotionSamples, composed
from jcontour.motion.jerk_limited.limits import AxisLimits

SERIES = 1e-6  # of the argument: below, two terms are exact to rounding
AT_ONCE = 200_000  # samples, which take a few hundred bytes each on their way
ROUNDING = 1e-6  # of a sample


class Warp(NamedTuple):
    """Times t of nodes tau, and how tau runs between them."""

    node: Float[np.ndarray, " nodes"]  # tau of the nodes [s]
    time: Float[np.ndarray, " nodes"]  # t of the nodes [s]
    square: Float[np.ndarray, "n 3"]  # (n, 3) Bernstein ordinates of u in every cell

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


@dataclass(frozen=True)
class JerkLimitedMotion:
    """Motion from rest to rest along a path, exact at any time."""

    path: Contour  # contour that is followed
    limits: AxisLimits  # of the axes
    feed: Float[np.ndarray, " P"]  # (P,) greatest speed on every piece [m/s]
    stops: Float[np.ndarray, " k"]  # arc lengths at which it rests, both ends among them [m]
    _pieces: Piece
    _old: CubicMotion
    _cells: Cells
    _warp: Warp
    gap: float  # about the time that the search left to gain [s]; a ten-thousandth is usual

    @property
    def duration(self) -> float:
        """Cycle time [s]."""
        return float(self._warp.time[-1])

    @property
    def nodes(self) -> Float[np.ndarray, " n"]:
        """Times between which the motion is smooth [s]."""
        return self._warp.time

    @property
    def stopped(self) -> Float[np.ndarray, " k"]:
        """Times at which it is at its stops [s]."""
        begins = begins_of(self._old, self._cells)
        return np.append(self._warp.time[:-1][begins], self.duration)

    @property
    def passed(self) -> Float[np.ndarray, " ends"]:
        """Times at which its pieces begin, and its end [s]."""
        return self.reached(np.append(0.0, np.cumsum(self._pieces.extent)))

    def at(self, time: np.ndarray) -> MotionSamples:
        """Arc length and its derivatives at times [s]; at rest before the start and after the end.

        The jerk is that of the piece that begins where two meet.
        """
        time = np.asarray(time, float)
        return self._on(*self._cell(time), (time >= 0) & (time <= self.duration), time)

    def axes_at(self, time: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Speed [m/s], acceleration [m/s^2] and jerk [m/s^3] of the axes, each (*times, m)."""
        time = np.asarray(time, float)
        moves = (time >= 0) & (time <= self.duration)
        warped = self._cell(time)
        samples = self._on(*warped, moves, time)
        piece = self._cells.piece[warped[0]]
        s = np.clip(samples.arc - self._cells.place[warped[0]], 0.0, self._pieces.extent[piece])
        return composed(jet(self._pieces, piece, s)[1:], samples)

    def sampled(self, dt: float, rests: Rests = NEVER) -> Float[np.ndarray, " T"]:
        """Arc length at 0, dt, ... [m], with rests in between; the last sample rests at the end.

        Raises:
            ValueError: `dt` is not above zero, or there are more than 20 million samples.
        """
        steps = np.ceil((self.duration + rests.total) / positive("dt", dt) - ROUNDING)
        count = sample_count(steps) + 1
        parts = [np.arange(k, min(k + AT_ONCE, count)) * dt for k in range(0, count, AT_ONCE)]
        arc = np.concatenate([self.at(rests.moving(part)).arc for part in parts])
        arc = np.maximum.accumulate(arc)
        arc[-1] = self.stops[-1]
        return np.minimum(arc, self.stops[-1])

    def reached(self, arc: Float[np.ndarray, " k"]) -> Float[np.ndarray, " k"]:
        """Times at which arc lengths on the path are reached [s]; exact at its stops."""
        old = self._old.reached(arc)
        cell = np.searchsorted(self._warp.node, old, side="right") - 1
        cell = np.clip(cell, 0, self._cells.length.size - 1)
        passed = self._warp.reached(cell, old - self._warp.node[cell])
        stop = np.minimum(np.searchsorted(self.stops, arc), self.stops.size - 1)
        return np.where(self.stops[stop] == arc, self.stopped[stop], passed)

    def _cell(self, time: np.ndarray):
        return self._warp.at(np.clip(time, 0.0, self.duration))

    def _on(self, cell, tau, rate, turn, whirl, moves, time) -> MotionSamples:
        old = self._old.on_cell(self._cells.cell[cell], self._cells.elapsed[cell] + tau)
        arc = np.where(time >= self.duration, self.stops[-1], np.where(time <= 0, 0.0, old.arc))
        warped = MotionSamples(tau, rate, turn, whirl)
        derivatives = composed(np.stack(old[1:])[..., None], warped)
        return MotionSamples(arc, *(np.where(moves, d[..., 0], 0.0) for d in derivatives))


def begins_of(old: CubicMotion, cells: Cells) -> Bool[np.ndarray, " n"]:
    """Which cells come after a stop."""
    return (cells.elapsed == 0) & (old.coefficients[cells.cell, 1] == 0)
