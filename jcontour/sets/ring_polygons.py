"""Polygons inside the tolerance ring of a circle: Yuan's Algorithm 2 and what replaces it.

The tool may be anywhere between the radii R - eps and R + eps. Chapter 5 cuts this ring into convex
pieces between an inner polygon around the inner circle, whose vertices are at

    l_vert = (R - eps) / cos(pi / n_in)
from the centre, and an outer polygon inside the outer circle, whose sides are at

    l_side = (R + eps) cos(pi / n_out).
For R = 80 mm and eps = 4 mm the printed (10, 10) leaves the circle itself outside the outer
polygon; line 5 of the algorithm makes it (10, 11).
"""

from typing import NamedTuple

import numpy as np


class RingPolygons(NamedTuple):
    """Side numbers, and how far vertices and sides are from the centre.

    Attributes:
        inner: n_in, sides of the polygon around the inner circle.
        outer: n_out, sides of the polygon inside the outer circle.
        vertex: l_vert of the inner polygon [m].
        side: l_side of the outer polygon [m].
    """

    inner: int
    outer: int
    vertex: float
    side: float


def ring_polygons(radius: float, tolerance: float) -> RingPolygons:
    """Fewest sides with l_vert <= R and R <= l_side, in the order of Algorithm 2.

    >>> found = ring_polygons(radius=80e-3, tolerance=4e-3)
    >>> found.inner, found.outer
    (10, 11)

    Args:
        radius: R of the contour [m].
        tolerance: eps, half the width of the ring [m].

    Raises:
        ValueError: the tolerance is not between zero and the radius.
    """
    if not 0 < tolerance < radius < np.inf:
        raise ValueError(
            f"tolerance: needs to be between zero and the radius {radius} m, received {tolerance} m"
        )
    inner = 3
    while (radius - tolerance) / np.cos(np.pi / inner) > radius:
        inner += 1
    vertex = (radius - tolerance) / np.cos(np.pi / inner)
    outer = 3
    while (radius + tolerance) * np.cos(np.pi / outer) < vertex:  # (5.42)
        outer += 1
    while (radius + tolerance) * np.cos(np.pi / outer) < radius:  # line 5: the circle lies inside
        outer += 1
    side = float((radius + tolerance) * np.cos(np.pi / outer))
    return RingPolygons(inner, outer, float(vertex), side)
