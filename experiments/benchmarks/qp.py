"""`jcontour bench qp`: many quadratic programs of control at once, with their derivative.

Random problems of optimal control, 20 stages, 8 states, 4 controls, a box around the controls so
tight that half of them are at a limit. Beside it the solvers of the host, one problem after the
other, which have no derivative.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

from experiments.benchmarks.timings import seconds, timed
from experiments.tables import Table
from jcontour.app.flags.others import Bench
from jcontour.qp.interior_point import solve
from jcontour.qp.problem import QP
from jcontour.qp.solvers import DAQP, ProxQP
from jcontour.qp.staged import StagedQP, gradient, rollout

STAGES, STATES, CONTROLS = 20, 8, 4
BATCH = 128
ONE_BY_ONE = 128  # problems at most that a solver of the host is timed with
ROUNDS = 3  # of every problem of the host, the shortest counts
HALVINGS = 14  # of the limit's exponent, until half of the controls are at it
AT_LIMIT = 1e-6  # of a limit: nearer to it is at it


@dataclass(frozen=True)
class BatchTime:
    """Time of a batch of problems [ms]."""

    solver: str
    batch: int  # problems
    solving: float  # all of them
    # the same with the derivative of a number with all numbers of the problems; None without one
    with_slopes: float | None
    residual: float  # largest scaled one of the batch
    unsolved: int  # problems


@dataclass(frozen=True)
class QPBench:
    """One row for every solver and batch."""

    times: list[BatchTime]
    active: float  # part of the controls that is at a limit


def tables(result: QPBench) -> Iterator[Table]:
    """Times of the batches."""
    columns = {
        "solver": "solver",
        "problems": "batch",
        "solve ms": "solving:.4g",
        "with\nslopes ms": "with_slopes:.4g",
        "us per\nproblem": lambda row: f"{1e3 * row.solving / row.batch:.4g}",
        "worst\nresidual": "residual:.0e",
        "not\nsolved": "unsolved",
    }
    title = (
        f"{STAGES} stages, {STATES} states, {CONTROLS} controls, "
        f"{100 * result.active:.0f} % of them at a limit"
    )
    yield Table(title, result.times, columns)


def measured(flags: Bench, tell: Callable[[str], None]) -> QPBench:
    """Every batch at once, then the solvers of the host one by one."""
    times, active, batches = [], 0.0, flags.batch or (BATCH,)
    for batch in batches:
        qp, active = tight(random_problems(batch))
        answer = jax.jit(_solved)(qp)
        solving, slopes = (1e3 * timed(one, qp).running for one in (_solved, _slopes))
        worst, unsolved = float(jnp.max(answer.residual)), int(jnp.sum(~answer.solved))
        times.append(BatchTime("at once", batch, solving, slopes, worst, unsolved))
        tell(f"{batch} problems: {times[-1].solving:.4g} ms")
    few, _ = tight(random_problems(min(max(batches), ONE_BY_ONE)))
    problems = condensed(few)
    for solver in (DAQP(), ProxQP()):
        worst = max(solver.solve(one).residual for one in problems)
        calls = [partial(solver.solve, one) for one in problems]
        spent = 1e3 * sum(min(seconds(call) for _ in range(ROUNDS)) for call in calls)
        name = f"{solver.name}, one by one"
        times.append(BatchTime(name, len(problems), spent, None, worst, 0))
        tell(f"{name}: {spent:.4g} ms")
    return QPBench(times, active)


def rates(result: QPBench) -> dict[str, float]:
    """Problems per second by name, for `stored_results`."""
    named = {}
    for row in result.times:
        named[f"{row.solver}, {row.batch} problems, solve"] = 1e3 * row.batch / row.solving
        if row.with_slopes is not None:
            named[f"{row.solver}, {row.batch} problems, slopes"] = 1e3 * row.batch / row.with_slopes
    return named


def random_problems(batch: int) -> StagedQP:
    """Stable machines, a convex cost of states and controls, slopes and drift; no limits yet."""
    random = np.random.default_rng(0)
    n, p, v = STATES, CONTROLS, STATES + CONTROLS
    A = random.standard_normal((batch, n, n))
    A *= 0.98 / np.abs(np.linalg.eigvals(A)).max(axis=1)[:, None, None]
    root = random.standard_normal((batch, v, v))
    H = root @ root.swapaxes(1, 2) / v + 0.1 * np.eye(v)
    free = np.full((batch, STAGES, p), np.inf)
    parts = (
        A,
        random.standard_normal((batch, n, p)),
        0.1 * random.standard_normal((batch, STAGES, n)),
        3.0 * random.standard_normal((batch, n)),
        np.broadcast_to(H[:, None], (batch, STAGES, v, v)),
        random.standard_normal((batch, STAGES, v)),
        H[:, :n, :n],
        random.standard_normal((batch, n)),
        np.broadcast_to(np.eye(p, v, k=n), (batch, p, v)),
        -free,
        free,
        np.full((batch, p), np.inf),
    )
    return StagedQP(*map(jnp.asarray, parts))


def tight(qp: StagedQP) -> tuple[StagedQP, float]:
    """The problems with a limit at which half of the controls are, and the part that is."""
    low, high = jnp.full(qp.A.shape[0], -3.0), jnp.full(qp.A.shape[0], 2.0)
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        share = _share(qp, middle)
        low, high = jnp.where(share > 0.5, middle, low), jnp.where(share > 0.5, high, middle)
    return _limited(qp, high), float(jnp.mean(_share(qp, high)))


@jax.jit
def _share(qp: StagedQP, exponent):
    controls = _solved(_limited(qp, exponent)).trajectory.stages[:, :, STATES:]
    limit = 10.0 ** exponent[:, None, None]
    return jnp.mean(jnp.abs(controls) > limit * (1 - AT_LIMIT), axis=(1, 2))


def _limited(qp: StagedQP, exponent) -> StagedQP:
    limit = jnp.broadcast_to(10.0 ** exponent[:, None, None], qp.upper.shape)
    return qp._replace(lower=-limit, upper=limit)


def _solved(qp: StagedQP):
    return jax.vmap(solve)(qp)


def _slopes(qp: StagedQP):
    return jax.grad(lambda qp: jnp.sum(_solved(qp).trajectory.stages ** 2))(qp)


def condensed(qp: StagedQP) -> list[QP]:
    """The problems in the controls alone, as the solvers of the host take them."""

    def cost(controls, qp: StagedQP):
        at = rollout(qp, controls.reshape(STAGES, CONTROLS))
        linear = jnp.sum(qp.h * at.stages) + qp.h_end @ at.end
        slope = gradient(qp, at)
        return 0.5 * (jnp.sum(slope.stages * at.stages) + slope.end @ at.end + linear)

    start = jnp.zeros(STAGES * CONTROLS)
    H = np.array(jax.jit(jax.vmap(jax.hessian(cost), (None, 0)))(start, qp))
    g = np.array(jax.jit(jax.vmap(jax.grad(cost), (None, 0)))(start, qp))
    flat = [np.array(side).reshape(len(g), -1) for side in (qp.lower, qp.upper)]
    none = np.zeros((0, g.shape[1])), np.zeros(0), np.zeros(0)
    return [QP(H[k], g[k], *none, flat[0][k], flat[1][k]) for k in range(len(g))]
