"""Every solver against the others, and that nothing unsolved is ever returned as solved."""

import itertools

import numpy as np
import pytest
import qpsolvers

from jcontour.qp.problem import QP, Solution, Unsolved, residuals
from jcontour.qp.solvers import DAQP, Named, ProxQP, polished, solver_named

INF = np.inf
KINDS = [DAQP, ProxQP]
SOLVERS = {  # made in the test: pytest keeps its cases, and ProxQP's binding tells of what is left
    "DAQP": DAQP,
    "ProxQP": ProxQP,
    "Named daqp": lambda: Named("daqp"),
    "Named proxqp": lambda: Named("proxqp"),
}


def feasible(random: np.random.Generator) -> QP:
    """10-60 variables around a point that keeps to every limit.

    Some limits are tight, some infinite, some equations; H is at times singular.
    """
    n = int(random.integers(10, 61))
    r = int(random.integers(0, 2 * n))
    rank = n if random.random() < 0.7 else int(random.integers(1, n))
    M = random.standard_normal((n, rank)) * 10.0 ** random.uniform(-2, 2, (1, rank))
    C, z = random.standard_normal((r, n)), random.standard_normal(n)
    g = random.standard_normal(n) * 10.0 ** random.uniform(-2, 3)

    def room(size):
        return np.where(random.random(size) < 0.15, 0.0, random.exponential(1.0, size))

    lower, upper, value = z - room(n), z + room(n), C @ z
    equal = random.random(r) < 0.05
    lower_rows = np.where(equal, value, np.where(random.random(r) < 0.3, -np.inf, value - room(r)))
    upper_rows = np.where(equal, value, np.where(random.random(r) < 0.3, np.inf, value + room(r)))
    if rank == n:
        free = random.random(n) < 0.3
        lower, upper = np.where(free, -np.inf, lower), np.where(free, np.inf, upper)
    return QP(M @ M.T, g, C, lower_rows, upper_rows, lower, upper)


def infeasible(random: np.random.Generator) -> QP:
    """The same with limits that contradict each other by 1e-4 to 10, by a certificate of Farkas."""
    qp, margin = feasible(random), 10.0 ** random.uniform(-4, 1)
    n = qp.g.size
    if random.random() < 0.5:  # one row asks for more than the box can give
        row = random.standard_normal(n)
        C, none = np.vstack([qp.C, row]), np.append(qp.upper_rows, np.inf)
        return QP(
            qp.H,
            qp.g,
            C,
            np.append(qp.lower_rows, np.abs(row).sum() + margin),
            none,
            -np.ones(n),
            np.ones(n),
        )
    r = max(len(qp.C), 3)  # C z <= b with y' C = 0, y >= 0, y' b < 0
    C, b, y = random.standard_normal((r, n)), random.standard_normal(r), 0.1 + random.random(r)
    C[-1], b[-1] = -(y[:-1] @ C[:-1]) / y[-1], -(y[:-1] @ b[:-1]) / y[-1] - margin
    return QP(qp.H, qp.g, C, np.full(r, -np.inf), b, np.full(n, -np.inf), np.full(n, np.inf))


def benign(random, n=21, r=7):
    M = random.standard_normal((n, n))
    return QP(
        M @ M.T + np.eye(n),
        5 * random.standard_normal(n),
        random.standard_normal((r, n)),
        -np.ones(r),
        np.ones(r),
        np.full(n, -0.3),
        np.full(n, 0.3),
    )


def brute_force(qp: QP) -> np.ndarray:
    """The minimiser among the solutions of all active sets."""
    n = qp.g.size
    rows, low, high = (
        np.vstack([np.eye(n), qp.C]),
        np.append(qp.lower, qp.lower_rows),
        np.append(qp.upper, qp.upper_rows),
    )
    best, answer = INF, np.full(n, np.nan)
    for sides in itertools.product((0, 1, 2), repeat=len(rows)):
        active = np.flatnonzero(sides)
        if len(active) > n:
            continue
        A, b = rows[active], np.where(np.array(sides) == 1, low, high)[active]
        K = np.block([[qp.H, A.T], [A, np.zeros((len(b), len(b)))]])
        if not np.isfinite(b).all() or np.linalg.matrix_rank(K) < len(K):
            continue
        z = np.linalg.solve(K, np.append(-qp.g, b))[:n]
        values, cost = rows @ z, z @ qp.H @ z / 2 + qp.g @ z
        if (values >= low - 1e-10).all() and (values <= high + 1e-10).all() and cost < best:
            best, answer = cost, z
    return answer


