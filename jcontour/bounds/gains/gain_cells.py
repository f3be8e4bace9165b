"""Largest signals of a loop for all constant gains of a cell, proven.

    g_i = c_i (1 + delta_i),   |delta_i| <= h_i,   c the middle of the cell
A signal e(delta) under one disturbance is close to its multilinear interpolation between the
corners. The interpolation is a mean of the corners, so that their exact peak bounds bound it:

    sup |e(delta)| <= max over the corners of sup |e|  +  sum_i h_i^2 / 2 max |d2 e / d delta_i^2|
Let F and A be the loop's answers at the middle, of e and of v = u - u_0 + force, to a force more;
u_0 as in `gained_loops`. Then d2 e / d delta_i^2 = 2 F A_ii v_i at delta. For all delta of the cell

    |v| <= V,   V = V0 + |A| h V                          V0 at the middle
    |A_i v_i| <= S,   S = |A| (V_i + h S)                 |A_i s_i| <= W,   W = |A| (S_i + h W)
    1/2 |d2 e / d delta_i^2| <= |F| (S_i + h W)
The sums close where the spectral radius of (peak gains of A) h is below one. It is the causal small
gain theorem (Dahleh & Khammash), time-resolved; the notes that we follow expand at the middle.
"""

from itertools import product
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from jcontour.bounds.disturbed_loop import DisturbedLoop
from jcontour.bounds.gains.gained_loops import gained, moving_control, received_rows
from jcontour.bounds.peak_bounds import block_that_forgets, peak_bounds

CLOSED = 0.01  # relative; what is closed enters the remainder alone, a few per cent of the bound
FORGOTTEN = 1e-3  # likewise, of the state that a sweep does not see; it is bounded and added
ROUNDS = 30  # of the sums, before their geometric tail


class GainCell(NamedTuple):
    """Gains from `low` to `high`, relative.

    >>> whole = GainCell(np.array([0.9, 0.9]), np.array([1.1, 1.3]))
    >>> [half.low.round(3).tolist() for half in whole.halves()]
    [[0.9, 0.9], [0.9, 1.1]]
    """

    low: Float[np.ndarray, " p"]
    high: Float[np.ndarray, " p"]

    @property
    def middle(self) -> Float[np.ndarray, " p"]:
        """c."""
        return (self.low + self.high) / 2

    @property
    def half_width(self) -> Float[np.ndarray, " p"]:
        """h, relative to the middle."""
        return (self.high - self.low) / (self.high + self.low)

    @property
    def corners(self) -> list[np.ndarray]:
        """Gains at the corners; once each."""
        ends = [sorted({low, high}) for low, high in zip(self.low, self.high, strict=True)]
        return [np.array(corner) for corner in product(*ends)]

    def halves(self) -> tuple["GainCell", "GainCell"]:
        """Both halves, across the widest side."""
        side = np.arange(self.low.size) == np.argmax(self.half_width)
        cut = self.middle
        return (
            GainCell(self.low, np.where(side, cut, self.high)),
            GainCell(np.where(side, cut, self.low), self.high),
        )


class CellPeaks(NamedTuple):
    """Largest signals of a loop over a cell of gains.

    Attributes:
        corners: largest deviations of the tool from the middle's undisturbed run, in every
            direction, at every corner of the cell [m].
        between: what other gains may add to the largest corner [m].
        control: largest |u| of every control.
    """

    corners: Float[np.ndarray, "c T s"]
    between: Float[np.ndarray, "T s"]
    control: Float[np.ndarray, "T p"]

    @property
    def tool(self) -> Float[np.ndarray, "T s"]:
        """Largest deviations of the tool for all gains of the cell [m]."""
        return self.corners.max(axis=0) + self.between


class TooWide(ValueError):
    """A cell whose sums do not close.

    Attributes:
        factor: times that it is too wide.
    """

    def __init__(self, factor: float):
        super().__init__(f"gains: the cell is {factor:.3g} times too wide, its sums do not close")
        self.factor = factor


