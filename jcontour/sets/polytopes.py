"""Convex polytopes as rows: {x : H x <= h}.

All questions are linear programs. Projection is by Fourier and Motzkin, one coordinate after the
other, with the rows that say nothing taken out: for few dimensions.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from scipy.optimize import linprog

from jcontour.sets.disturbed_model import Numbers

REDUNDANT = 1e-9  # of a row's bound: a row that can be exceeded by less says nothing
SAME = 1e-12  # rows of unit length that differ by less are one
FLAT = 1e-12  # of the largest entry: a coefficient below it is zero


class Polytope(NamedTuple):
    """All x with H x <= h; rows of H (r, n) have unit length where made by `polytope`."""

    H: Float[np.ndarray, "r n"]
    h: Float[np.ndarray, " r"]

    @property
    def dimension(self) -> int:
        """Number of coordinates n."""
        return self.H.shape[1]

    def contains(self, points: Numbers, slack: float = 0.0) -> Bool[np.ndarray, "*points"]:
        """Whether every point (..., n) is inside, or out by at most `slack`.

        Raises:
            ValueError: the points have other coordinates than the set.
        """
        places = np.asarray(points, float)
        if places.shape[-1:] != (self.dimension,):
            raise ValueError(
                f"points: needs shape (..., {self.dimension}), one number for each coordinate of "
                f"the set, received {places.shape}"
            )
        values = places @ self.H.T
        return np.asarray((values <= self.h + slack).all(axis=-1))

    def support(self, directions: Numbers) -> Float[np.ndarray, " k"]:
        """Largest c x of every direction c (k, n); infinite where there is none.

        Raises:
            ValueError: the polytope is empty, or the directions have other coordinates.
        """
        rows = np.atleast_2d(np.asarray(directions, float))
        if rows.shape[1:] != (self.dimension,):
            raise ValueError(
                f"directions: needs shape (k, {self.dimension}), one number for each coordinate of "
                f"the set, received {np.shape(directions)}"
            )
        found = [_largest(self.H, self.h, row) for row in rows]
        if any(value is None for value in found):
            raise ValueError("polytope: it is empty, nothing is largest on it")
        return np.array(found, float)

    @property
    def empty(self) -> bool:
        """Whether no point satisfies all rows."""
        return _largest(self.H, self.h, np.zeros(self.dimension)) is None

    def within(self, other: "Polytope", slack: float = REDUNDANT) -> bool:
        """Whether every point of this is in the other, or out by at most `slack`.

        Raises:
            ValueError: the other has another dimension.
        """
        self._check_alike(other)
        if self.empty:
            return True
        return all(
            value <= bound + slack * max(1.0, abs(bound))
            for value, bound in zip(self.support(other.H), other.h, strict=True)
        )

    def intersection(self, other: "Polytope") -> "Polytope":
        """Points in both; rows that say nothing are left in.

        Raises:
            ValueError: the other has another dimension.
        """
        self._check_alike(other)
        return Polytope(np.concatenate([self.H, other.H]), np.concatenate([self.h, other.h]))

    def _check_alike(self, other: "Polytope") -> None:
        if other.dimension != self.dimension:
            raise ValueError(
                f"other: needs the dimension of this set, {self.dimension}, "
                f"received one of {other.dimension}"
            )

    def eroded(self, E: Numbers) -> "Polytope":
        """Points that stay inside when E w is added, whatever |w_i| <= 1."""
        return Polytope(self.H, self.h - np.abs(self.H @ np.asarray(E, float)).sum(axis=1))

    def reduced(self) -> "Polytope":
        """The same set without the rows that say nothing."""
        H, h = _distinct(self.H, self.h)
        kept = np.ones(len(h), bool)
        for i in range(len(h)):
            kept[i] = False
            above = h + np.eye(len(h))[i]  # bounded where only this row bounds
            test = kept | (np.arange(len(h)) == i)
            largest = _largest(H[test], above[test], H[i])
            if largest is None or largest > h[i] + REDUNDANT * max(1.0, abs(h[i])):
                kept[i] = True
        return Polytope(H[kept], h[kept])

    def without_last(self) -> "Polytope":
        """The shadow along the last coordinate (Fourier and Motzkin)."""
        last = self.H[:, -1]
        size = FLAT * np.abs(self.H).max(initial=1.0)
        up, down, flat = last > size, last < -size, np.abs(last) <= size
        rows = [self.H[flat, :-1]]
        bounds = [self.h[flat]]
        if up.any() and down.any():
            above, below = self.H[up, :-1] / last[up, None], self.H[down, :-1] / last[down, None]
            rows.append((above[:, None] - below[None]).reshape(-1, self.dimension - 1))
            bounds.append((self.h[up] / last[up])[:, None] - (self.h[down] / last[down])[None])
        return _normalised(np.concatenate(rows), np.concatenate([one.ravel() for one in bounds]))


def polytope(H: Numbers, h: Numbers) -> Polytope:
    """Polytope of rows of any length.

    Raises:
        ValueError: shapes do not fit, a number is not finite, or a row of zeros that nothing
            satisfies.

    A square and the largest value of x + y on it:

    >>> square = polytope([[1, 0], [-1, 0], [0, 2], [0, -2]], [1, 1, 2, 2])
    >>> square.support([[1.0, 1.0]]).tolist()
    [2.0]
    """
    rows, bounds = np.asarray(H, float), np.asarray(h, float)
    if rows.ndim != 2 or bounds.shape != rows.shape[:1]:
        raise ValueError(
            f"H, h: need shapes (r, n) and (r,), received {rows.shape} and {bounds.shape}"
        )
    if not (np.isfinite(rows).all() and np.isfinite(bounds).all()):
        raise ValueError("H, h: every entry needs to be finite, received NaN or inf")
    found = _normalised(rows, bounds)
    if (np.abs(found.H).max(axis=1, initial=0.0) == 0).any():
        raise ValueError("H, h: a row of zeros has a bound below zero, the set is empty")
    return found


def box(magnitudes: Numbers) -> Polytope:
    """All x with |x_i| <= magnitude_i; an infinite one does not bound.

    Raises:
        ValueError: a magnitude is negative or not a number, or they are not in a row.
    """
    sizes = np.asarray(magnitudes, float)
    if sizes.ndim != 1 or sizes.size == 0 or not (sizes >= 0).all():
        raise ValueError(
            "magnitudes: needs one number of at least zero for each coordinate, "
            f"received {magnitudes}"
        )
    rows, bounds = np.eye(sizes.size), np.isfinite(sizes)
    rows = rows[bounds]
    return polytope(np.concatenate([rows, -rows]), np.tile(sizes[bounds], 2))


def _normalised(H: np.ndarray, h: np.ndarray) -> Polytope:
    """Rows of unit length; a row of zeros stays only where nothing satisfies it."""
    lengths = np.linalg.norm(H, axis=1)
    zero = lengths <= FLAT * np.abs(H).max(initial=0.0)
    kept = ~zero | (h < 0)
    scales = np.where(zero, 1.0, lengths)[kept]
    return Polytope(np.where(zero[:, None], 0.0, H)[kept] / scales[:, None], h[kept] / scales)


def _largest(H: np.ndarray, h: np.ndarray, direction: np.ndarray) -> float | None:
    """Largest value of a direction; None where the set is empty, infinite where it is unbounded."""
    found = linprog(-direction, H, h, bounds=(None, None), method="highs")
    if found.status == 0:
        return -float(found.fun)
    if found.status == 3 or (found.status == 4 and direction.any() and _feasible(H, h)):
        return np.inf
    if found.status == 2 and direction.any() and _feasible(H, h):
        return np.inf  # the solver's presolve tells unbounded from infeasible by luck
    return None


def _feasible(H: np.ndarray, h: np.ndarray) -> bool:
    zero = np.zeros(H.shape[1])
    return linprog(zero, H, h, bounds=(None, None), method="highs").status == 0


def _distinct(H: np.ndarray, h: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rows without repetitions: of equal ones the tightest."""
    order = np.argsort(h, kind="stable")
    H, h = H[order], h[order]
    _, first = np.unique(np.round(H / SAME / 1e3), axis=0, return_index=True)
    first = np.sort(first)
    return H[first], h[first]
