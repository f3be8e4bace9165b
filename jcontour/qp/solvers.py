"""QP solvers behind one small interface; every answer is checked before anyone sees it.

A solver's own flag is not trusted: at default tolerances some return wrong plans as solved. Each
answer's residuals are computed here, a bad one is polished once (equations on the active limits it
claims) or solved again from cold, and is `Unsolved` otherwise.
"""

import abc
import warnings
from typing import Any, NamedTuple

import daqp
import numpy as np
import proxsuite  # pyright: ignore[reportMissingImports]  # compiled, without stubs
import qpsolvers
from jaxtyping import Bool, Float

from jcontour._compiled import compiled
from jcontour.qp.problem import QP, RESIDUAL_LIMIT, Solution, Unsolved, check_shapes, residuals

REFINEMENTS = 3  # of the polished answer: each gains several digits, the third one none
# at 1e-9 controls of badly conditioned problems are off by 1e-6 of their limits
PROX_TOLERANCE = 1e-11
PROX_COLD_TOLERANCE = 1e-12
PROX_INFEASIBLE = 1e-7  # at 1e-4 it calls feasible problems infeasible
PROX_ITERATIONS = 200  # a feasible problem needs some tens
DAQP_TOLERANCE = 1e-10  # 1e-6 leaves limits violated
NAMED_SETTINGS: dict[str, dict[str, Any]] = {  # of qpsolvers' solvers that need tighter ones
    "proxqp": {"eps_abs": PROX_TOLERANCE, "eps_rel": 0.0}
}
DAQP_RETRIES = (  # polished, so these may be loose
    {"primal_tol": 1e-6, "eps_prox": 1e-4},
    {"primal_tol": 1e-8, "zero_tol": 1e-9},
)
FINE, NOT_FINITE, CROSSED, SHAPES = 0, 1, 2, 3  # what `_stack` finds
EQUATION = 5  # DAQP's sense of a row whose limits are equal
DAQP_STATUS = {
    -1: "infeasible",
    -2: "cycling",
    -3: "unbounded",
    -4: "iteration limit",
    -5: "not convex",
    -6: "dependent equations",
}


class Solver(abc.ABC):
    """A solver of one problem after another.

    Problems of a run have the same shapes, which lets it keep its memory. What it keeps may speed
    up the next answer, or change its last digits where the solver starts from the answer before
    (`ProxQP`); an answer passes the same check either way.
    """

    name: str

    @abc.abstractmethod
    def solve(self, qp: QP) -> Solution:
        """The minimiser, with every residual of `Solution` at most 1e-8.

        Raises:
            Unsolved: infeasible, unbounded, not finite, or no answer passed the check.
        """


class DAQP(Solver):
    """Dual active set (Arnström, Bemporad & Axehill 2022), the real-time choice.

    It starts from cold every time and is exact to rounding.
    """

    name = "daqp"

    def __init__(self):
        self._stacked = _Stacked()

    def solve(self, qp: QP) -> Solution:
        """See `Solver`.

        A failure is tried again with a proximal term and looser tolerances, and then polished.
        """
        lower, upper, sense = self._stacked.limits(self.name, qp)
        z, _, flag, info = daqp.solve(
            qp.H, qp.g, qp.C, upper, lower, sense, primal_tol=DAQP_TOLERANCE
        )
        if flag == 1:
            checked = _checked(self.name, qp, z, info["lam"], info["iterations"])
            if checked is not None:
                return checked
        candidates = [(z, info["lam"], info["iterations"])] * (flag > 0)
        for settings in DAQP_RETRIES:
            z, _, again, info = daqp.solve(qp.H, qp.g, qp.C, upper, lower, sense, **settings)
            candidates += [(z, info["lam"], info["iterations"])] * (again > 0)
        return _best_checked(self.name, DAQP_STATUS.get(flag, "inaccurate"), qp, candidates)


class ProxQP(Solver):
    """Primal-dual proximal augmented Lagrangian (Bambade et al. 2022), warm-started.

    It starts from the answer before, so its last digits depend on the problems it has seen.
    The objective is divided by its largest entry, so that the absolute tolerance means the same for
    every problem.
    """

    name = "proxqp"

    def __init__(self):
        self._stacked, self._warm, self._shape = _Stacked(), None, None

    def solve(self, qp: QP) -> Solution:
        """See `Solver`; a failure is tried once more from cold at a tighter tolerance."""
        self._stacked.limits(self.name, qp)
        size = max(np.abs(qp.H).max(initial=0.0), np.abs(qp.g).max(initial=0.0)) or 1.0
        if self._warm is None or self._shape != qp.C.shape:
            self._warm, self._shape = _prox_object(qp, size, PROX_TOLERANCE), qp.C.shape
        else:
            self._warm.settings.initial_guess = (
                proxsuite.proxqp.InitialGuess.WARM_START_WITH_PREVIOUS_RESULT
            )
            self._warm.update(**_prox_numbers(qp, size), update_preconditioner=False)
        status, answer = _prox_solved(self._warm, size)
        if status is None:
            checked = _checked(self.name, qp, *answer)
            if checked is not None:
                return checked
        self._warm = None
        second, cold = _prox_solved(_prox_object(qp, size, PROX_COLD_TOLERANCE), size)
        usable = (None, "max iter reached")
        candidates = [answer] if status in usable else []
        if second in usable:
            candidates.append(cold)
        return _best_checked(self.name, second or status or "inaccurate", qp, candidates)


