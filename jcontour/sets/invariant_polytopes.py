"""Robust control invariant sets as polytopes (Yuan, Algorithm 1).

    x(k+1) = A x(k) + B u(k) + E w(k),   |w_i| <= 1
A set is robust control invariant if from every point some allowed control keeps the state in it,
whatever the disturbance does. Tractable for few states: the number of rows grows with every step.
Corners, shadows and redundant rows of the polytopes are found by Qhull (scipy).
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.optimize import linprog
from scipy.spatial import ConvexHull, HalfspaceIntersection

from jcontour.sets.responses import DisturbedModel, Numbers

FLAT = 1e-12  # radius of the largest ball inside, below which a set is empty
SAME = 12  # decimals to which the rows of two facets are one
MOST_ROWS = 5000  # corners of more take minutes


class Polytope(NamedTuple):
    """All x with H x <= h, of two coordinates or more; empty where it has no inner point."""

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
        ball = linprog(cost, rows, self.h, bounds=[*free, (0.0, None)], method="highs")
        if ball.status == 2:
            return None
        if ball.status != 0:
            raise ValueError(f"polytope: needs to be bounded, {ball.message}")
        return ball.x[:-1] if ball.x[-1] > FLAT else None

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


class InvariantSet(NamedTuple):
    """An invariant set and how it was found."""

    polytope: Polytope  # the set
    steps: int  # after which the iteration stopped


def control_invariant(
    model: DisturbedModel,
    allowed: Polytope,
    controls: Float[np.ndarray, " p"],
    margin: float,
    most_steps: int = 100,
) -> InvariantSet | None:
    """A control invariant set inside `allowed`; None where the iteration ends empty.

        R_{i+1} = R_i intersected with {x : there is u with A x + B u + E w in R_i - B(margin)}
    ends as soon as R_i - B(margin) lies in R_{i+1}; B(margin) is the ball of the Euclidean norm in
    these coordinates. Theorem 4.1's test, with R_i - B inside R_{i+1} (see errata), makes the
    result invariant and the end come in finitely many steps. An empty end with a margin above zero
    proves nothing about the machine: a certificate does, see `tolerance_certificates`.

    Args:
        model: A, B, E, of two states or more.
        allowed: polytope of states, rows of unit length.
        controls: largest magnitudes of the controls (p,).
        margin: rho of the ball, above zero.
        most_steps: of the iteration.

    Raises:
        ValueError: bad input, no end within `most_steps`, or more rows than are tractable.
    """
    limits, p = np.broadcast_to(np.asarray(controls, float), (model.inputs,)), model.inputs
    if not margin > 0:
        raise ValueError(f"margin: needs to be above zero, received {margin}")
    on_controls = np.concatenate(
        [np.zeros((2 * p, model.states)), np.kron([[1], [-1]], np.eye(p))], axis=1
    )
    polytope = allowed.reduced()
    for step in range(1, most_steps + 1):
        inner = Polytope(polytope.H, polytope.h - margin)
        # states and controls from which the next state is in the inner set under every disturbance
        eroded = inner.h - np.abs(inner.H @ model.E).sum(axis=1)
        rows = np.concatenate([inner.H @ model.A, inner.H @ model.B], axis=1)
        both = Polytope(
            np.concatenate([rows, on_controls]), np.concatenate([eroded, limits, limits])
        )
        if inner.middle is None or both.middle is None:
            return None
        following = polytope.intersection(both.shadow(model.states))
        if following.middle is None:
            return None
        following = following.reduced()
        if len(following.h) > MOST_ROWS:
            raise ValueError(f"allowed: more than {MOST_ROWS} rows after {step} steps")
        if inner.within(following):
            return InvariantSet(following, step)
        polytope = following
    raise ValueError(f"most_steps: no end after {most_steps} steps, {len(polytope.h)} rows")