@pytest.mark.parametrize("name", SOLVERS)
def test_against_all_active_sets(name):
    solver, random = SOLVERS[name](), np.random.default_rng(3)
    for _ in range(5):
        qp = benign(random, 3, 2)
        solution = solver.solve(qp)
        np.testing.assert_allclose(solution.z, brute_force(qp), rtol=0, atol=1e-7)
        assert (
            isinstance(solution, Solution)
            and solution.residual <= 1e-8
            and solution.solver == solver.name
        )
        assert residuals(qp, solution.z, solution.multipliers) == (
            solution.primal_residual,
            solution.dual_residual,
            solution.duality_gap,
        )


def test_solvers_agree():
    random, warm, daqp = np.random.default_rng(4), ProxQP(), DAQP()
    for _ in range(100):
        qp = benign(random)
        exact = daqp.solve(qp)
        np.testing.assert_allclose(warm.solve(qp).z, exact.z, rtol=0, atol=1e-6)
        np.testing.assert_allclose(warm.solve(qp).multipliers, exact.multipliers, rtol=0, atol=1e-5)


def counted(kind, problems):
    """(answers, failures) with every answer checked by definitions written out here.

    In long doubles: z' H z of a stiff problem loses 1e-8 of the scale in doubles.
    """
    solver, failures = kind(), 0
    for k, qp in enumerate(problems):
        try:
            actual = solver.solve(qp)
        except Unsolved:
            failures += 1
            continue
        z, n = actual.z.astype(np.longdouble), qp.g.size
        rows, low, high = (
            np.vstack([np.eye(n), qp.C]).astype(np.longdouble),
            np.append(qp.lower, qp.lower_rows),
            np.append(qp.upper, qp.upper_rows),
        )
        scale = max(
            1.0,
            *(
                np.abs(part).max(initial=0.0)
                for part in (qp.H @ z, qp.g, rows.T @ actual.multipliers)
            ),
        )
        forces = actual.multipliers
        bound = np.where(forces > 0, high, low)
        finite = np.isfinite(bound)
        gap = abs(z @ (qp.H @ z) + qp.g @ z + bound[finite] @ forces[finite])
        worst = (
            max(
                (rows @ z - high).max(),
                (low - rows @ z).max(),
                np.abs(qp.H @ z + qp.g + rows.T @ forces).max(),
                gap,
            )
            / scale
        )
        assert (
            worst <= 1.0001e-8 and np.abs(forces[~finite]).max(initial=0.0) <= 1.0001e-8 * scale
        ), f"problem {k} of {kind.__name__}"
    return len(problems) - failures, failures


def in_lots(make, count, seed, lot=1000):
    for first in range(0, count, lot):
        random = np.random.default_rng((seed, first))
        yield [make(random) for _ in range(min(lot, count - first))]


@pytest.mark.parametrize(("kind", "count"), [(DAQP, 400), (ProxQP, 30)])
def test_no_answer_with_a_larger_residual_is_returned(kind, count):
    failures = sum(counted(kind, lot)[1] for lot in in_lots(feasible, count, 11))
    assert failures <= 0.005 * count  # all have answers: an honest failure is rare


@pytest.mark.parametrize(("kind", "count"), [(DAQP, 400), (ProxQP, 30)])
def test_nothing_infeasible_is_solved(kind, count):
    assert [counted(kind, lot)[0] for lot in in_lots(infeasible, count, 12)] == [0] * len(
        range(0, count, 1000)
    )


def small(H, g, lower=-INF, upper=INF, C=(), rows=(-INF, INF)) -> QP:
    """A problem whose limits are one number, or one for each variable or row of C."""
    g = np.asarray(g, float)
    C = np.reshape(np.asarray(C, float), (-1, g.size))
    of_rows = (np.full(len(C), side, float) for side in rows)
    box = (np.full(g.size, side, float) for side in (lower, upper))
    return QP(np.asarray(H, float), g, C, *of_rows, *box)


