"""`jcontour bench tuners`: the tuner against searches without slopes, at equal budgets.

All begin at the same random points. An evaluation with slopes counts as three. What counts is how
many evaluations a search needs to come within 2 % of the best value that anything has found.
"""

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from importlib.util import find_spec
from itertools import groupby, product
from pathlib import Path

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from experiments.benchmarks.kept_rows import kept
from experiments.benchmarks.searches.search_methods import METHODS, PACKAGES, Spent
from experiments.benchmarks.searches.tuner_problems import (
    PROBLEMS,
    looks_at,
    measure_of,
    problem_of,
)
from experiments.benchmarks.searches.tuners_figure import Curve, tuners_figure
from experiments.tables import Column, Table
from jcontour.app.flags.others import Bench
from jcontour.app.reports.figures.png import save_figure
from jcontour.app.reports.tables import digits
from tuning.effort import THOROUGH, Effort
from tuning.history import FEASIBLE, Evaluated
from tuning.parameters import Chart, Weights
from tuning.point import evaluate_point, evaluate_values
from tuning.problem import Problem
from tuning.tuner import TuneState, advance

OURS = "jcontour"
WITH_SLOPES = 3  # evaluations that one with slopes counts as
REACH = 7.0  # half width in ln(weight) of the box that others search: three decades up and down
AWAY = 3.0  # half width of the box of first points
CLOSE = 1.02  # of the best value known
LARGEST_GRID = 2  # weights beyond which a grid is not tried
REPEATED = 5  # evaluations that are timed
EVALUATIONS = evaluate_values, evaluate_point
COUNTS = np.unique(np.geomspace(1, 10_000, 200).astype(int))  # evaluations at which curves are kept

Search = tuple[list[float], list[float]]  # values, and evaluations so far


@dataclass(frozen=True)
class Trace:
    """Every better feasible value that one search found, in the order of its evaluations.

    >>> one = Trace("p", "grid", 0, [3.0, 9.0], [5.0, 2.0])
    >>> one.at(np.array([1, 3, 8, 9, 99])).tolist()
    [inf, 5.0, 5.0, 2.0, 2.0]
    >>> one.until(2.5), one.until(1.0)
    (9.0, inf)

    Attributes:
        spent: evaluations until then.
        best: the value.
    """

    problem: str
    method: str
    seed: int
    spent: list[float]
    best: list[float]

    @property
    def least(self) -> float:
        """The best value; infinite where there is none."""
        return self.best[-1] if self.best else np.inf

    def at(self, counts: np.ndarray) -> np.ndarray:
        """Best value within so many evaluations; infinite before the first."""
        return np.append(np.inf, self.best)[np.searchsorted(self.spent, counts, side="right")]

    def until(self, value: float) -> float:
        """Evaluations to come to a value; infinite where it does not."""
        pairs = zip(self.spent, self.best, strict=True)
        return next((spent for spent, best in pairs if best <= value), np.inf)


@dataclass(frozen=True)
class TunerRow:
    """One search on one problem, over all seeds.

    Attributes:
        weights: number of them.
        reached: seeds that came within 2 % of the best value known.
        evaluations: to come there, quartiles and median; None where that many seeds did not.
        best: best value known [um, or a ratio].
    """

    problem: str
    weights: int
    method: str
    seeds: int
    reached: int
    evaluations: tuple[float | None, float | None, float | None]
    best: float


@dataclass(frozen=True)
class Cost:
    """Processor time of a value, and of a value with slopes.

    Attributes:
        compiling: once [s].
        evaluating: every time afterwards [s].
    """

    problem: str
    compiling: tuple[float, float]
    evaluating: tuple[float, float]


@dataclass(frozen=True)
class TunersBench:
    """One row for every search and problem, and the costs of every problem."""

    budget: int
    rows: list[TunerRow]
    costs: list[Cost]


def measured(flags: Bench, tell: Callable[[str], None]) -> TunersBench:
    """Every search on every problem, from as many starts as are asked for.

    Raises:
        ValueError: the libraries of the others are not installed, or there is no such search.
    """
    missing = [name for name in PACKAGES if find_spec(name) is None]
    if missing:
        raise ValueError(
            f"bench tuners: needs {', '.join(missing)}; run it as "
            "uv run --group bench jcontour bench tuners"
        )
    known = (OURS, *METHODS)
    for name in flags.searches:
        if name not in known:
            raise ValueError(f"searches: needs names of {', '.join(known)}, received {name}")
    prepared = {name: _prepared(name) for name in PROBLEMS}

    def run(seed: int, name: str, method: str, budget: int) -> list[Trace]:
        found = _searched(prepared[name], method, seed, budget)
        tell(f"start {seed + 1} of {flags.seeds}: {name}: {method}")
        return [_better(name, method, seed, *found)]

    keys = [
        (seed, name, method, flags.evaluations)
        for seed, name, method in product(range(flags.seeds), PROBLEMS, flags.searches or known)
        if method != "grid" or prepared[name].first.size <= LARGEST_GRID
    ]
    traces = kept(flags.keep, Trace, keys, run)
    rows, curves = [], {}
    for name, one in prepared.items():
        some = [trace for trace in traces if trace.problem == name]
        several, curves[name] = _summed_up(one.first.size, some, flags.evaluations)
        rows += several
    if flags.figure is not None:
        save_figure(tuners_figure(curves), Path(flags.figure))
    return TunersBench(flags.evaluations, rows, [one.cost for one in prepared.values()])


@dataclass(frozen=True)
class Prepared:
    """A problem with its programs compiled.

    Attributes:
        first: coordinates of its own start, the middle of the box that is searched.
    """

    problem: Problem
    start: Weights
    first: Float[np.ndarray, " d"]
    cost: Cost


