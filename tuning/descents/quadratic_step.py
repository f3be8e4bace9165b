"""One step of sequential quadratic programming on a minimax under limits.

At z the errors e (g, v) and the limits c are known with their slopes E and C. The step d minimises

    mean over rows r of t_r + penalty s + 1/2 d' H d
    subject to   e[r, i] + E[r, i] d <= t_r,   c + C d <= s,   0 <= s,   low <= d <= high

so that it always exists. The penalty is raised until the step removes most of the excess of the
limits that its bounds allow to remove. The multipliers of the first rows are the shares of the
errors in the objective, those of the second are the prices of the limits.

Source: R. H. Byrd, J. Nocedal & R. A. Waltz, Steering exact penalty methods, Optimization Methods
and Software 23 (2008). Host side.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from jcontour.qp.problem import QP, Solution, Unsolved
from jcontour.qp.solvers import DAQP, ProxQP

NO_EXCESS = 1e-9  # of a limit: rounding of the runs
LEFT = 0.1  # part of the excess within reach that a step need not remove; less near the limits
HIGHER, HIGHEST = 10.0, 1e7  # factor between two penalties, and the last
SOFT = 1e-5  # curvature of t and s: the QP is strictly convex, and nothing that counts moves
STILL = 1e-4  # likewise of d where the excess alone is made small
FAR = 50.0  # in ln(error): no step changes an error by more


class Model(NamedTuple):
    """Errors and limits at a point, and their slopes in z."""

    errors: Float[np.ndarray, "g v"]  # logarithms of the objective's values, in rows
    limits: Float[np.ndarray, " c"]  # ln(value / limit)
    error_slopes: Float[np.ndarray, "g v d"]  # of the errors
    limit_slopes: Float[np.ndarray, "c d"]  # of the limits

    @property
    def objective(self) -> float:
        """Mean over rows of the largest error."""
        return float(np.mean(np.max(self.errors, axis=1)))

    @property
    def excess(self) -> float:
        """Largest violation of a limit; zero within them."""
        return float(np.max(self.limits, initial=0.0))

    def merit(self, penalty: float) -> float:
        """Objective plus the price of the excess."""
        return self.objective + penalty * self.excess

    def moved(self, d: Float[np.ndarray, " d"]) -> "Model":
        """The same lines at z + d."""
        return self._replace(
            errors=self.errors + self.error_slopes @ d, limits=self.limits + self.limit_slopes @ d
        )


class Step(NamedTuple):
    """Answer of the quadratic program."""

    d: Float[np.ndarray, " d"]  # step in z
    gain: float  # decrease of the merit that the model promises
    excess: float  # what the model leaves of the violation
    shares: Float[np.ndarray, "g v"]  # multipliers of the errors; every row sums to 1/g
    prices: Float[np.ndarray, " c"]  # multipliers of the limits
    penalty: float  # of the excess; not below the one given


def quadratic_step(
    model: Model,
    curvature: Float[np.ndarray, "d d"],
    low: Float[np.ndarray, " d"],
    high: Float[np.ndarray, " d"],
    penalty: float,
) -> Step:
    """The step d between its bounds.

    >>> line = Model(np.zeros((1, 1)), np.array([-0.5]), np.array([[[-1.0]]]), np.array([[1.0]]))
    >>> step = quadratic_step(line, np.array([[0.2]]), np.array([-2.0]), np.array([2.0]), 0.1)
    >>> step.d.round(9), step.prices.round(2)  # the limit stops it; without, another metre gains
    (array([0.5]), array([0.9]))
    >>> step.penalty  # a smaller one would let it pass the limit
    1.0

    Args:
        model: at the present point.
        curvature: H, positive definite.
        low: bounds of d that contain zero.
        high: likewise.
        penalty: of the excess, to begin with.

    Raises:
        Unsolved: no QP solver finds an answer.
    """
    step = _priced(model, curvature, low, high, penalty)
    if step.excess <= NO_EXCESS:
        return step
    least = least_excess(model, low, high)
    enough = least + min(LEFT, 10 * model.excess) * (model.excess - least)
    while step.excess > enough + 2 * NO_EXCESS and penalty < HIGHEST:
        penalty *= HIGHER
        step = _priced(model, curvature, low, high, penalty)
    return step


def _priced(model: Model, curvature, low, high, penalty: float) -> Step:
    """The step under a penalty; s is solved for over a scale of its own."""
    g, v = model.errors.shape
    c, n = model.limit_slopes.shape
    scale = max(model.excess, min(1.0, 1 / penalty))
    size = np.max(np.abs(model.limit_slopes), axis=1, initial=1e-9)
    tops = np.repeat(np.eye(g), v, axis=0)
    errors = [model.error_slopes.reshape(g * v, n), -tops, np.zeros((g * v, 1))]
    limits = [model.limit_slopes, np.zeros((c, g)), np.full((c, 1), -scale)]
    slack = np.repeat(np.max(model.errors, axis=1), v) - model.errors.ravel()
    H = SOFT * np.eye(n + g + 1)
    H[:n, :n] = curvature
    answer = _solved(
        H,
        np.concatenate([np.zeros(n), np.full(g, 1 / g), [penalty * scale]]),
        np.concatenate([np.hstack(errors), np.hstack(limits) / size[:, None]]),
        np.concatenate([slack, -model.limits / size]),
        np.concatenate([low, np.full(g, -FAR), [0.0]]),
        np.concatenate([high, np.full(g, FAR), [(1 + 2 * model.excess) / scale]]),
    )
    d = np.clip(answer.z[:n], low, high)
    multipliers = np.maximum(answer.multipliers[n + g + 1 :], 0.0)
    there = model.moved(d)
    gain = model.merit(penalty) - there.merit(penalty) - 0.5 * d @ curvature @ d
    shares, prices = multipliers[: g * v].reshape(g, v), multipliers[g * v :] / size
    return Step(d, float(gain), there.excess, shares, prices, penalty)


def least_excess(
    model: Model, low: Float[np.ndarray, " d"], high: Float[np.ndarray, " d"]
) -> float:
    """Smallest s >= 0 with c + C d <= s between the bounds.

    >>> line = Model(np.zeros((1, 1)), np.array([2.0]), np.zeros((1, 1, 1)), np.array([[1.0]]))
    >>> float(round(least_excess(line, np.array([-0.5]), np.array([0.5])), 9))
    1.5

    Raises:
        Unsolved: no QP solver finds an answer.
    """
    if model.excess <= NO_EXCESS:
        return 0.0
    return min(model.excess, model.moved(least_excess_step(model, low, high)).excess)


def least_excess_step(
    model: Model, low: Float[np.ndarray, " d"], high: Float[np.ndarray, " d"]
) -> Float[np.ndarray, " d"]:
    """The shortest step to the least excess between the bounds; s is solved for over that at z.

    Raises:
        Unsolved: no QP solver finds an answer.
    """
    excess, n = model.excess, low.size
    if excess <= NO_EXCESS:
        return np.zeros(n)
    answer = _solved(
        np.diag(np.concatenate([np.full(n, STILL), [1.0]])),
        np.concatenate([np.zeros(n), [1.0]]),
        np.hstack([model.limit_slopes / excess, -np.ones((model.limits.size, 1))]),
        -model.limits / excess,
        np.concatenate([low, [0.0]]),
        np.concatenate([high, [2.0]]),
    )
    return np.clip(answer.z[:n], low, high)


def _solved(H, g, C, upper_rows, low, high) -> Solution:
    qp = QP(H, g, C, np.full(upper_rows.size, -np.inf), upper_rows, low, high)
    try:
        return DAQP().solve(qp)
    except Unsolved:
        return ProxQP().solve(qp)
