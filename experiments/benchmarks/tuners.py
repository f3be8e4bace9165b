"""`jcontour bench tuners`: the tuner against searches without slopes, at equal budgets.

All begin at the same random points. An evaluation with slopes counts as three. What counts is how
many evaluations a search needs to come within 2 % of the best value that anything has found.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from rich.console import Console

from experiments.benchmarks.search_methods import METHODS, PACKAGES, Spent
from experiments.benchmarks.tuner_problems import PROBLEMS, measure_of, problem_of
from experiments.options import Bench
from experiments.reports import tables
from experiments.reports.png import save_figure
from experiments.reports.tuners_figure import Curve, tuners_figure
from tuning.history import FEASIBLE
from tuning.parameters import Chart, Weights
from tuning.problem import Problem
from tuning.tune import THOROUGH, TuneState, advance

OURS = "jcontour"
WITH_SLOPES = 3  # evaluations that one with slopes counts as
REACH = 7.0  # half width in ln(weight) of the box that is searched: three decades up and down
AWAY = 3.0  # half width of the box of first points
CLOSE = 1.02  # of the best value known
LARGEST_GRID = 2  # weights beyond which a grid is not tried
COUNTS = np.unique(np.geomspace(1, 10_000, 200).astype(int))  # evaluations at which curves are kept


@dataclass(frozen=True)
class TunerRow:
    """One search on one problem, over all seeds.

    Attributes:
        weights: number of them.
        reached: seeds that came within 2 % of the best value known.
        evaluations: to come there, quartiles and median; None where that many seeds did not.
        seconds: of the median seed, until there.
        best: best value known [um, or a ratio].
    """

    problem: str
    weights: int
    method: str
    seeds: int
    reached: int
    evaluations: tuple[float | None, float | None, float | None]
    seconds: float | None
    best: float


@dataclass(frozen=True)
class TunersBench:
    """One row for every search and problem."""

    budget: int
    rows: list[TunerRow]


@dataclass(frozen=True)
class Trace:
    """Best feasible value after every evaluation of one search from one start."""

    spent: Float[np.ndarray, " n"]
    best: Float[np.ndarray, " n"]
    seconds: Float[np.ndarray, " n"]

    def at(self, counts: np.ndarray) -> np.ndarray:
        """Best value within so many evaluations; infinite before the first."""
        index = np.searchsorted(self.spent, counts, side="right") - 1
        return np.where(index < 0, np.inf, self.best[np.maximum(index, 0)])

    def until(self, value: float) -> tuple[float, float]:
        """Evaluations and seconds to come to a value; infinite where it does not."""
        there = np.flatnonzero(self.best <= value)
        if there.size == 0:
            return np.inf, np.inf
        return float(self.spent[there[0]]), float(self.seconds[there[0]])


def measured(flags: Bench, tell: Callable[[str], None]) -> TunersBench:
    """Every search on every problem, from as many starts as are asked for.

    Raises:
        ValueError: a number is below one, or the libraries of the others are not installed.
    """
    for name in ("seeds", "evaluations"):
        if getattr(flags, name) < 1:
            raise ValueError(f"{name}: needs at least 1, received {getattr(flags, name)}")
    missing = [name for name in PACKAGES if find_spec(name) is None]
    if missing:
        raise ValueError(
            f"bench tuners: needs {', '.join(missing)}; run it as "
            "uv run --group bench jcontour bench tuners"
        )
    rows, curves = [], {}
    for name in PROBLEMS:
        traces = _traces(name, flags.seeds, flags.evaluations, tell)
        found, curves[name] = _summed_up(name, traces, flags.evaluations)
        rows += found
        for row in found:
            tell(_line(row))
    if flags.figure is not None:
        save_figure(tuners_figure(curves), Path(flags.figure))
    return TunersBench(flags.evaluations, rows)


def _traces(
    name: str, seeds: int, budget: int, tell: Callable[[str], None]
) -> dict[tuple[str, int], list[Trace]]:
    """Traces by method; the key holds the number of weights as well."""
    problem, start = problem_of(name)
    first = np.asarray(Chart(problem.space, start).coordinates())
    measure = measure_of(problem, start)
    measure(first)  # compiles
    _ours(problem, start, first, 0, 1)
    found: dict[tuple[str, int], list[Trace]] = {}
    for seed in range(seeds):
        away = np.random.default_rng(seed).uniform(-AWAY, AWAY, first.size)
        begin = first + away
        found.setdefault((OURS, first.size), []).append(_ours(problem, start, begin, seed, budget))
        for method in METHODS:
            if method != "grid" or first.size <= LARGEST_GRID:
                trace = _theirs(measure, method, begin, seed, budget)
                found.setdefault((method, first.size), []).append(trace)
        tell(f"{name}: start {seed + 1} of {seeds}")
    return found


def _ours(problem: Problem, start: Weights, begin: np.ndarray, seed: int, budget: int) -> Trace:
    weights = Chart(problem.space, start).weights(jnp.asarray(begin))
    effort = replace(THOROUGH, seed=seed, tolerance=1e-4)
    state, clock, times = TuneState(), time.perf_counter(), []
    while not state.done and WITH_SLOPES * len(state.history) < budget:
        state = advance(problem, weights, effort, state)
        times += [time.perf_counter() - clock] * (len(state.history) - len(times))
    values = [
        np.inf if row.diverged or row.violation > FEASIBLE else row.objective
        for row in state.history
    ]
    return _trace(values, WITH_SLOPES, times)


def _theirs(measure, method: str, begin: np.ndarray, seed: int, budget: int) -> Trace:
    values: list[float] = []
    times: list[float] = []
    clock = time.perf_counter()

    def counted(z: np.ndarray) -> float:
        if len(values) >= budget:
            raise Spent
        tried = measure(np.asarray(z, float))
        values.append(tried.objective)
        times.append(time.perf_counter() - clock)
        return tried.merit

    try:
        METHODS[method](counted, begin, REACH, seed)
    except Spent:
        pass
    return _trace(values, 1, times)


def _trace(values: Sequence[float], each: int, times: Sequence[float]) -> Trace:
    spent = each * np.arange(1.0, len(values) + 1)
    return Trace(spent, np.minimum.accumulate(np.asarray(values, float)), np.asarray(times, float))


def _summed_up(
    name: str, traces: dict[tuple[str, int], list[Trace]], budget: int
) -> tuple[list[TunerRow], dict[str, Curve]]:
    best = min(float(trace.best[-1]) for several in traces.values() for trace in several)
    if not np.isfinite(best):
        return _nowhere(name, traces), {}
    counts = COUNTS[COUNTS <= budget]
    rows, curves = [], {}
    for (method, weights), several in traces.items():
        until = np.array([trace.until(CLOSE * best) for trace in several])
        low, middle, high = np.quantile(until[:, 0], [0.25, 0.5, 0.75], method="inverted_cdf")
        seconds = np.quantile(until[:, 1], 0.5, method="inverted_cdf")
        rows.append(
            TunerRow(
                problem=name,
                weights=weights,
                method=method,
                seeds=len(several),
                reached=int(np.isfinite(until[:, 0]).sum()),
                evaluations=(_known(low), _known(middle), _known(high)),
                seconds=_known(seconds),
                best=best,
            )
        )
        relative = np.stack([trace.at(counts) for trace in several]) / best
        curves[method] = Curve(
            counts, *np.quantile(relative, [0.25, 0.5, 0.75], axis=0, method="inverted_cdf")
        )
    return rows, curves


def _nowhere(name: str, traces: dict[tuple[str, int], list[Trace]]) -> list[TunerRow]:
    """Rows of a problem in which no search has come within the limits."""
    nothing = (None, None, None)
    return [
        TunerRow(name, weights, method, len(several), 0, nothing, None, np.inf)
        for (method, weights), several in traces.items()
    ]


def _known(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _line(row: TunerRow) -> str:
    low, middle, high = (tables.digits(value) for value in row.evaluations)
    return (
        f"{row.problem}, {row.weights} weights, {row.method}: {middle} ({low} to {high}) "
        f"evaluations, {row.reached} of {row.seeds} starts"
    )


def show(console: Console, result: TunersBench) -> None:
    """Print the table."""
    columns = [
        "problem",
        "search",
        "weights",
        "starts that\narrive",
        "evaluations\nmedian",
        "quartiles",
        "seconds\nmedian",
    ]
    rows = []
    for row in result.rows:
        low, middle, high = (tables.digits(value) for value in row.evaluations)
        rows.append(
            [
                row.problem,
                row.method,
                str(row.weights),
                f"{row.reached} of {row.seeds}",
                middle,
                f"{low} to {high}",
                tables.digits(row.seconds),
            ]
        )
    title = (
        f"Evaluations to come within 2 % of the best value known, at most {result.budget}; "
        f"one with slopes counts {WITH_SLOPES}"
    )
    console.print(tables.plain_table(title, columns, rows, text_columns=2))
