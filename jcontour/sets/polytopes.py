"""Bounded convex polytopes as rows, {x : H x <= h}, of two coordinates or more.

Corners, shadows and redundant rows are found by Qhull (scipy). A set without an inner point counts
as empty.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.optimize import linprog
from scipy.spatial import ConvexHull, HalfspaceIntersection

from jcontour.sets.disturbed_model import Numbers

FLAT = 1e-12  # radius of the largest ball inside, below which a set is empty
SAME = 12  # decimals to which the rows of two facets are one


class Polytope(NamedTuple):
    """All x with H x <= h."""

    H: Float[np.ndarray, "r n"]
    h: Float[np.ndarray, " r"]

    @property
    def middle(self) -> Float[np.ndarray, " n"] | None:
        """Centre of the largest ball inside; None where the set is empty.

        Raises:
            ValueError: the set is not bounded.
        """
        rows = np.column_stack([self.H, np.linalg.norm(self.H, axis=1)])
        cost = np.append(np.zeros(self.H.shape[1]), -1.0)
        free = [(None, None)] * self.H.shape[1]
        found = linprog(cost, rows, self.h, bounds=[*free, (0.0, None)], method="highs")
        if found.status == 2:
            return None
        if found.status != 0:
            raise ValueError(f"polytope: needs to be bounded, {found.message}")
        return found.x[:-1] if found.x[-1] > FLAT else None

    @property
    def corners(self) -> Float[np.ndarray, "c n"]:
        """Corners of a set that is not empty; one where more rows meet than needed may repeat."""
        return HalfspaceIntersection(np.column_stack([self.H, -self.h]), self._inside).intersections

    def within(self, other: "Polytope", slack: float = 0.0) -> bool:
        """Whether every point of this is in the other, or out by at most `slack`."""
        return bool((self.corners @ other.H.T <= other.h + slack).all())

    def intersection(self, other: "Polytope") -> "Polytope":
        """Points in both; redundant rows are left in."""
        return Polytope(np.concatenate([self.H, other.H]), np.concatenate([self.h, other.h]))

    def reduced(self) -> "Polytope":
        """The same set without its redundant rows."""
        dual = self.H / (self.h - self.H @ self._inside)[:, None]
        kept = np.sort(ConvexHull(dual).vertices)
        return Polytope(self.H[kept], self.h[kept])

    def shadow(self, coordinates: int) -> "Polytope":
        """Projection onto the first coordinates, rows of unit length."""
        facets = ConvexHull(self.corners[:, :coordinates]).equations
        _, first = np.unique(np.round(facets, SAME), axis=0, return_index=True)
        facets = facets[np.sort(first)]
        return Polytope(facets[:, :-1], -facets[:, -1])

    @property
    def _inside(self) -> Float[np.ndarray, " n"]:
        middle = self.middle
        if middle is None:
            raise ValueError("polytope: it is empty")
        return middle


def box(magnitudes: Numbers) -> Polytope:
    """All x with |x_i| <= magnitude_i.

    >>> square = box([1.0, 2.0])
    >>> len(square.corners), square.within(box([1.0, 3.0]))
    (4, True)

    Raises:
        ValueError: a magnitude is not above zero or not finite, or they are not in a row.
    """
    sizes = np.asarray(magnitudes, float)
    if sizes.ndim != 1 or sizes.size == 0 or not (np.isfinite(sizes) & (sizes > 0)).all():
        raise ValueError(
            "magnitudes: needs one finite number above zero for each coordinate, "
            f"received {magnitudes}"
        )
    rows = np.eye(sizes.size)
    return Polytope(np.concatenate([rows, -rows]), np.tile(sizes, 2))
