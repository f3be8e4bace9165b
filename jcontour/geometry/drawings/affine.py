"""Affine maps of the plane, with points as complex numbers."""

import cmath
from typing import NamedTuple


class Affine(NamedTuple):
    """p -> turn p + mirror conj(p) + shift, which is every affine map of the plane."""

    turn: complex = 1.0
    mirror: complex = 0.0
    shift: complex = 0.0

    @classmethod
    def matrix(cls, x: complex, y: complex, shift: complex) -> "Affine":
        """Map that takes 1 to `x` and i to `y`, before the shift."""
        return cls(0.5 * (x - 1j * y), 0.5 * (x + 1j * y), shift)

    @classmethod
    def rotation(cls, angle: float) -> "Affine":
        """Turn around the origin [rad]."""
        return cls(cmath.rect(1.0, angle))

    def point(self, point: complex) -> complex:
        """Where a point goes."""
        return self.turn * point + self.mirror * point.conjugate() + self.shift

    def direction(self, direction: complex) -> complex:
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


def similarity(before: tuple[complex, complex], after: tuple[complex, complex]) -> Affine:
    """Turn, scale and shift that takes two points to two others."""
    turn = (after[1] - after[0]) / (before[1] - before[0])
    return Affine(turn, 0.0, after[0] - turn * before[0])
