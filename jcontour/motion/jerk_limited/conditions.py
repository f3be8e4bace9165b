"""What limits mean for the unknowns of a warp, at three points of every cell.

A condition is linear in u, u' and u'' at a point, and so in the window of three unknowns of a cell:
for the speed `speed @ c <= 1`, for the acceleration `|acceleration @ c| <= 1`, and for the jerk
`|jerk @ c| <= 1 / sqrt(u)`.
"""

from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Bool, Float, Int

from jcontour.geometry.pieces import Piece
from jcontour.motion.jerk_limited.cubic_motion import CubicMotion, MotionSamples
from jcontour.motion.jerk_limited.limits import AxisLimits
from jcontour.motion.jerk_limited.warp import Ordinates

POINTS = np.array([0.0, 0.5, 1.0])  # of a cell
SIMPSON = np.array([1.0, 4.0, 1.0]) / 6.0
BERNSTEIN = np.stack([(1 - POINTS) ** 2, 2 * POINTS * (1 - POINTS), POINTS**2], axis=1)
SLOPES = np.stack([2 * (POINTS - 1), 2 - 4 * POINTS, 2 * POINTS], axis=1)
BENDS = np.tile([2.0, -4.0, 2.0], (3, 1))


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

    def taken(self, some: Bool[np.ndarray, " n"]) -> "Cells":
        """Some of the cells."""
        return Cells(*(values[some] for values in self))

    def motion(self, old: CubicMotion, fractions: Float[np.ndarray, " k"]) -> MotionSamples:
        """Motion at fractions of every cell, (n, k)."""
        elapsed = self.elapsed[:, None] + fractions * self.length[:, None]
        return old.on_cell(np.broadcast_to(self.cell[:, None], elapsed.shape), elapsed)


class Conditions(NamedTuple):
    """Conditions of every cell on its window of three unknowns.

    Attributes:
        middle: (n, 1, 3) middle ordinate of u, which is kept above zero, and u with it.
        square: (n, 3, 3) u at the three points.
        weight: (n, 3) of 1 / sqrt(u) in the duration [s].
        speed: (n, 3, 3).
        acceleration: (n, 3 m, 3).
        jerk: (n, 3 m, 3).
    """

    middle: Float[np.ndarray, "n 1 3"]
    square: Float[np.ndarray, "n 3 3"]
    weight: Float[np.ndarray, "n 3"]
    speed: Float[np.ndarray, "n 3 3"]
    acceleration: Float[np.ndarray, "n rows 3"]
    jerk: Float[np.ndarray, "n rows 3"]


Jet = tuple[np.ndarray, np.ndarray, np.ndarray]  # first, second and third derivative, axes last


def path_derivatives(pieces: Piece, s: Float[np.ndarray, "..."]) -> Jet:
    """First, second and third derivative [1, 1/m, 1/m^2] of pieces at their own arc length [m]."""
    if not pieces.rate.any():  # sines of no waves would take most of the time
        pieces = pieces._replace(rate=None)
    _, velocity, bend = pieces.jet(s)
    return velocity, bend, pieces.third(s)


def composed(path: Jet, motion: MotionSamples) -> Jet:
    """Derivatives of p(sigma(tau)) with respect to tau, axes last."""
    first, second, third = path
    v, a, j = (values[..., None] for values in motion[1:])
    return (
        first * v,
        second * v**2 + first * a,
        third * v**3 + 3 * second * v * a + first * j,
    )


def conditions(
    pieces: Piece,
    feed: Float[np.ndarray, " P"],
    limits: AxisLimits,
    old: CubicMotion,
    cells: Cells,
    ordinates: Ordinates,
) -> Conditions:
    """Conditions at the beginning, the middle and the end of every cell."""
    motion = cells.motion(old, POINTS)
    on = jax.tree.map(lambda rows: rows[cells.piece][:, None], pieces)
    path = path_derivatives(on, motion.arc - cells.place[:, None])
    first, second, third = composed(path, motion)
    length = cells.length[:, None, None]
    square = np.einsum("pb,nbk->npk", BERNSTEIN, ordinates.weights)
    slope = np.einsum("pb,nbk->npk", SLOPES, ordinates.weights) / length
    bend = np.einsum("pb,nbk->npk", BENDS, ordinates.weights) / length**2
    fastest = np.maximum(
        (np.abs(first) / limits.speed).max(axis=-1),
        np.linalg.norm(first, axis=-1) / feed[cells.piece][:, None],
    )
    u, du, ddu = (values[:, :, None, :] for values in (square, slope, bend))
    first, second, third = (values[..., None] for values in (first, second, third))
    acceleration = (second * u + 0.5 * first * du) / limits.acceleration[:, None]
    jerk = (third * u + 1.5 * second * du + 0.5 * first * ddu) / limits.jerk[:, None]
    n = cells.length.size
    return Conditions(
        ordinates.weights[:, 1:2],
        square,
        cells.length[:, None] * SIMPSON,
        fastest[..., None] ** 2 * square,
        acceleration.reshape(n, -1, 3),
        jerk.reshape(n, -1, 3),
    )