def cell_peaks(
    loop: DisturbedLoop,
    cell: GainCell,
    middle: DisturbedLoop,
    basis: Float[np.ndarray, "T s m"],
    size: Float[np.ndarray, " d"],
) -> CellPeaks:
    """Largest signals of a loop for all gains of a cell.

    Args:
        loop: at gains of one.
        cell: of gains.
        middle: the loop at the middle of the cell.
        basis: directions in which the tool's deviations count.
        size: of the box of disturbances.

    Raises:
        TooWide: the sums do not close.
    """
    (T, s, _), p = basis.shape, loop.control.shape[1]
    rows = np.concatenate([basis @ np.asarray(loop.C), loop.K], axis=1)
    direct = np.zeros((T, s + p, size.size))
    direct[:, s:, p:] = loop.D
    between = remainder(middle, cell.half_width, rows, size)
    tool, control = [], []
    for gains in cell.corners:
        corner = gained(loop, gains)
        found = peak_bounds(corner, rows, size, direct).bound
        moved = np.einsum("tsm,tm->ts", basis, corner.output - middle.output)
        tool.append(np.abs(moved) + found[:, :s])
        control.append(np.abs(corner.control) + found[:, s:])
    return CellPeaks(np.array(tool), between[:, :s], np.max(control, axis=0) + between[:, s:])


def remainder(
    middle: DisturbedLoop,
    half_width: Float[np.ndarray, " p"],
    rows: Float[np.ndarray, "T r N"],
    size: Float[np.ndarray, " d"],
) -> Float[np.ndarray, "T r"]:
    """Largest difference of signals from their interpolation between the corners of a cell.

    Args:
        middle: the loop at the middle of the cell.
        half_width: h.
        rows: c(k) of the signals.
        size: of the box of disturbances.

    Raises:
        TooWide: the sums do not close.
    """
    loop, h = _forced(middle), half_width
    feedback = _Feedback.of(loop, h)
    own = peak_bounds(middle, np.asarray(middle.K), size, np.asarray(received_rows(middle))).bound
    control = feedback.closed(np.abs(moving_control(middle)) + own)
    forces = np.zeros_like(control)
    for i in range(h.size):
        once = feedback.closed(feedback.answer(_alone(control, i)))
        twice = feedback.closed(feedback.answer(_alone(once, i)))
        forces += h[i] ** 2 * (_alone(once, i) + h * twice)
    return _answer(loop, rows, forces)


def _alone(values: np.ndarray, i: int) -> np.ndarray:
    """One column of many, the others zero."""
    return np.where(np.arange(values.shape[1]) == i, values, 0.0)


def _forced(loop: DisturbedLoop) -> DisturbedLoop:
    """The loop under forces alone."""
    return loop._replace(E=loop.E[:, :, : loop.control.shape[1]])


def _answer(loop: DisturbedLoop, rows: np.ndarray, forces: np.ndarray) -> np.ndarray:
    """Largest signals under forces of these sizes at each sample (T, r)."""
    sized = loop._replace(E=loop.E * jnp.asarray(forces)[:, None])
    block = block_that_forgets(loop, FORGOTTEN)
    return peak_bounds(sized, rows, np.ones(forces.shape[1]), block=block).bound


class _Feedback(NamedTuple):
    """Answers |A| of the controls to forces of the size of controls.

    Attributes:
        loop: under forces alone.
        half_width: h.
        peaks: largest sums of |A| over the run, control by force.
    """

    loop: DisturbedLoop
    half_width: np.ndarray
    peaks: np.ndarray

    @classmethod
    def of(cls, loop: DisturbedLoop, half_width: np.ndarray) -> "_Feedback":
        """Answers of a loop.

        Raises:
            TooWide: their sums under h do not close.
        """
        rows, p = np.asarray(loop.K), half_width.size
        columns = [peak_bounds(loop, rows, size).bound.max(axis=0) for size in np.eye(p)]
        peaks = np.stack(columns, axis=1)
        radius = np.abs(np.linalg.eigvals(peaks * half_width)).max()
        if not radius < 1:
            raise TooWide(float(radius))
        return cls(loop, half_width, peaks)

    def answer(self, forces: np.ndarray) -> np.ndarray:
        """|A| forces (T, p)."""
        return _answer(self.loop, np.asarray(self.loop.K), forces)

    def closed(self, first: np.ndarray) -> np.ndarray:
        """An upper bound of X = first + |A| h X: some terms of the sum, then its largest tail."""
        found, term = first, first
        once = self.peaks * self.half_width
        tail = np.linalg.solve(np.eye(once.shape[0]) - once, once)
        for _ in range(ROUNDS):
            left = tail @ term.max(axis=0)
            if np.all(left <= CLOSED * found.max(axis=0)):
                break
            term = self.answer(self.half_width * term)
            found = found + term
        return found + tail @ term.max(axis=0)