def _prepared(name: str) -> Prepared:
    problem, start = problem_of(name)
    first = np.asarray(Chart(problem.space, start).coordinates())
    costs = [_cost(lambda one=one: one(problem, start, first)) for one in EVALUATIONS]
    _ours(problem, start, first, 0, 2 * WITH_SLOPES)  # what is small
    compiling, evaluating = zip(*costs, strict=True)
    return Prepared(problem, start, first, Cost(name, compiling, evaluating))


def _cost(evaluate: Callable[[], object]) -> tuple[float, float]:
    """Seconds of processor time to compile, and of one evaluation afterwards."""
    clock = time.process_time()
    evaluate()
    compiled = time.process_time()
    for _ in range(REPEATED):
        evaluate()
    each = (time.process_time() - compiled) / REPEATED
    return max(0.0, compiled - clock - each), each


def _searched(one: Prepared, method: str, seed: int, budget: int) -> Search:
    """Values of a search from one start, and what they took."""
    begin = one.first + np.random.default_rng(seed).uniform(-AWAY, AWAY, one.first.size)
    if method == OURS:
        return _ours(one.problem, one.start, begin, seed, budget)
    measure = measure_of(one.problem, one.start)
    box = np.stack([one.first - REACH, one.first + REACH])
    values: list[float] = []

    def counted(z: np.ndarray) -> float:
        if len(values) >= budget:
            raise Spent
        tried = measure(np.asarray(z, float))
        values.append(tried.objective)
        return tried.merit

    try:
        METHODS[method](counted, begin, box, seed)
    except Spent:
        pass
    return values, np.arange(1.0, len(values) + 1).tolist()


def _ours(problem: Problem, start, begin, seed: int, budget: int) -> Search:
    weights = Chart(problem.space, start).weights(jnp.asarray(begin))
    effort = replace(THOROUGH, seed=seed, tolerance=1e-4)
    state = TuneState()
    values: list[float] = []
    spent: list[float] = []
    while not state.done and (not spent or spent[-1] < budget):
        looks = looks_at(problem)
        state = advance(problem, weights, effort, state)
        rows = state.history[len(values) :]
        alone = max(0, looks_at(problem) - looks - len(rows))  # at loops without runs
        before = (spent[-1] if spent else 0.0) + WITH_SLOPES * alone
        values += [_value(row) for row in rows]
        spent += (before + np.cumsum([_cost_of(row, effort) for row in rows])).tolist()
    within = sum(one <= budget for one in spent)
    return values[:within], spent[:within]


def _better(
    name: str, method: str, seed: int, values: Sequence[float], spent: Sequence[float]
) -> Trace:
    """Trace of a search; infinite values are beyond a limit."""
    best = np.minimum.accumulate(np.append(np.inf, values))
    better = np.flatnonzero(best[1:] < best[:-1]).tolist()
    return Trace(name, method, seed, [spent[k] for k in better], [values[k] for k in better])


def _cost_of(row: Evaluated, effort: Effort) -> int:
    scattered = row.start < 0
    return 1 if scattered and effort.values_alone else WITH_SLOPES


def _value(row: Evaluated) -> float:
    return np.inf if row.diverged or row.violation > FEASIBLE else row.objective


def _summed_up(
    weights: int, traces: list[Trace], budget: int
) -> tuple[list[TunerRow], dict[str, Curve]]:
    """Rows and curves of one problem by search, beside the best of all of them."""
    best = min((trace.least for trace in traces), default=np.inf)
    counts = COUNTS[COUNTS <= budget]
    rows, curves = [], {}
    for method in dict.fromkeys(trace.method for trace in traces):
        several = [trace for trace in traces if trace.method == method]
        until = np.full(len(several), np.inf)  # where no search has come within the limits
        if np.isfinite(best):
            until = np.array([trace.until(CLOSE * best) for trace in several])
            relative = np.stack([trace.at(counts) for trace in several]) / best
            curves[method] = Curve(counts, *_quartiles(relative))
        low, middle, high = (
            float(count) if np.isfinite(count) else None for count in _quartiles(until)
        )
        reached = int(np.isfinite(until).sum())
        numbers = len(several), reached, (low, middle, high), best
        rows.append(TunerRow(several[0].problem, weights, method, *numbers))
    return rows, curves


def _quartiles(values: np.ndarray) -> np.ndarray:
    return np.quantile(values, [0.25, 0.5, 0.75], axis=0, method="inverted_cdf")


def tables(result: TunersBench) -> Iterator[Table | str]:
    """A table for every problem, and what an evaluation costs."""
    yield (
        f"Evaluations to come within 2 % of the best value known, at most {result.budget}; "
        f"one with slopes counts {WITH_SLOPES}\n"
    )
    columns: dict[str, Column] = {
        "search": "method",
        "starts that\narrive": lambda row: f"{row.reached} of {row.seeds}",
        "evaluations\nmedian": lambda row: digits(row.evaluations[1]),
        "quartiles": lambda row: f"{digits(row.evaluations[0])} to {digits(row.evaluations[2])}",
    }
    for (problem, weights), rows in groupby(result.rows, lambda row: (row.problem, row.weights)):
        yield Table(f"{problem} ({weights} weights)", list(rows), columns)
    yield Table(
        "Processor time of one evaluation",
        result.costs,
        {
            "problem": "problem",
            "value [ms]": lambda one: digits(1e3 * one.evaluating[0]),
            "with slopes [ms]": lambda one: digits(1e3 * one.evaluating[1]),
            "compiling [s]": lambda one: digits(one.compiling[0]),
            "with slopes [s]": lambda one: digits(one.compiling[1]),
        },
    )
