"""QP solvers behind one small interface; every answer is checked before anyone sees it.

A solver's own flag is not trusted: at default tolerances some return wrong plans as solved. Each
answer's residuals are computed here, a bad one is polished once (equations on the active limits it
claims) or solved again from cold, and is `Unsolved` otherwise.
"""

import abc
import warnings
from typing import Any

import daqp
import numpy as np
import proxsuite  # type: ignore  # compiled, without stubs
import qpsolvers

from jcontour.qp.compiled import compiled
from jcontour.qp.problem import QP, RESIDUAL_LIMIT, Solution, Unsolved, check_shapes, residuals

REFINEMENTS = 3  # of the polished answer: each gains several digits, the third one none
PROX_TOLERANCE = (
    1e-11  # at 1e-9 controls of badly conditioned problems are off by 1e-6 of their limits
)
NAMED_SETTINGS: dict[str, dict[str, Any]] = {
    "proxqp": {"eps_abs": PROX_TOLERANCE, "eps_rel": 0.0}
}  # of qpsolvers' solvers that need tighter ones
DAQP_RETRIES = (
    {"primal_tol": 1e-6, "eps_prox": 1e-4},
    {"primal_tol": 1e-8, "zero_tol": 1e-9},
)  # polished, so these may be loose
DAQP_STATUS = {
    -1: "infeasible",
    -2: "cycling",
    -3: "unbounded",
    -4: "iteration limit",
    -5: "not convex",
    -6: "dependent equations",
}


class Solver(abc.ABC):
    """Solves one problem after another; problems of a run have the same shapes, which lets it keep its memory."""

    name: str

    @abc.abstractmethod
    def solve(self, qp: QP) -> Solution:
        """The minimiser, with every residual of `Solution` at most 1e-8.

        Raises:
            Unsolved: infeasible, unbounded, not finite, or no answer passed the check.
        """


class DAQP(Solver):
    """Dual active set (Arnström, Bemporad & Axehill 2022), from cold every time: the real-time choice, exact to rounding."""

    name = "daqp"

    def __init__(self):
        self._stacked = _Stacked()

    def solve(self, qp: QP) -> Solution:
        """See `Solver`; a failure is tried again with a proximal term and looser tolerances, and then polished."""
        lower, upper, sense = self._stacked.limits(self.name, qp)
        z, _, flag, info = daqp.solve(
            qp.H, qp.g, qp.C, upper, lower, sense, primal_tol=1e-10
        )  # 1e-6 leaves limits violated
        if flag == 1:
            found = residuals(*qp, z, info["lam"])
            if (
                found[0] <= RESIDUAL_LIMIT
                and found[1] <= RESIDUAL_LIMIT
                and found[2] <= RESIDUAL_LIMIT
            ):
                return Solution(z, info["lam"], *found, self.name, info["iterations"])
        candidates = [(z, info["lam"], info["iterations"])] * (flag > 0)
        for settings in DAQP_RETRIES:
            z, _, again, info = daqp.solve(qp.H, qp.g, qp.C, upper, lower, sense, **settings)
            candidates += [(z, info["lam"], info["iterations"])] * (again > 0)
        return best_checked(self.name, DAQP_STATUS.get(flag, "inaccurate"), qp, candidates)


