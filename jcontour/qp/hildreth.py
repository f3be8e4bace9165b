"""Hildreth's dual coordinate ascent: the solver of the papers, for comparison only.

With P = A H^-1 A' over box and rows, A = [I; C], the multipliers are improved one at a time until
none moves:

    lambda_i <- lambda_i + (a_i' z - b_i) / P_ii,     b_i the limit it would push against, zero
    where it would pull; z = -H^-1 (g + A' lambda)
Hildreth (1957); Wang, Model Predictive Control System Design (2009), 2.4.4, here with both limits
of a row under one multiplier.
"""

import numpy as np

from jcontour._compiled import compiled
from jcontour.qp.problem import QP, Solution, Unsolved, check_shapes
from jcontour.qp.solvers import Solver, best_checked

SWEEPS = 20_000  # the ascent slows down where active rows are nearly parallel
TOLERANCE = 1e-13  # of the movement of the values a_i' z in one sweep, relative


class Hildreth(Solver):
    """Needs a positive definite H; slow where limits are nearly dependent."""

    name = "hildreth"

    def solve(self, qp: QP) -> Solution:
        """See `Solver`."""
        check_shapes(qp)
        if not all(np.isfinite(field).all() for field in qp[:3]) or any(
            np.isnan(field).any() for field in qp[3:]
        ):
            raise Unsolved(self.name, "the problem is not finite", qp)
        if (qp.lower > qp.upper).any() or (qp.lower_rows > qp.upper_rows).any():
            raise Unsolved(self.name, "infeasible: limits are crossed", qp)
        try:
            np.linalg.cholesky(qp.H)
        except np.linalg.LinAlgError:
            raise Unsolved(self.name, "H is not positive definite", qp) from None
        z, multipliers, sweeps = ascent(*qp)
        status = "infeasible, or slow to converge" if sweeps == SWEEPS else "inaccurate"
        return best_checked(self.name, status, qp, [(z, multipliers, sweeps)])


def ascent(H, g, C, lower_rows, upper_rows, lower, upper) -> tuple[np.ndarray, np.ndarray, int]:
    """(z, multipliers, sweeps made)."""
    A = np.concatenate([np.eye(g.size), C])
    low, high = np.concatenate([lower, lower_rows]), np.concatenate([upper, upper_rows])
    answer = np.linalg.solve(H, np.concatenate([A.T, g[:, None]], axis=1))
    step, start = answer[:, :-1], -answer[:, -1]  # columns H^-1 a_i, and the free minimum
    multipliers, values = np.zeros(len(A)), A @ start
    sweeps = _climb(np.ascontiguousarray(A @ step), low, high, multipliers, values)
    return start - step @ multipliers, multipliers, sweeps


@compiled
def _climb(P, low, high, multipliers, values) -> int:
    """Sweep until nothing moves; multipliers and values a_i' z change in place."""
    for sweep in range(1, SWEEPS + 1):
        moved, largest = 0.0, 0.0
        for i in range(values.size):
            if P[i, i] <= 0:
                continue
            old = multipliers[i]
            push, pull = old + (values[i] - high[i]) / P[i, i], old + (values[i] - low[i]) / P[i, i]
            new = push if push > 0 else (pull if pull < 0 else 0.0)
            if new != old:
                for k in range(values.size):
                    values[k] -= P[k, i] * (new - old)
                moved = max(moved, abs(new - old) * P[i, i])
                multipliers[i] = new
            largest = max(largest, abs(values[i]))
        if moved <= TOLERANCE * (1 + largest):
            return sweep
    return SWEEPS
