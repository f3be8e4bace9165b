"""Cells of a mesh, and the old motion on eight of them at once."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from jcontour._native.lanes import fma, load, part, spread
from jcontour.motion.jerk_limited.cubic_motion import CubicMotion

# numbers of a cell: the old motion's cubic, where the piece begins, the cell's own begin and length
PLACE, ELAPSED, LENGTH, NUMBERS = 4, 5, 6, 7


class Cells(NamedTuple):
    """Cells of a mesh: what they lie on.

    Attributes:
        piece: number of the path's piece.
        place: arc length at which the piece begins [m].
        elapsed: time of the old motion from its own node to the beginning of the cell [s].
        cell: number of the old motion's cell.
        length: of the cell in the old motion's time [s].
    """

    piece: Int[np.ndarray, " n"]
    place: Float[np.ndarray, " n"]
    elapsed: Float[np.ndarray, " n"]
    cell: Int[np.ndarray, " n"]
    length: Float[np.ndarray, " n"]

    def taken(self, some: Bool[np.ndarray, " n"] | slice) -> "Cells":
        """Some of the cells."""
        return Cells(*(values[some] for values in self))

    def in_rows(
        self, old: CubicMotion, more: Float[np.ndarray, "n k"]
    ) -> Float[np.ndarray, "n 7+k"]:
        """The numbers of every cell, and others after them."""
        found = np.empty((self.length.size, NUMBERS + more.shape[1]))
        found[:, :PLACE] = old.coefficients[self.cell]
        found[:, PLACE], found[:, ELAPSED], found[:, LENGTH] = (
            self.place,
            self.elapsed,
            self.length,
        )
        found[:, NUMBERS:] = more
        return found


@part
def old_motion(cells, at, x):
    """Place on the piece, speed, acceleration and jerk of the old motion at fractions of cells."""
    two, three, six = spread(2.0), spread(3.0), spread(6.0)
    s, v = load(cells, at), load(cells, at + 1)
    a, j = load(cells, at + 2), load(cells, at + 3)
    t = fma(x, load(cells, at + LENGTH), load(cells, at + ELAPSED))
    place = fma(t, fma(t, fma(t, j, a), v), s) - load(cells, at + PLACE)
    return place, fma(t, fma(three * t, j, two * a), v), fma(six * t, j, two * a), six * j
