"""One step of sequential quadratic programming on a minimax under limits.

At z the errors e (g, v) and the limits c are known with their slopes E and C. The step d minimises

    mean over rows r of t_r + 1/2 d' H d
    subject to   e[r, i] + E[r, i] d <= t_r,   c + C d <= s,   low <= d <= high

with s the least excess that the bounds allow, or a little more where z is not within its limits:
max(0, c + C d) is made small first. The multipliers of the first rows are the shares of the errors
in the objective, those of the second are the prices of the limits.

Source: R. Fletcher & S. Leyffer, Nonlinear programming without a penalty function, Mathematical
Programming 91 (2002). Host side.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from jcontour.qp.problem import QP, Solution, Unsolved
from jcontour.qp.solvers import DAQP, ProxQP

NO_EXCESS = 1e-9  # of a limit: rounding of the runs
LOOSE = 0.1  # part of an excess that a step need not remove, for the objective's sake
SOFT = 1e-5  # curvature of t, which makes the QP strictly convex and moves nothing that counts
STILL = 1e-4  # likewise of d where the excess alone is made small
FAR = 50.0  # in ln(error): no step changes an error by more


class Model(NamedTuple):
    """Errors and limits at a point, and their slopes in z.

    Attributes:
        errors: logarithms of the objective's values, in rows.
        limits: ln(value / limit).
        error_slopes: of the errors.
        limit_slopes: of the limits.
    """

    errors: Float[np.ndarray, "g v"]
    limits: Float[np.ndarray, " c"]
    error_slopes: Float[np.ndarray, "g v d"]
    limit_slopes: Float[np.ndarray, "c d"]

    @property
    def objective(self) -> float:
        """Mean over rows of the largest error."""
        return float(np.mean(np.max(self.errors, axis=1)))

    @property
    def excess(self) -> float:
        """Largest violation of a limit; zero within them."""
        return float(np.max(self.limits, initial=0.0))

    def moved(self, d: Float[np.ndarray, " d"]) -> "Model":
        """The same lines at z + d."""
        return self._replace(
            errors=self.errors + self.error_slopes @ d, limits=self.limits + self.limit_slopes @ d
        )


class Step(NamedTuple):
    """Answer of the quadratic program.

    Attributes:
        d: step in z.
        gain: decrease of the objective that the model promises; negative where the limits cost.
        excess: what the model leaves of the violation.
        shares: multipliers of the errors; every row sums to 1/g.
        prices: multipliers of the limits.
    """

    d: Float[np.ndarray, " d"]
    gain: float
    excess: float
    shares: Float[np.ndarray, "g v"]
    prices: Float[np.ndarray, " c"]


def quadratic_step(
    model: Model,
    curvature: Float[np.ndarray, "d d"],
    low: Float[np.ndarray, " d"],
    high: Float[np.ndarray, " d"],
) -> Step:
    """The step d between its bounds.

    >>> line = Model(np.zeros((1, 1)), np.array([-0.5]), np.array([[[-1.0]]]), np.array([[1.0]]))
    >>> step = quadratic_step(line, np.array([[0.2]]), np.array([-2.0]), np.array([2.0]))
    >>> step.d.round(9), step.prices.round(2)  # the limit stops it; without, another metre gains
    (array([0.5]), array([0.9]))

    Args:
        model: at the present point.
        curvature: H, positive definite.
        low: bounds of d that contain zero.
        high: likewise.

    Raises:
        Unsolved: no QP solver finds an answer.
    """
    excess = model.excess
    reached = _least_excess(model, low, high)
    allowed = reached + min(LOOSE, 10 * excess) * max(excess - reached, 0.0) + 1e-8 * excess
    g, v = model.errors.shape
    n = low.size
    size = np.max(np.abs(model.limit_slopes), axis=1, initial=1e-9)
    tops = np.repeat(np.eye(g), v, axis=0)
    errors = np.hstack([model.error_slopes.reshape(g * v, n), -tops])
    limits = np.hstack([model.limit_slopes / size[:, None], np.zeros((size.size, g))])
    room = np.repeat(np.max(model.errors, axis=1), v) - model.errors.ravel()
    H = np.zeros((n + g, n + g))
    H[:n, :n] = curvature
    H[n:, n:] = SOFT * np.eye(g)
    answer = _solved(
        H,
        np.concatenate([np.zeros(n), np.full(g, 1 / g)]),
        np.concatenate([errors, limits]),
        np.concatenate([room, (allowed + NO_EXCESS - model.limits) / size]),
        np.concatenate([low, np.full(g, -FAR)]),
        np.concatenate([high, np.full(g, FAR)]),
    )
    d = np.clip(answer.z[:n], low, high)
    multipliers = np.maximum(answer.multipliers[n + g :], 0.0)
    gain = model.objective - model.moved(d).objective - 0.5 * d @ curvature @ d
    shares = multipliers[: g * v].reshape(g, v)
    return Step(d, float(gain), reached, shares, multipliers[g * v :] / size)


def _least_excess(model: Model, low, high) -> float:
    """Smallest s >= 0 with c + C d <= s between the bounds; solved for s over the excess at z."""
    excess, n = model.excess, low.size
    if excess <= NO_EXCESS:
        return 0.0
    answer = _solved(
        np.diag(np.concatenate([np.full(n, STILL), [1.0]])),
        np.concatenate([np.zeros(n), [1.0]]),
        np.hstack([model.limit_slopes / excess, -np.ones((model.limits.size, 1))]),
        -model.limits / excess,
        np.concatenate([low, [0.0]]),
        np.concatenate([high, [2.0]]),
    )
    d = np.clip(answer.z[:n], low, high)
    return min(excess, model.moved(d).excess)


def _solved(H, g, C, upper_rows, low, high) -> Solution:
    qp = QP(H, g, C, np.full(upper_rows.size, -np.inf), upper_rows, low, high)
    try:
        return DAQP().solve(qp)
    except Unsolved:
        return ProxQP().solve(qp)
