"""A quadratic program, and how well an answer solves it.

minimise  1/2 z' H z + g' z    subject to    lower <= z <= upper,    lower_rows <= C z <= upper_rows

With one multiplier per bound, box first and rows after it, (mu, lambda), an answer is optimal when

    H z + g + mu + C' lambda = 0                          (dual residual)
    the limits hold                                       (primal residual)
    z' H z + g' z + sum of multiplier times bound = 0     (duality gap)
A multiplier is positive where the upper limit is active and negative where the lower one is.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from jcontour._compiled import compiled

RESIDUAL_LIMIT = 1e-8  # of every scaled residual of an answer that counts as solved
# asymmetry of H, and negative curvature, relative to its largest entry: rounding of a product of
# matrices
SYMMETRY = 1e-9


class QP(NamedTuple):
    """The numbers of one problem; limits may be infinite, equal limits make an equation."""

    H: Float[np.ndarray, "n n"]
    g: Float[np.ndarray, " n"]
    C: Float[np.ndarray, "r n"]
    lower_rows: Float[np.ndarray, " r"]
    upper_rows: Float[np.ndarray, " r"]
    lower: Float[np.ndarray, " n"]
    upper: Float[np.ndarray, " n"]


class Solution(NamedTuple):
    """An answer that passed its check."""

    z: Float[np.ndarray, " n"]  # the minimiser (n,)
    # box, then rows (n + r,); positive at an upper limit, negative at a lower one
    multipliers: Float[np.ndarray, " n+r"]
    # largest violation of a limit b, over min(max(1, s), max(1, |b|)); s is below
    primal_residual: float
    # largest entry of H z + g + mu + C' lambda, or of a multiplier whose limit is infinite, over s
    dual_residual: float
    # |z' H z + g' z + sum of multiplier times bound| over s = max(min(1, |H|), |H z|, |g|, |mu + C'
    # lambda|), largest entries; |H| instead of 1 where it is smaller, or a cost in small units
    # would pass with any answer
    duality_gap: float
    solver: str  # who solved it
    iterations: int  # of that solver

    @property
    def residual(self) -> float:
        """The largest of the three."""
        return max(self.primal_residual, self.dual_residual, self.duality_gap)


class Unsolved(RuntimeError):
    """A problem without an answer that passes the check; it carries the problem.

    Attributes:
        qp: a copy of the problem.
        status: what the solver said, or what is wrong with its answer.
        residuals: (primal, dual, gap) of the best answer; NaN when there is none.
        step: control step at which it happened, once `loop` has filled it in.
    """

    def __init__(
        self,
        solver: str,
        status: str,
        qp: QP,
        residuals: tuple[float, float, float] = (np.nan, np.nan, np.nan),
    ):
        self.solver, self.status, self.residuals = solver, status, residuals
        self.step: int | None = None
        self.qp = QP(*(np.array(field) for field in qp))
        super().__init__(solver, status)

    def __str__(self) -> str:
        where = "" if self.step is None else f"step {self.step}: "
        sizes = f"{self.qp.g.size} variables, {self.qp.lower_rows.size} rows"
        numbers = ""
        if not np.isnan(self.residuals).all():
            numbers = "; residuals primal {:.2g}, dual {:.2g}, gap {:.2g}".format(*self.residuals)
        return f"{where}{self.solver} did not solve the QP ({sizes}): {self.status}{numbers}"


def check_shapes(qp: QP) -> None:
    """Raise ValueError, naming the field, unless all arrays fit `g` (n,) and `lower_rows` (r,)."""
    n, r = qp.g.size, qp.lower_rows.size
    needed = {
        "H": (n, n),
        "g": (n,),
        "C": (r, n),
        "lower_rows": (r,),
        "upper_rows": (r,),
        "lower": (n,),
        "upper": (n,),
    }
    for name, shape in needed.items():
        if getattr(qp, name).shape != shape:
            raise ValueError(f"{name}: needs shape {shape}, received {getattr(qp, name).shape}")


def check_limits(name: str, lower, upper) -> None:
    """Raise ValueError unless lower <= upper, with room for a number in between.

    There is none next to NaN, above +inf or below -inf.
    """
    low, high = np.broadcast_arrays(lower, upper)
    crossed = ~(low <= high) | (low == np.inf) | (high == -np.inf)
    if crossed.any():
        i = int(np.argmax(crossed))
        raise ValueError(
            f"{name}: the limits need lower <= upper, "
            f"received {low.flat[i]} and {high.flat[i]} in entry {i}"
        )


def check_weight(name: str, weight: np.ndarray) -> None:
    """Raise ValueError unless a square matrix is finite, symmetric and positive semidefinite.

    Symmetric and semidefinite up to rounding.
    """
    if weight.ndim != 2 or weight.shape[0] != weight.shape[1]:
        raise ValueError(f"{name}: needs to be square, received {weight.shape}")
    if not np.isfinite(weight).all():
        raise ValueError(f"{name}: every entry needs to be finite, received NaN or inf")
    size = np.abs(weight).max(initial=0.0)
    asymmetry = np.abs(weight - weight.T).max(initial=0.0)
    if asymmetry > SYMMETRY * size:
        raise ValueError(f"{name}: needs to be symmetric, received an asymmetry of {asymmetry:.3g}")
    lowest = np.linalg.eigvalsh(weight).min(initial=0.0)
    if lowest < -SYMMETRY * size:
        raise ValueError(
            f"{name}: needs to be positive semidefinite, received an eigenvalue of {lowest:.3g}"
        )


@compiled
def residuals(qp: QP, z, multipliers) -> tuple[float, float, float]:
    """Scaled primal residual, dual residual and duality gap of an answer, see `Solution`."""
    H, g, C, lower_rows, upper_rows, lower, upper = qp
    n = g.size
    pull, values = multipliers[:n].copy(), np.empty(multipliers.size)
    _add_rows(C, z, multipliers, pull, values)
    dual, gap, scale = _stationarity(H, g, z, pull, values)
    allowance = max(1.0, scale)
    primal, orphan = 0.0, 0.0
    for i in range(values.size):
        low, high = (lower[i], upper[i]) if i < n else (lower_rows[i - n], upper_rows[i - n])
        force = multipliers[i]
        primal = _larger(primal, (values[i] - high) / min(allowance, max(1.0, abs(high))))
        primal = _larger(primal, (low - values[i]) / min(allowance, max(1.0, abs(low))))
        bound = high if force > 0 else low
        if force == 0:
            continue
        if np.isinf(bound):
            orphan = _larger(orphan, abs(force))
        else:
            gap += force * bound
    return primal, _larger(dual, orphan) / scale, abs(gap) / scale


@compiled
def _add_rows(C, z, multipliers, pull, values):
    """Write the values C z of the rows, and add C' lambda to `pull`."""
    r, n = C.shape
    for i in range(r):
        value, force = 0.0, multipliers[n + i]
        for j in range(n):
            value += C[i, j] * z[j]
        if force != 0:
            for j in range(n):
                pull[j] += C[i, j] * force
        values[n + i] = value


@compiled
def _stationarity(H, g, z, pull, values):
    """|H z + g + pull|, z' H z + g' z and the scale of both; writes z into `values`."""
    scale, dual, gap, size = 0.0, 0.0, 0.0, 0.0
    for i in range(g.size):
        Hz = 0.0
        for j in range(g.size):
            Hz += H[i, j] * z[j]
        size = _larger(size, abs(H[i, i]))  # the largest entry of a PSD matrix is on its diagonal
        values[i] = z[i]
        gap += z[i] * (Hz + g[i])
        dual = _larger(dual, abs(Hz + g[i] + pull[i]))
        scale = _larger(_larger(_larger(scale, abs(Hz)), abs(g[i])), abs(pull[i]))
    scale = _larger(scale, min(1.0, size))
    return dual, gap, scale if scale != 0 else 1.0


@compiled
def _larger(a, b):
    """The larger of two numbers, NaN if either is."""
    return b if (b > a or b != b) else a
