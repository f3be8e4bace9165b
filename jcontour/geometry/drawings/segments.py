"""Parts of a drawing in the plane of complex numbers: lines, arcs of ellipses, rational curves.

An affine map takes each kind to itself, without loss.
"""

import cmath
import math
from typing import NamedTuple

from jcontour.geometry.toolpath_rules import SHORTEST

Planar = complex | float | int  # a point or a direction of the plane, x + i y
ROUND = 1e-9  # of the half axes: ellipses that are this close to a circle are circles
STANDS = 1e-12  # of a curve's size: a derivative this small has no direction


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


class Line(NamedTuple):
    """Straight from `start` to `end`."""

    start: Planar
    end: Planar

    def placed(self, affine: Affine) -> "Line":
        """Its image."""
        return Line(affine.point(self.start), affine.point(self.end))

    def backwards(self) -> "Line":
        """From end to start."""
        return Line(self.end, self.start)

    def middle(self) -> Planar:
        """A point halfway."""
        return 0.5 * (self.start + self.end)

    def heading(self) -> Planar:
        """Direction of its beginning, of any length."""
        return self.end - self.start


class Arc(NamedTuple):
    """p(t) = centre + first cos t + second sin t for t from `begin` to `begin + sweep` [rad].

    `first` and `second` are conjugate half diameters of an ellipse, or of a circle.
    """

    centre: Planar
    first: Planar
    second: Planar
    begin: float
    sweep: float

    def at(self, t: float) -> Planar:
        """Point at the parameter t."""
        return self.centre + self.first * math.cos(t) + self.second * math.sin(t)

    @property
    def start(self) -> Planar:
        """First point."""
        return self.at(self.begin)

    @property
    def end(self) -> Planar:
        """Last point: the first one, to the last bit, after a whole turn."""
        return self.start if abs(self.sweep) == math.tau else self.at(self.begin + self.sweep)

    def placed(self, affine: Affine) -> "Arc":
        """Its image."""
        return self._replace(
            centre=affine.point(self.centre),
            first=affine.direction(self.first),
            second=affine.direction(self.second),
        )

    def backwards(self) -> "Arc":
        """From end to start."""
        return self._replace(begin=self.begin + self.sweep, sweep=-self.sweep)

    def middle(self) -> Planar:
        """A point halfway."""
        return self.at(self.begin + 0.5 * self.sweep)

    def heading(self) -> Planar:
        """Direction of its beginning, of any length."""
        slope = self.second * math.cos(self.begin) - self.first * math.sin(self.begin)
        return math.copysign(1.0, self.sweep) * slope

    def is_circular(self) -> bool:
        """Whether it belongs to a circle."""
        u, v = self.first, self.second
        size = max(abs(u), abs(v))
        leaning = abs((u * v.conjugate()).real)
        return abs(abs(u) - abs(v)) <= ROUND * size and leaning <= ROUND * size**2


class Curve(NamedTuple):
    """p(t) = sum_i top[i] t^i / sum_i bottom[i] t^i for t from 0 to 1.

    Both sums have as many terms; a polynomial has bottom = (1, 0, ...).
    """

    top: tuple[Planar, ...]
    bottom: tuple[float, ...]

    @classmethod
    def bezier(cls, *points: Planar) -> "Curve":
        """Bezier curve of two or more control points."""
        degree = len(points) - 1
        top = tuple(
            math.comb(degree, i)
            * sum((-1) ** (i - j) * math.comb(i, j) * points[j] for j in range(i + 1))
            for i in range(degree + 1)
        )
        return cls(top, (1.0,) + (0.0,) * degree)

    def at(self, t: float) -> Planar:
        """Point at the parameter t."""
        return _polynomial(self.top, t) / _polynomial(self.bottom, t)

    @property
    def start(self) -> Planar:
        """First point."""
        return self.top[0] / self.bottom[0]

    @property
    def end(self) -> Planar:
        """Last point."""
        return sum(self.top) / sum(self.bottom)

    def placed(self, affine: Affine) -> "Curve":
        """Its image."""
        top = (
            affine.direction(a) + affine.shift * b
            for a, b in zip(self.top, self.bottom, strict=True)
        )
        return self._replace(top=tuple(top))

    def backwards(self) -> "Curve":
        """From end to start."""
        return Curve(_backwards(self.top), _backwards(self.bottom))

    def middle(self) -> Planar:
        """A point halfway."""
        return self.at(0.5)

    def heading(self) -> Planar:
        """Direction of its beginning, of any length: of the first derivative that is not zero."""
        size = abs(self.end - self.start) + abs(self.middle() - self.start)
        for i in range(1, len(self.top)):
            # derivatives of the quotient agree with these up to the first one that is not zero
            slope = self.top[i] - self.start * self.bottom[i]
            if abs(slope) > STANDS * size:
                return slope / self.bottom[0]
        return self.end - self.start


Segment = Line | Arc | Curve


class Drawn(NamedTuple):
    """A segment, and the line of the file that it is from."""

    segment: Segment
    line: int


def vanishes(segment: Segment) -> bool:
    """Whether a segment is too short to be cut."""
    if isinstance(segment, Line):
        size = abs(segment.end - segment.start)
    elif isinstance(segment, Arc):
        size = max(abs(segment.first), abs(segment.second)) * abs(segment.sweep)
    else:
        size = max(abs(segment.at(t) - segment.start) for t in (0.25, 0.5, 0.75, 1.0))
    return size < SHORTEST


def is_finite(segment: Segment) -> bool:
    """Whether all its points are finite numbers."""
    if isinstance(segment, Curve):
        ends = (segment.bottom[0], sum(segment.bottom))
        return all(map(cmath.isfinite, (*segment.top, *segment.bottom))) and all(ends)
    return all(map(cmath.isfinite, segment))


def _polynomial(coefficients: tuple, t: float):
    value = 0.0
    for coefficient in reversed(coefficients):
        value = value * t + coefficient
    return value


def _backwards(coefficients: tuple) -> tuple:
    """Coefficients in 1 - t."""
    count = len(coefficients)
    return tuple(
        (-1) ** j * sum(math.comb(i, j) * coefficients[i] for i in range(j, count))
        for j in range(count)
    )
