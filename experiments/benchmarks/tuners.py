"""`jcontour bench tuners`: the tuner against searches without slopes, at equal budgets.

All begin at the same random points. An evaluation with slopes counts as three. What counts is how
many evaluations a search needs to come within 2 % of the best value that anything has found.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from importlib.util import find_spec
from itertools import groupby, product

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from experiments.benchmarks.search_methods import METHODS, PACKAGES, Spent
from experiments.benchmarks.stored_results import kept
from experiments.tables import Column, Table
from jcontour.app.flags.others import Bench
from jcontour.app.flags.tuning import Tune
from jcontour.app.runs.tuning.problem import tuning_run
from tuning.parameters import Chart, Weights
from tuning.point import FEASIBLE, evaluate_values
from tuning.problem import THOROUGH, Problem
from tuning.tuner import TuneState, advance

STATE = "contouring-lq-state"
ALONE = {"nominal_only": True, "max_sensitivity": None}
PROBLEMS: dict[str, Tune] = {  # from cheap to dear
    "square, increment limited": Tune(
        parts=("square",), controller=STATE, max_rms_increment=0.18, **ALONE
    ),
    "circle, RMS control limited": Tune(
        parts=("circle",), controller=STATE, max_rms_control=2.224, **ALONE
    ),
    "square, stage profile, increment limited": Tune(
        parts=("square",),
        controller=STATE,
        free="alpha,beta,stage",
        max_rms_increment=0.18,
        **ALONE,
    ),
    "flexible axis, cascade": Tune(
        parts=("task-a",),
        plant="flexible-axis",
        controller="cascade-feedforward",
        **ALONE,
    ),
    "circle, stage profile, Ms limited": Tune(
        parts=("circle",), free="alpha,beta,observer,stage", nominal_only=True
    ),
    "circle, family, Ms limited": Tune(parts=("circle",)),
}
OURS = "jcontour"
WITH_SLOPES = 3  # evaluations that one with slopes counts as
REACH = 7.0  # half width in ln(weight) of the box that others search: three decades up and down
AWAY = 3.0  # half width of the box of first points
CLOSE = 1.02  # of the best value known
LOST = 100.0  # merit of a point that diverges
DEAR = 10.0  # price of a limit's excess in the merit of a search without limits of its own

Search = tuple[list[float], list[float]]  # values, and evaluations so far
Tried = tuple[float, float]  # merit, and objective: infinite beyond a limit


@dataclass(frozen=True)
class Trace:
    """Every better feasible value of one search, in the order of its evaluations."""

    problem: str
    method: str
    seed: int
    spent: list[float]  # evaluations until then
    best: list[float]  # the value

    @property
    def least(self) -> float:
        """The best value; infinite where there is none."""
        return self.best[-1] if self.best else np.inf

    def until(self, value: float) -> float:
        """Evaluations to come to a value; infinite where it does not."""
        pairs = zip(self.spent, self.best, strict=True)
        return next((spent for spent, best in pairs if best <= value), np.inf)


@dataclass(frozen=True)
class TunerRow:
    """One search on one problem, over all seeds."""

    problem: str
    weights: int
    method: str
    seeds: int
    reached: int  # seeds that came within 2 % of the best value known
    evaluations: float | None  # to come there, median; None where fewer than half did
    best: float  # value known [um, or a ratio]


def measured(flags: Bench, tell: Callable[[str], None]) -> list[TunerRow]:
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
    runs = {name: tuning_run(flags) for name, flags in PROBLEMS.items()}
    problems = {name: (run.problem, run.start) for name, run in runs.items()}

    def run(seed: int, name: str, method: str, budget: int) -> list[Trace]:
        search = _searched(*problems[name], method, seed, budget)
        tell(f"start {seed + 1} of {flags.seeds}: {name}: {method}")
        return [_better(name, method, seed, *search)]

    keys = [
        (seed, name, method, flags.evaluations)
        for seed, name, method in product(range(flags.seeds), PROBLEMS, flags.searches or known)
    ]
    traces = kept(flags.keep, Trace, keys, run)
    rows: list[TunerRow] = []
    for name, (problem, start) in problems.items():
        some = [trace for trace in traces if trace.problem == name]
        rows += _summed_up(Chart(problem.space, start).coordinates().size, some)
    return rows


def measure_of(problem: Problem, start: Weights) -> Callable[[Float[np.ndarray, " d"]], Tried]:
    """Function from coordinates to merit and objective of one point without slopes.

    The merit is ln f + `DEAR` times the largest excess ln(value / limit). Where it diverges, `LOST`
    and more the farther a run leaves its contour: what the tuner sees there, too.
    """

    def measure(z: Float[np.ndarray, " d"]) -> Tried:
        point = evaluate_values(problem, start, z)
        if point.diverged:
            worst = float(np.max(point.departures))  # ln(error / size)
            away = float(np.clip(worst, 0.0, LOST)) if np.isfinite(worst) else LOST
            return LOST + away, np.inf
        violation = float(np.max(point.limits, initial=-np.inf))
        merit = np.log(point.objective) + DEAR * max(0.0, violation)
        return float(merit), point.objective if violation <= FEASIBLE else np.inf

    return measure


def _searched(problem: Problem, start: Weights, method: str, seed: int, budget: int) -> Search:
    """Values of a search from one random point, and what they took."""
    first = np.asarray(Chart(problem.space, start).coordinates())  # the middle of the box
    begin = first + np.random.default_rng(seed).uniform(-AWAY, AWAY, first.size)
    if method == OURS:
        return _ours(problem, start, begin, seed, budget)
    measure = measure_of(problem, start)
    box = np.stack([first - REACH, first + REACH])
    values: list[float] = []

    def counted(z: np.ndarray) -> float:
        if len(values) >= budget:
            raise Spent
        merit, objective = measure(np.asarray(z, float))
        values.append(objective)
        return merit

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
        looks = state.looks
        state = advance(problem, weights, effort, state)
        rows = state.history[len(values) :]
        before = (spent[-1] if spent else 0.0) + WITH_SLOPES * (state.looks - looks)
        values += [
            np.inf if one.diverged or one.violation > FEASIBLE else one.objective for one in rows
        ]
        # scattered points may need values alone
        costs = [1 if one.start < 0 and effort.values_alone else WITH_SLOPES for one in rows]
        spent += (before + np.cumsum(costs)).tolist()
    within = sum(one <= budget for one in spent)
    return values[:within], spent[:within]


def _better(
    name: str, method: str, seed: int, values: Sequence[float], spent: Sequence[float]
) -> Trace:
    """Trace of a search; infinite values are beyond a limit."""
    best = np.minimum.accumulate(np.append(np.inf, values))
    better = np.flatnonzero(best[1:] < best[:-1]).tolist()
    return Trace(name, method, seed, [spent[k] for k in better], [values[k] for k in better])


def _summed_up(weights: int, traces: list[Trace]) -> list[TunerRow]:
    """Rows of one problem by search, beside the best of all of them."""
    best = min((trace.least for trace in traces), default=np.inf)
    rows = []
    for method in dict.fromkeys(trace.method for trace in traces):
        several = [trace for trace in traces if trace.method == method]
        until = np.full(len(several), np.inf)  # where no search has come within the limits
        if np.isfinite(best):
            until = np.array([trace.until(CLOSE * best) for trace in several])
        middle = float(np.quantile(until, 0.5, method="inverted_cdf"))
        numbers = len(several), int(np.isfinite(until).sum())
        median = middle if np.isfinite(middle) else None
        rows.append(TunerRow(several[0].problem, weights, method, *numbers, median, best))
    return rows


def tables(result: list[TunerRow]) -> Iterator[Table | str]:
    """A table for every problem."""
    yield (
        "Evaluations to come within 2 % of the best value known; "
        f"one with slopes counts {WITH_SLOPES}\n"
    )
    columns: dict[str, Column] = {
        "search": "method",
        "starts that\narrive": lambda row: f"{row.reached} of {row.seeds}",
        "evaluations\nmedian": "evaluations:.4g",
    }
    for (problem, weights), rows in groupby(result, lambda row: (row.problem, row.weights)):
        yield Table(f"{problem} ({weights} weights)", list(rows), columns)
