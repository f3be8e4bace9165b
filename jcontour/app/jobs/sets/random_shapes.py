"""Contours drawn at random: splines, arcs, corners, spirals.

Each kind is drawn from a generator with a size [m]. A closed contour lies about within a circle of
that radius around the origin. An open one begins near the origin, is made of curves and chords of
that size, and is at least as long as it is asked to be. The plane is that of complex numbers.
"""

import cmath
from collections.abc import Callable

import numpy as np
from jaxtyping import Complex, Float

from jcontour.geometry.contour import Contour
from jcontour.geometry.contours import arc, chain, line, spline

# (generator, size [m], least length of an open contour [m]) -> contour
Shape = Callable[[np.random.Generator, float, float], Contour]

TURN_POINTS = 12  # of a spiral that its spline goes through, for each turn
LEAST_TURNS = 1.5  # of a spiral
INNER = 0.3  # of a spiral's size: the radius of its inner end
SPARE = 1.05  # a spline may be a little shorter than the curve that its points are on
STRAIGHT = 1e-6  # [rad] a smaller change of direction needs no rounding


def closed_spline(random: np.random.Generator, size: float, length: float) -> Contour:
    """Periodic spline around the origin through 5 to 9 points."""
    return spline(_in_plane(_around(random, 5, 9, 0.6 * size, size)), closed=True)


def open_spline(random: np.random.Generator, size: float, length: float) -> Contour:
    """Spline through points that wander; the chords between them turn by up to 60 degrees."""
    points = [0j]
    heading, gone = random.uniform(0.0, 2 * np.pi), 0.0
    while gone < length or len(points) < 4:
        chord = size * random.uniform(0.5, 1.0)
        points.append(points[-1] + cmath.rect(chord, heading))
        heading += random.uniform(-np.pi / 3, np.pi / 3)
        gone += chord
    return spline(_in_plane(np.array(points)))


def arcs(random: np.random.Generator, size: float, length: float) -> Contour:
    """Arcs of 30 to 150 degrees to either side, a line between some of them; no corner."""
    members: list[Contour] = []
    at, heading, gone = 0j, random.uniform(0.0, 2 * np.pi), 0.0
    while gone < length or len(members) < 2:
        if random.random() < 0.3:
            extent = size * random.uniform(0.3, 1.0)
            end = at + cmath.rect(extent, heading)
            members.append(line(_in_plane(at), _in_plane(end)))
        else:
            radius = size * random.uniform(0.4, 1.0)
            angle = random.choice([-1.0, 1.0]) * random.uniform(np.pi / 6, 5 * np.pi / 6)
            centre = at + cmath.rect(radius, heading + np.copysign(np.pi / 2, angle))
            end = centre + (at - centre) * cmath.rect(1.0, angle)
            members.append(arc(_in_plane(at), _in_plane(centre), angle))
            heading, extent = heading + angle, radius * abs(angle)
        at, gone = end, gone + extent
    return chain(members)


def corners(random: np.random.Generator, size: float, length: float) -> Contour:
    """Polygon of 3 to 6 sharp corners around the origin."""
    points = _around(random, 3, 6, 0.7 * size, size)
    return rounded_polygon(points, np.zeros(points.size))


def fillets(random: np.random.Generator, size: float, length: float) -> Contour:
    """Polygon of 3 to 6 corners around the origin, each rounded by an arc of its own radius."""
    points = _around(random, 3, 6, 0.7 * size, size)
    return rounded_polygon(points, random.uniform(0.15, 0.4, points.size))


def spiral(random: np.random.Generator, size: float, length: float) -> Contour:
    """Archimedean spiral between 0.3 of the size and the size, of as many turns as it takes.

    It runs outwards or inwards, to the left or to the right.
    """
    mean = 0.5 * (1.0 + INNER) * size
    turns = max(LEAST_TURNS, SPARE * length / (2 * np.pi * mean))
    radius, angle = np.linspace(
        [INNER * size, 0.0], [size, 2 * np.pi * turns], round(TURN_POINTS * turns) + 1
    ).T
    points = radius * np.exp(1j * (angle + random.uniform(0.0, 2 * np.pi)))
    if random.random() < 0.5:
        points = points.conj()
    return spline(_in_plane(points if random.random() < 0.5 else points[::-1]))


KINDS: tuple[Shape, ...] = (closed_spline, open_spline, arcs, corners, fillets, spiral)


def rounded_polygon(
    points: Complex[np.ndarray, " n"], rounding: Float[np.ndarray, " n"]
) -> Contour:
    """Polygon with corners at complex points [m], rounded by tangent arcs.

    An arc begins and ends at `rounding` times the shorter side beside its corner, less than a half;
    0 leaves the corner sharp. The contour begins in the middle of the last side.
    """
    before, after = points - np.roll(points, 1), np.roll(points, -1) - points
    trim = rounding * np.minimum(np.abs(before), np.abs(after))
    turned = np.angle(after / before)
    into, out_of = before / np.abs(before), after / np.abs(after)
    first = at = points[0] - 0.5 * before[0]
    members: list[Contour] = []
    for i, corner in enumerate(points):
        start = corner - trim[i] * into[i]
        members.append(line(_in_plane(at), _in_plane(start)))
        at = corner + trim[i] * out_of[i]
        if trim[i] > 0 and abs(turned[i]) > STRAIGHT:
            radius = trim[i] / np.tan(0.5 * turned[i])  # below zero: to the right
            centre = start + 1j * radius * into[i]
            members.append(arc(_in_plane(start), _in_plane(centre), turned[i]))
        elif trim[i] > 0:
            members.append(line(_in_plane(start), _in_plane(at)))
    return chain([*members, line(_in_plane(at), _in_plane(first))])


def _around(
    random: np.random.Generator, fewest: int, most: int, nearest: float, farthest: float
) -> Complex[np.ndarray, " n"]:
    """Points by increasing angle, as many as drawn, at distances [m] from the origin."""
    count = int(random.integers(fewest, most + 1))
    uneven = np.arange(count) + random.uniform(-0.25, 0.25, count) + random.random()
    return random.uniform(nearest, farthest, count) * np.exp(2j * np.pi / count * uneven)


def _in_plane(points: complex | np.ndarray) -> Float[np.ndarray, "*n 2"]:
    return np.stack([np.real(points), np.imag(points)], axis=-1)