class Named(Solver):
    """Any solver that qpsolvers knows and finds installed.

    Raises:
        ValueError: it is not installed.
    """

    def __init__(self, name: str):
        if name not in qpsolvers.available_solvers:
            known = ", ".join(sorted(qpsolvers.available_solvers))
            raise ValueError(f"solver: {name!r} is not installed; there are {known}")
        self.name, self._stacked = name, _Stacked()

    def solve(self, qp: QP) -> Solution:
        """See `Solver`."""
        self._stacked.limits(self.name, qp)
        parts = _Parts.of(qp)
        # Answer of the solver, not checked
        some, equal = parts.h.size > 0, parts.equal
        problem = qpsolvers.Problem(
            qp.H,
            qp.g,
            parts.G if some else None,
            parts.h if some else None,
            qp.C[equal] if equal.any() else None,
            qp.upper_rows[equal] if equal.any() else None,
            qp.lower,
            qp.upper,
        )
        settings = NAMED_SETTINGS.get(self.name, {})
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # qpsolvers warns of what the check finds
            try:
                solution = qpsolvers.solve_problem(problem, solver=self.name, **settings)
            except Exception as error:  # every backend has its own kind
                lines = str(error).splitlines() or [type(error).__name__]
                raise Unsolved(self.name, lines[0], qp) from error
        if solution.x is None or not solution.found:
            raise Unsolved(self.name, "infeasible or not converged", qp)
        multipliers = np.zeros(qp.g.size + len(qp.C))
        if solution.z_box is not None and np.size(solution.z_box):
            multipliers[: qp.g.size] = solution.z_box
        rows, count = multipliers[qp.g.size :], parts.above.sum()
        if parts.h.size and solution.z is not None and np.size(solution.z):
            rows[parts.above] += solution.z[:count]
            rows[parts.below] -= solution.z[count:]
        if parts.equal.any() and solution.y is not None:
            rows[parts.equal] = solution.y
        z = np.asarray(solution.x)
        return _best_checked(self.name, "inaccurate", qp, [(z, multipliers, 0)])


class _Parts(NamedTuple):
    """Rows as qpsolvers has them: equations, and inequalities G z <= h from above and below."""

    equal: Bool[np.ndarray, " r"]
    above: Bool[np.ndarray, " r"]
    below: Bool[np.ndarray, " r"]
    G: Float[np.ndarray, "q n"]
    h: Float[np.ndarray, " q"]

    @classmethod
    def of(cls, qp: QP) -> "_Parts":
        equal = qp.lower_rows == qp.upper_rows
        above = ~equal & np.isfinite(qp.upper_rows)
        below = ~equal & np.isfinite(qp.lower_rows)
        G = np.concatenate([qp.C[above], -qp.C[below]])
        h = np.concatenate([qp.upper_rows[above], -qp.lower_rows[below]])
        return cls(equal, above, below, G, h)


def solver_named(name: str) -> Solver:
    """The solver of that name, our own interfaces first.

    Raises:
        ValueError: there is none, or it is not installed.
    """
    own = {solver.name: solver for solver in (DAQP, ProxQP)}
    return own[name]() if name in own else Named(name)


def _best_checked(
    solver: str, status: str, qp: QP, candidates: list[tuple[np.ndarray, np.ndarray, int]]
) -> Solution:
    """The first answer (z, multipliers, iterations) that passes, as it is or polished."""
    best = (np.nan, np.nan, np.nan)
    for z, multipliers, iterations in candidates:
        for answer in ((z, multipliers), polished(qp, z, multipliers)):
            solution = _checked(solver, qp, *answer, iterations)
            if solution is not None:
                return solution
            other = residuals(qp, *answer)
            best = other if not max(best) <= max(other) else best
    raise Unsolved(solver, status, qp, best)