@pytest.mark.parametrize("kind", KINDS)
def test_degenerate_problems(kind):
    """A flat direction, the same equation twice, a variable that is fixed, and no curvature."""
    twice, sums = [[1.0, 1.0], [2.0, 2.0]], [[1.0, 1.0]]
    for qp, wanted in (
        (small(np.diag([1.0, 0.0]), [-1.0, 1.0], lower=[-INF, -3.0]), [1.0, -3.0]),
        (small(np.eye(2), [0.0, 0.0], C=twice, rows=([1.0, 2.0], [1.0, 2.0])), [0.5, 0.5]),
        (small(np.eye(2), [1.0, 1.0], [2.0, -INF], [2.0, INF]), [2.0, -1.0]),
        (small(np.zeros((2, 2)), [1.0, -1.0], -1.0, 1.0, sums, (-0.5, 0.5)), [-1.0, 1.0]),
    ):
        np.testing.assert_allclose(kind().solve(qp).z, wanted, atol=1e-7)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("size", [1e-9, 1e-4, 1e4, 1e9])
def test_cost_of_any_size(kind, size):
    random = np.random.default_rng(5)
    for _ in range(10):
        qp = benign(random)
        scaled = kind().solve(qp._replace(H=size * qp.H, g=size * qp.g))
        np.testing.assert_allclose(scaled.z, DAQP().solve(qp).z, rtol=0, atol=1e-6)


@pytest.mark.parametrize("name", ["DAQP", "ProxQP", "Named daqp"])
def test_what_cannot_be_solved_says_so(name):
    solver, qp = SOLVERS[name](), benign(np.random.default_rng(6), 5, 2)
    broken = qp._replace(H=np.where(np.eye(5) > 0, np.nan, qp.H))
    for bad, words in (
        (broken, "not finite"),
        (qp._replace(g=qp.g * np.inf), "not finite"),
        (qp._replace(lower=qp.upper + 1), "crossed"),
        (qp._replace(upper_rows=qp.upper_rows * np.nan), "not finite"),
    ):
        with pytest.raises(Unsolved, match=words):
            solver.solve(bad)
    with pytest.raises(
        Unsolved, match=f"^{solver.name} did not solve the QP \\(5 variables, 2 rows\\): "
    ):
        solver.solve(qp._replace(lower_rows=np.full(2, 50.0), upper_rows=np.full(2, 60.0)))
    with pytest.raises(ValueError, match=r"^g|^H"):
        solver.solve(qp._replace(g=np.zeros(4)))
    assert solver.solve(qp).residual <= 1e-8  # and it goes on after all of this


@pytest.mark.parametrize("kind", KINDS)
def test_an_unbounded_problem(kind):
    with pytest.raises(Unsolved):
        kind().solve(small(np.diag([1.0, 0.0]), [1.0, 1.0]))


def test_shapes_may_change_between_problems():
    random = np.random.default_rng(7)
    for solver in (DAQP(), ProxQP()):
        for n, r in ((21, 7), (5, 0), (21, 7), (21, 8)):
            assert solver.solve(benign(random, n, r)).z.shape == (n,)


def test_polish_recovers_an_inaccurate_answer():
    qp = benign(np.random.default_rng(8))
    exact = DAQP().solve(qp)
    noise = 1e-5 * np.random.default_rng(9).standard_normal(qp.g.size)
    z, forces = polished(
        qp, exact.z + np.where(exact.multipliers[:21] == 0, noise, 0), exact.multipliers
    )
    np.testing.assert_allclose(z, exact.z, atol=1e-12)
    np.testing.assert_allclose(forces, exact.multipliers, atol=1e-11)


def test_names():
    assert isinstance(solver_named("daqp"), DAQP) and isinstance(solver_named("proxqp"), ProxQP)
    known = ", ".join(sorted(qpsolvers.available_solvers))
    with pytest.raises(ValueError, match=f"^solver: 'gurobi' is not installed; there are {known}$"):
        solver_named("gurobi")
