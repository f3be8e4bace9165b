"""Blends at the joints of a path: curves that leave one piece and meet the next.

A blend leaves the piece before a joint at a distance d and meets the piece after it at the same
distance. Between two lines it is the cubic

    r(u) = corner - d (1 - u)^3 t_0 + d u^3 t_1,        u from 0 to 1,

with t_0 and t_1 the directions of the lines: one axis comes to rest at constant jerk while the
other one leaves it, which is the quickest way around a slow corner. Between curves it is the
quintic with the same derivatives at both ends, the curvature of the path added. Point u belongs to
the point of the path at d (u^3 - (1 - u)^3) from the joint. Where the curvature jumps and the
direction does not, the quintic has no second derivative along the path at its ends, and u belongs
to d (2 u - 1). The greatest distance of two such points bounds the distance of the blend from the
path and of the path from the blend: d |t_1 - t_0| / 8 between lines.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from jcontour.geometry.along_pieces import jet
from jcontour.geometry.pieces import Piece

STEPS = 32  # of a blend, at which it is looked at


class Blends(NamedTuple):
    """Blends at joints `at` of pieces, each of a reach d [m] to both sides.

    At a `corner` the direction jumps; elsewhere the curvature alone does.
    """

    pieces: Piece
    at: Int[np.ndarray, " B"]
    corner: Bool[np.ndarray, " B"]
    reach: Float[np.ndarray, " B"]

    def left(self) -> Float[np.ndarray, " P"]:
        """What is left of every piece [m]."""
        left = self.pieces.extent.copy()
        left[self.at] -= self.reach
        left[self.at + 1] -= self.reach
        return left

    def some(self, which: np.ndarray) -> "Blends":
        """Some of the blends."""
        return self._replace(at=self.at[which], corner=self.corner[which], reach=self.reach[which])

    def ends(self) -> Float[np.ndarray, "2 3 B m"]:
        """Point, tangent and curvature vector where the blends begin and end."""
        piece = np.stack([self.at, self.at + 1])
        place = np.stack([self.pieces.extent[self.at] - self.reach, self.reach])
        return np.swapaxes(jet(self.pieces, piece, place)[:3], 0, 1)

    def path(self, u: Float[np.ndarray, " n"]) -> Float[np.ndarray, "B n m"]:
        """Points of the path beside the blends."""
        beyond = self.reach[:, None] * self.beyond(u, self.corner[:, None])
        piece = self.at[:, None] + (u >= 0.5)
        place = beyond + np.where(u < 0.5, self.pieces.extent[piece], 0.0)
        return jet(self.pieces, piece, place)[0]

    def quintics(self) -> Piece:
        """The blends as polynomials in u."""
        (p, v, c), (p1, v1, c1) = self.ends()
        scale = (np.where(self.corner, 3.0, 2.0) * self.reach)[:, None]  # |dr/du| at both ends
        slowing = np.where(self.corner, 2.0, 0.0)[:, None]
        v, v1 = v * scale, v1 * scale
        c, c1 = c * scale**2 - slowing * v, c1 * scale**2 + slowing * v1
        gap, turn, bend = p1 - p - v - c / 2, v1 - v - c, c1 - c
        cubic, quartic = 10 * gap - 4 * turn + bend / 2, -15 * gap + 7 * turn - bend
        quintic = 6 * gap - 3 * turn + bend / 2
        none = np.zeros(self.reach.size)
        polynomial = np.stack([p, v, c / 2, cubic, quartic, quintic], axis=1)
        return Piece(polynomial, 0.0 * p, 0.0 * p, none, none, none + 1.0)

    @staticmethod
    def beyond(u: np.ndarray, corner: np.ndarray) -> np.ndarray:
        """Place on the path beside a point of a blend: from -1, where it begins, to 1."""
        return np.where(corner, u**3 - (1 - u) ** 3, 2 * u - 1)

    def deviation(self) -> Float[np.ndarray, " B"]:
        """Greatest distance of a blend from its path [m]."""
        u = np.arange(1, STEPS) / STEPS
        return np.linalg.norm(self._at(u)[0] - self.path(u), axis=-1).max(axis=1)

    def along(self) -> Float[np.ndarray, "3 B n m"]:
        """First, second and third derivative with respect to the arc length [1, 1/m, 1/m^2]."""
        _, first, second, third = self._at(np.arange(STEPS + 1) / STEPS)
        pace = np.linalg.norm(first, axis=-1, keepdims=True)  # ds/du
        tangent = first / pace
        hurry = np.sum(tangent * second, axis=-1, keepdims=True)
        bend = (second - hurry * tangent) / pace**2
        across = np.sum(second**2 + first * third, axis=-1, keepdims=True)
        twist = third - 3 * pace * hurry * bend - (across - hurry**2) / pace * tangent
        return np.stack([tangent, bend, twist / pace**3])

    def _at(self, u: Float[np.ndarray, " n"]) -> Float[np.ndarray, "4 B n m"]:
        """Points of the blends and their derivatives in u."""
        every = np.broadcast_to(np.arange(self.at.size)[:, None], (self.at.size, u.size))
        return jet(self.quintics(), every, np.broadcast_to(u, every.shape))
