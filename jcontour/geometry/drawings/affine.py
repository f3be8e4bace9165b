"""Affine maps of the plane, with points as complex numbers."""

import cmath
from typing import NamedTuple

Planar = complex | float | int  # a point or a direction of the plane, x + i y


class Affine(NamedTuple):
    """p -> turn p + mirror conj(p) + shift, which is every affine map of the plane."""

    turn: Planar = 1.0
    mirror: Planar = 0.0
    shift: Planar = 0.0

    @classmethod
    def matrix(cls, x: Planar, y: Planar, shift: Planar) -> "Affine":
        """Map that takes 1 to `x` and i to `y`, before the shift."""
        return cls(0.5 * (x - 1j * y), 0.5 * (x + 1j * y), shift)

    def point(self, point: Planar) -> Planar:
        """Where a point goes."""
        return self.turn * point + self.mirror * point.conjugate() + self.shift

    def direction(self, direction: Planar) -> Planar:
        """Where a difference of two points goes."""
        return self.turn * direction + self.mirror * direction.conjugate()

    def after(self, first: "Affine") -> "Affine":
        """This map, after another one."""
        return Affine(
            self.turn * first.turn + self.mirror * first.mirror.conjugate(),
            self.turn * first.mirror + self.mirror * first.turn.conjugate(),
            self.point(first.shift),
        )

    def finite(self) -> bool:
        """Whether all its numbers are."""
        return all(map(cmath.isfinite, self))


def similarity(before: tuple[Planar, Planar], after: tuple[Planar, Planar]) -> Affine:
    """Turn, scale and shift that takes two points to two others."""
    turn = (after[1] - after[0]) / (before[1] - before[0])
    return Affine(turn, 0.0, after[0] - turn * before[0])