class ProxQP(Solver):
    """Primal-dual proximal augmented Lagrangian (Bambade et al. 2022), warm-started from the answer before.

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
        status, answer = self._continued(qp, size)
        if status is None:
            checked = _checked(self.name, qp, *answer)
            if checked is not None:
                return checked
        self._warm = None
        second, cold = _prox_solved(_prox_object(qp, size, 1e-12), size)
        candidates = [
            a for s, a in ((status, answer), (second, cold)) if s in (None, "max iter reached")
        ]
        return best_checked(self.name, second or status or "inaccurate", qp, candidates)

    def _continued(self, qp: QP, size: float):
        if self._warm is None or self._shape != qp.C.shape:
            self._warm, self._shape = _prox_object(qp, size, PROX_TOLERANCE), qp.C.shape
        else:
            self._warm.settings.initial_guess = (
                proxsuite.proxqp.InitialGuess.WARM_START_WITH_PREVIOUS_RESULT
            )
            self._warm.update(**_prox_numbers(qp, size), update_preconditioner=False)
        return _prox_solved(self._warm, size)


class Named(Solver):
    """Any solver that qpsolvers knows and finds installed.

    Raises:
        ValueError: it is not installed.
    """

    def __init__(self, name: str):
        if name not in qpsolvers.available_solvers:
            raise ValueError(
                f"solver: {name!r} is not installed; there are {', '.join(sorted(qpsolvers.available_solvers))}"
            )
        self.name, self._stacked = name, _Stacked()

    def solve(self, qp: QP) -> Solution:
        """See `Solver`."""
        self._stacked.limits(self.name, qp)
        equal = qp.lower_rows == qp.upper_rows
        above, below = ~equal & np.isfinite(qp.upper_rows), ~equal & np.isfinite(qp.lower_rows)
        G = np.concatenate([qp.C[above], -qp.C[below]])
        h = np.concatenate([qp.upper_rows[above], -qp.lower_rows[below]])
        problem = qpsolvers.Problem(
            qp.H,
            qp.g,
            G if h.size else None,
            h if h.size else None,
            qp.C[equal] if equal.any() else None,
            qp.upper_rows[equal] if equal.any() else None,
            qp.lower,
            qp.upper,
        )
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # qpsolvers warns of what the check below finds
            try:
                found = qpsolvers.solve_problem(
                    problem, solver=self.name, **NAMED_SETTINGS.get(self.name, {})
                )
            except Exception as error:  # every backend has its own kind
                raise Unsolved(
                    self.name,
                    str(error).splitlines()[0] if str(error) else type(error).__name__,
                    qp,
                ) from error
        if found.x is None or not found.found:
            raise Unsolved(self.name, "infeasible or not converged", qp)
        multipliers = np.zeros(qp.g.size + equal.size)
        if found.z_box is not None and np.size(found.z_box):
            multipliers[: qp.g.size] = found.z_box
        rows = multipliers[qp.g.size :]
        if h.size and found.z is not None and np.size(found.z):
            rows[above] += found.z[: above.sum()]
            rows[below] -= found.z[above.sum() :]
        if equal.any() and found.y is not None:
            rows[equal] = found.y
        return best_checked(self.name, "inaccurate", qp, [(found.x, multipliers, 0)])


def solver_named(name: str) -> Solver:
    """The solver of that name, our own interfaces first.

    Raises:
        ValueError: there is none, or it is not installed.
    """
    own = {solver.name: solver for solver in (DAQP, ProxQP)}
    return own[name]() if name in own else Named(name)


def best_checked(
    solver: str, status: str, qp: QP, candidates: list[tuple[np.ndarray, np.ndarray, int]]
) -> Solution:
    """The first answer (z, multipliers, iterations) that passes, as it is or polished.

    Raises:
        Unsolved: none does.
    """
    best = (np.nan, np.nan, np.nan)
    for z, multipliers, iterations in candidates:
        for answer in ((z, multipliers), polished(qp, z, multipliers)):
            solution = _checked(solver, qp, *answer, iterations)
            if solution is not None:
                return solution
            found = residuals(*qp, *answer)
            best = found if not max(best) <= max(found) else best
    raise Unsolved(solver, status, qp, best)


def polished(qp: QP, z: np.ndarray, multipliers: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The answer with the limits it holds active made equations: [H A'; A 0] (z, lambda) = (-g, b), refined.

    A limit counts as active where the multiplier is larger than the distance to it (complementary
    slackness).
    """
    n = qp.g.size
    rows = np.concatenate([np.eye(n), qp.C])
    lower, upper = (
        np.concatenate([qp.lower, qp.lower_rows]),
        np.concatenate([qp.upper, qp.upper_rows]),
    )
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
        """(lower, upper, sense) with sense 5 for an equation.

        Raises:
            ValueError: an array has the wrong shape.
            Unsolved: a number is NaN, an entry of H, g or C is infinite, or limits are crossed.
        """
        if qp.C.shape != self._shape:
            check_shapes(qp)
            size = sum(qp.C.shape)
            self._lower, self._upper, self._sense = (
                np.empty(size),
                np.empty(size),
                np.zeros(size, np.int32),
            )
            self._shape = qp.C.shape
        wrong = _stack(*qp, self._lower, self._upper, self._sense)
        if wrong == 3:
            check_shapes(qp)
        if wrong == 1:
            raise Unsolved(
                solver, "the problem is not finite (NaN or inf in H, g or C, or NaN in a limit)", qp
            )
        if wrong == 2:
            raise Unsolved(solver, "infeasible: limits are crossed", qp)
        return self._lower, self._upper, self._sense


@compiled
def _stack(H, g, C, lower_rows, upper_rows, lower, upper, all_lower, all_upper, sense) -> int:
    """Fill the stacked limits; 1: not finite, 2: crossed, 3: shapes, 0: fine."""
    n, r = g.size, lower_rows.size
    if (
        H.shape != (n, n)
        or C.shape != (r, n)
        or upper_rows.size != r
        or lower.size != n
        or upper.size != n
        or all_lower.size != n + r
    ):
        return 3
    total = 0.0
    for i in range(n):
        total += g[i] * 0.0
        for j in range(n):
            total += H[i, j] * 0.0
    for i in range(r):
        for j in range(n):
            total += C[i, j] * 0.0
    if total != 0.0:
        return 1
    for i in range(n + r):
        low, high = (lower[i], upper[i]) if i < n else (lower_rows[i - n], upper_rows[i - n])
        if low != low or high != high:
            return 1
        if low > high or low == np.inf or high == -np.inf:
            return 2
        all_lower[i], all_upper[i], sense[i] = low, high, 5 if low == high else 0
    return 0


def _checked(solver: str, qp: QP, z, multipliers, iterations) -> Solution | None:
    found = residuals(*qp, z, multipliers)
    if all(value <= RESIDUAL_LIMIT for value in found):
        return Solution(z, multipliers, *found, solver, iterations)
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
    problem.settings.eps_primal_inf = problem.settings.eps_dual_inf = (
        1e-7  # at 1e-4 it calls feasible problems infeasible
    )
    problem.settings.max_iter = 200  # a feasible problem needs some tens
    problem.settings.initial_guess = proxsuite.proxqp.InitialGuess.NO_INITIAL_GUESS
    problem.init(**_prox_numbers(qp, size), compute_preconditioner=True)
    return problem


def _prox_solved(problem, size: float):
    """(what is wrong or None, (z, multipliers, iterations))."""
    problem.solve()
    results, n = problem.results, problem.model.dim
    rows = results.z.size - n
    multipliers = size * np.concatenate([results.z[rows:], results.z[:rows]])
    solved = results.info.status == proxsuite.proxqp.QPSolverOutput.PROXQP_SOLVED
    status = (
        None
        if solved
        else results.info.status.name.removeprefix("PROXQP_").lower().replace("_", " ")
    )
    return status, (np.array(results.x), multipliers, results.info.iter)
