"""A planned motion of limited jerk: its time, its samples, and the axes at any time."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from jcontour.geometry.along_pieces import jet
from jcontour.geometry.contour import Contour
from jcontour.geometry.pieces import Piece
from jcontour.motion.jerk_limited.cells import Cells
from jcontour.motion.jerk_limited.cubic_motion import CubicMotion, MotionSamples
from jcontour.motion.jerk_limited.derivatives import composed
from jcontour.motion.jerk_limited.limits import AxisLimits
from jcontour.motion.jerk_limited.warp import Warp
from jcontour.motion.rests import NEVER, Rests

MOST_SAMPLES = 20_000_000
AT_ONCE = 200_000  # samples, which take a few hundred bytes each on their way
ROUNDING = 1e-6  # of a sample


@dataclass(frozen=True)
class JerkLimitedMotion:
    """Motion from rest to rest along a path, exact at any time.

    Attributes:
        path: contour that is followed.
        limits: of the axes.
        feed: (P,) greatest speed on every piece [m/s].
        stops: arc lengths at which it rests, both ends among them [m].
        gap: about the time that the search left to gain [s]; a ten-thousandth is usual.
    """

    path: Contour
    limits: AxisLimits
    feed: Float[np.ndarray, " P"]
    stops: Float[np.ndarray, " k"]
    _pieces: Piece
    _old: CubicMotion
    _cells: Cells
    _warp: Warp
    gap: float

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
        found = self._on(*warped, moves, time)
        piece = self._cells.piece[warped[0]]
        s = np.clip(found.arc - self._cells.place[warped[0]], 0.0, self._pieces.extent[piece])
        return composed(jet(self._pieces, piece, s)[1:], found)

    def sampled(self, dt: float, rests: Rests = NEVER) -> Float[np.ndarray, " T"]:
        """Arc length at 0, dt, ... [m], with rests in between; the last sample rests at the end.

        Raises:
            ValueError: `dt` is not above zero, or there are more than 20 million samples.
        """
        if not (np.isfinite(dt) and dt > 0):
            raise ValueError(f"dt: needs one number, finite and above zero, received {dt}")
        steps = np.ceil((self.duration + rests.total) / dt - ROUNDING)
        if not steps < MOST_SAMPLES:
            raise ValueError(
                f"feed, dt: the run would have {steps:.3g} samples, more than {MOST_SAMPLES}"
            )
        count = int(steps) + 1
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