def polished(qp: QP, z: np.ndarray, multipliers: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The answer with the limits it holds active made equations, and refined.

        [H A'; A 0] (z, lambda) = (-g, b)
    A limit counts as active where the multiplier is larger than the distance to it (complementary
    slackness).
    """
    n = qp.g.size
    rows = np.concatenate([np.eye(n), qp.C])
    lower = np.concatenate([qp.lower, qp.lower_rows])
    upper = np.concatenate([qp.upper, qp.upper_rows])
    values = rows @ z
    size = max(1.0, np.abs(qp.g).max(initial=0.0))
    at_upper = (multipliers / size > np.abs(upper - values)) | (lower == upper)
    at_lower = (-multipliers / size > np.abs(values - lower)) & ~at_upper
    active = at_upper | at_lower
    A, b = rows[active], np.where(at_upper, upper, lower)[active]
    K = np.block([[qp.H, A.T], [A, np.zeros((len(b), len(b)))]])
    right = np.concatenate([-qp.g, b])
    if not np.isfinite(right).all():
        return z, multipliers
    answer = np.concatenate([z, multipliers[active]])
    for _ in range(REFINEMENTS):
        answer = answer + np.linalg.lstsq(K, right - K @ answer, rcond=None)[0]
    clean = np.zeros_like(multipliers)
    clean[active] = answer[n:]
    return answer[:n], clean


class _Stacked:
    """Limits of box and rows in one array, kept between problems of the same shape."""

    def __init__(self):
        self._shape = None

    def limits(self, solver: str, qp: QP):
        """(lower, upper, sense)."""
        if qp.C.shape != self._shape:
            check_shapes(qp)
            size = sum(qp.C.shape)
            self._lower, self._upper = np.empty(size), np.empty(size)
            self._sense = np.zeros(size, np.int32)
            self._shape = qp.C.shape
        wrong = _stack(qp, self._lower, self._upper, self._sense)
        if wrong == SHAPES:
            check_shapes(qp)
        if wrong == NOT_FINITE:
            raise Unsolved(
                solver, "the problem is not finite (NaN or inf in H, g or C, or NaN in a limit)", qp
            )
        if wrong == CROSSED:
            raise Unsolved(solver, "infeasible: limits are crossed", qp)
        return self._lower, self._upper, self._sense


@compiled
def _stack(qp: QP, all_lower, all_upper, sense) -> int:
    """Fill the stacked limits; FINE, NOT_FINITE, CROSSED or SHAPES."""
    H, g, C, lower_rows, upper_rows, lower, upper = qp
    n, r = g.size, lower_rows.size
    matrices = H.shape == (n, n) and C.shape == (r, n)
    limits = upper_rows.size == r and lower.size == n and upper.size == n
    if not (matrices and limits and all_lower.size == n + r):
        return SHAPES
    if not _finite(H, g, C):
        return NOT_FINITE
    for i in range(n + r):
        low, high = (lower[i], upper[i]) if i < n else (lower_rows[i - n], upper_rows[i - n])
        if low != low or high != high:
            return NOT_FINITE
        if low > high or low == np.inf or high == -np.inf:
            return CROSSED
        all_lower[i], all_upper[i] = low, high
        sense[i] = EQUATION if low == high else 0
    return FINE


@compiled
def _finite(H, g, C) -> bool:
    """Whether all entries are finite: zero times another is not zero."""
    total = 0.0
    for i in range(g.size):
        total += g[i] * 0.0
        for j in range(g.size):
            total += H[i, j] * 0.0
    for i in range(C.shape[0]):
        for j in range(g.size):
            total += C[i, j] * 0.0
    return total == 0.0


def _checked(solver: str, qp: QP, z, multipliers, iterations) -> Solution | None:
    primal, dual, gap = residuals(qp, z, multipliers)
    if primal <= RESIDUAL_LIMIT and dual <= RESIDUAL_LIMIT and gap <= RESIDUAL_LIMIT:
        return Solution(z, multipliers, primal, dual, gap, solver, iterations)
    return None


def _prox_numbers(qp: QP, size: float) -> dict[str, np.ndarray]:
    return dict(
        H=qp.H / size,
        g=qp.g / size,
        C=qp.C,
        l=qp.lower_rows,
        u=qp.upper_rows,
        l_box=qp.lower,
        u_box=qp.upper,
    )


def _prox_object(qp: QP, size: float, tolerance: float):
    r, n = qp.C.shape
    problem = proxsuite.proxqp.dense.QP(n, 0, r, True)
    problem.settings.eps_abs, problem.settings.eps_rel = tolerance, 0.0
    problem.settings.eps_primal_inf = PROX_INFEASIBLE
    problem.settings.eps_dual_inf = PROX_INFEASIBLE
    problem.settings.max_iter = PROX_ITERATIONS
    problem.settings.initial_guess = proxsuite.proxqp.InitialGuess.NO_INITIAL_GUESS
    problem.init(**_prox_numbers(qp, size), compute_preconditioner=True)
    return problem


def _prox_solved(problem, size: float):
    """(what is wrong or None, (z, multipliers, iterations))."""
    problem.solve()
    results, n = problem.results, problem.model.dim
    rows = results.z.size - n
    multipliers = size * np.concatenate([results.z[rows:], results.z[:rows]])
    status = None
    if results.info.status != proxsuite.proxqp.QPSolverOutput.PROXQP_SOLVED:
        status = results.info.status.name.removeprefix("PROXQP_").lower().replace("_", " ")
    return status, (np.array(results.x), multipliers, results.info.iter)
