"""`jcontour bench tuners`: the tuner against searches without slopes, at equal budgets.

All begin at the same random points. An evaluation with slopes counts as three. What counts is how
many evaluations a search needs to come within 2 % of the best value that anything has found.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from importlib.util import find_spec
from itertools import groupby, product
from pathlib import Path

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from rich.console import Console

from experiments.benchmarks.searches.counted_loops import looks_at, with_counted_loops
from experiments.benchmarks.searches.search_methods import METHODS, PACKAGES, Spent
from experiments.benchmarks.searches.search_traces import ProblemTraces, Record, Trace
from experiments.benchmarks.searches.tuner_problems import PROBLEMS, measure_of, problem_of
from experiments.benchmarks.searches.tuners_figure import Curve, tuners_figure
from jcontour.app.flags.others import Bench
from jcontour.app.reports import tables
from jcontour.app.reports.figures.png import save_figure
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
ENOUGH = 1.001  # of the best value known: a search that comes there ends
REPEATED = 5  # evaluations that are timed
EVALUATIONS = evaluate_values, evaluate_point
COUNTS = np.unique(np.geomspace(1, 10_000, 200).astype(int))  # evaluations at which curves are kept


@dataclass(frozen=True)
class TunerRow:
    """One search on one problem, over all seeds.

    Attributes:
        weights: number of them.
        reached: seeds that came within 2 % of the best value known.
        evaluations: to come there, quartiles and median; None where that many seeds did not.
        seconds: of processor time until there, median.
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
        ValueError: the libraries of the others are not installed.
    """
    missing = [name for name in PACKAGES if find_spec(name) is None]
    if missing:
        raise ValueError(
            f"bench tuners: needs {', '.join(missing)}; run it as "
            "uv run --group bench jcontour bench tuners"
        )
    record = Record.read(flags.keep, flags.evaluations)
    methods = _searches(flags)
    prepared = {name: _prepared(name, record) for name in PROBLEMS if name not in record.problems}
    while left := _left(record, methods, flags.seeds):
        for seed, name, method in left:
            if name not in prepared:
                prepared[name] = _prepared(name, record)
            one = prepared[name]
            one.found.put(method, seed, _searched(one, method, seed, record.budget))
            record.write(flags.keep)
            tell(f"start {seed + 1} of {flags.seeds}: {name}: {method}")
    rows, curves = [], {}
    for name, one in record.problems.items():
        several, curves[name] = _summed_up(name, one, record.budget)
        rows += several
    if flags.figure is not None:
        save_figure(tuners_figure(curves), Path(flags.figure))
    found = record.problems.items()
    costs = [Cost(name, one.compiling, one.evaluating) for name, one in found]
    return TunersBench(record.budget, rows, costs)


def _searches(flags: Bench) -> tuple[str, ...]:
    """Names of the searches that are asked for.

    Raises:
        ValueError: there is none of that name.
    """
    known = (OURS, *METHODS)
    for name in flags.searches:
        if name not in known:
            raise ValueError(f"searches: needs names of {', '.join(known)}, received {name}")
    return flags.searches or known


def _left(record: Record, methods: tuple[str, ...], seeds: int) -> list[tuple[int, str, str]]:
    """Seed, problem and search of what is still to do; an end at any time leaves whole seeds."""
    every = product(range(seeds), PROBLEMS, methods)
    return [one for one in every if _lacking(record.problems[one[1]], one[2], one[0])]


def _lacking(found: ProblemTraces, method: str, seed: int) -> bool:
    fits = method != "grid" or found.weights <= LARGEST_GRID
    return fits and found.lacks(method, seed)


@dataclass(frozen=True)
class Prepared:
    """A problem with its programs compiled.

    Attributes:
        first: coordinates of its own start, the middle of the box that is searched.
    """

    problem: Problem
    start: Weights
    first: Float[np.ndarray, " d"]
    found: ProblemTraces


def _prepared(name: str, record: Record) -> Prepared:
    """A problem with its programs compiled, and a first value known."""
    problem, start = problem_of(name)
    problem = with_counted_loops(problem)
    first = np.asarray(Chart(problem.space, start).coordinates())
    costs = [_cost(lambda one=one: one(problem, start, first)) for one in EVALUATIONS]
    _ours(problem, start, first, 0, 2 * WITH_SLOPES, 0.0)  # what is small
    if name not in record.problems:
        compiling, evaluating = zip(*costs, strict=True)
        known = _ours(problem, start, first, 0, record.budget, 0.0).least
        record.problems[name] = ProblemTraces(first.size, known, compiling, evaluating)
    return Prepared(problem, start, first, record.problems[name])


def _cost(evaluate: Callable[[], object]) -> tuple[float, float]:
    """Seconds of processor time to compile, and of one evaluation afterwards."""
    clock = time.process_time()
    evaluate()
    compiled = time.process_time()
    for _ in range(REPEATED):
        evaluate()
    each = (time.process_time() - compiled) / REPEATED
    return max(0.0, compiled - clock - each), each


def _searched(one: Prepared, method: str, seed: int, budget: int) -> Trace:
    """Trace of a search from one start."""
    begin = one.first + np.random.default_rng(seed).uniform(-AWAY, AWAY, one.first.size)
    enough = ENOUGH * one.found.known if np.isfinite(one.found.known) else 0.0
    if method == OURS:
        return _ours(one.problem, one.start, begin, seed, budget, enough)
    measure = measure_of(one.problem, one.start)
    box = np.stack([one.first - REACH, one.first + REACH])
    return _theirs(measure, METHODS[method], begin, box, seed, budget, enough)


def _ours(problem: Problem, start, begin, seed: int, budget: int, enough: float) -> Trace:
    weights = Chart(problem.space, start).weights(jnp.asarray(begin))
    effort = replace(THOROUGH, seed=seed, tolerance=1e-4)
    state, clock = TuneState(), time.process_time()
    values: list[float] = []
    spent: list[float] = []
    seconds: list[float] = []
    while not state.done and (not spent or spent[-1] < budget):
        looks = looks_at(problem)
        state = advance(problem, weights, effort, state)
        rows = state.history[len(values) :]
        alone = max(0, looks_at(problem) - looks - len(rows))  # at loops without runs
        before = (spent[-1] if spent else 0.0) + WITH_SLOPES * alone
        values += [_value(row) for row in rows]
        spent += (before + np.cumsum([_cost_of(row, effort) for row in rows])).tolist()
        seconds += [time.process_time() - clock] * len(rows)
        if min(values, default=np.inf) <= enough:
            break
    within = sum(one <= budget for one in spent)
    return Trace.of(values[:within], spent[:within], seconds[:within], enough)


def _cost_of(row: Evaluated, effort: Effort) -> int:
    scattered = row.start < 0
    return 1 if scattered and effort.values_alone else WITH_SLOPES


def _value(row: Evaluated) -> float:
    return np.inf if row.diverged or row.violation > FEASIBLE else row.objective


def _theirs(measure, method, begin, box, seed: int, budget: int, enough: float) -> Trace:
    values: list[float] = []
    seconds: list[float] = []
    clock = time.process_time()

    def counted(z: np.ndarray) -> float:
        if len(values) >= budget or (values and values[-1] <= enough):
            raise Spent
        tried = measure(np.asarray(z, float))
        values.append(tried.objective)
        seconds.append(time.process_time() - clock)
        return tried.merit

    try:
        method(counted, begin, box, seed)
    except Spent:
        pass
    return Trace.of(values, np.arange(1.0, len(values) + 1).tolist(), seconds, enough)


def _summed_up(
    name: str, found: ProblemTraces, budget: int
) -> tuple[list[TunerRow], dict[str, Curve]]:
    best = min(trace.least for several in found.traces.values() for trace in several)
    best = min(best, found.known)
    rows = [_row(name, found.weights, *pair, best) for pair in found.traces.items()]
    counts = COUNTS[COUNTS <= budget]
    curves = {}
    for method, several in found.traces.items() if np.isfinite(best) else ():
        relative = np.stack([trace.at(counts) for trace in several]) / best
        curves[method] = Curve(counts, *_quartiles(relative))
    return rows, curves


def _row(name: str, weights: int, method: str, several: list[Trace], best: float) -> TunerRow:
    until = np.array([trace.until(CLOSE * best) for trace in several])
    if not np.isfinite(best):  # no search has come within the limits
        until = np.full_like(until, np.inf)
    evaluations, seconds = (_quartiles(column) for column in until.T)
    low, middle, high = map(_known, evaluations)
    return TunerRow(
        problem=name,
        weights=weights,
        method=method,
        seeds=len(several),
        reached=int(np.isfinite(until[:, 0]).sum()),
        evaluations=(low, middle, high),
        seconds=_known(seconds[1]),
        best=best,
    )


def _quartiles(values: np.ndarray) -> np.ndarray:
    return np.quantile(values, [0.25, 0.5, 0.75], axis=0, method="inverted_cdf")


def _known(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def show(console: Console, result: TunersBench) -> None:
    """Print a table for every problem, and what an evaluation costs."""
    tables.say(
        console,
        f"Evaluations to come within 2 % of the best value known, at most {result.budget}; "
        f"one with slopes counts {WITH_SLOPES}",
        "",
    )
    columns = [
        "search",
        "starts that\narrive",
        "evaluations\nmedian",
        "quartiles",
        "seconds of processor\nmedian",
    ]
    for (problem, weights), rows in groupby(result.rows, lambda row: (row.problem, row.weights)):
        cells = [_cells(row) for row in rows]
        title = f"{problem} ({weights} weights)"
        console.print(tables.plain_table(title, columns, cells))
    columns = ["problem", "value [ms]", "with slopes [ms]", "compiling [s]", "with slopes [s]"]
    rows = []
    for one in result.costs:
        each = [tables.digits(1e3 * seconds) for seconds in one.evaluating]
        once = [tables.digits(seconds) for seconds in one.compiling]
        rows.append([one.problem, *each, *once])
    title = "Processor time of one evaluation; compiling is not in the seconds above"
    console.print(tables.plain_table(title, columns, rows, text_columns=1))


def _cells(row: TunerRow) -> list[str]:
    low, middle, high = (tables.digits(value) for value in row.evaluations)
    arrived = f"{row.reached} of {row.seeds}"
    return [row.method, arrived, middle, f"{low} to {high}", tables.digits(row.seconds)]
