"""The tuner: descents from several starts, under hard limits.

A run is a sequence of `advance` calls on a `TuneState`. The state holds everything: a run that is
saved after any call and loaded again ends with the same bits.

First comes a descent (`descents.descent`) from the given start; one that diverges is stabilised
before (`descents.stabilise`), and one that ends beyond its limits is brought inside
(`descents.landing`). Then points are scattered around the best one so far, and descents begin at
the most promising of them whose loops behave unlike all that was seen: far from an optimum a weight
may have no effect at all, and then no slope leads out. The best feasible point of all is the
result.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jcontour.linear.plant import ROUNDING
from tuning.descents.descent import Descent, begin, descend
from tuning.descents.quadratic_step import Model
from tuning.descents.stabilise import TRIES, Measured, landed, loop_radii, outside, stabilised
from tuning.objectives import AtMost, Outcome
from tuning.parameters import Chart, Weights
from tuning.point import (
    FEASIBLE,
    Evaluated,
    Point,
    evaluate_point,
    evaluate_values,
    next_start,
    rank,
    sound,
)
from tuning.problem import THOROUGH, Effort, Problem

IN_ONE_STEP = 2  # evaluations, at most
SAME = 0.05  # in z: a descent this near to the best point, and no better, ends where that one did


@dataclass(frozen=True)
class TuneState:
    """Complete state of a run: enough to go on with the same bits."""

    history: list[Evaluated] = field(default_factory=list)  # every point evaluated
    start: int = -1  # number of the descent in progress; -1 before the first
    descent: Descent | None = None  # its state; None where its start diverged
    # multipliers of the limits at the end of every descent before, (descents, c)
    prices: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))
    # whether each of these ended stationary
    stationary: np.ndarray = field(default_factory=lambda: np.zeros(0, bool))
    stabilised: bool = False  # whether a start diverged and was stabilised
    # smallest spectral radius of the frozen loops on the way
    least_radius: float = np.inf
    least_z: np.ndarray = field(default_factory=lambda: np.zeros(0))  # coordinates of that
    looks: int = 0  # how often the loops were looked at for that alone, without a run
    done: bool = False  # whether the run has ended
    # coordinates that the first descent begins at; those of the start when empty
    begin: np.ndarray = field(default_factory=lambda: np.zeros(0))


class Price(NamedTuple):
    """What one limit costs: d ln(objective) / d ln(bound) = -price."""

    name: str  # of the limit
    row: int  # index of the contour, or of the probe for a limit on the loops
    plant: int  # index in the family
    price: float  # zero for a limit that does not act


class Exceeded(NamedTuple):
    """A limit that the weights do not keep, where they exceed it most."""

    name: str  # of the limit
    row: int  # index of the contour, or of the probe for a limit on the loops
    plant: int  # index in the family
    value: float  # what the weights reach, in the unit of the limit
    allowed: float  # the limit; 1 where the limits are a function, and the value is relative to it

    def __str__(self) -> str:
        where = f"row {self.row}, plant {self.plant}"
        return f"{self.name} is {self.value:.4g}, allowed {self.allowed:.4g} ({where})"


class Tuned(NamedTuple):
    """Result of a run; its `repr` says which limits are not kept.

    Attributes:
        weights: the best feasible weights; those of least violation when none is feasible.
        outcome: metrics of these weights (contour, plant), and peaks of their loops.
        feasible: whether every limit holds to `FEASIBLE`.
        violation: largest ln(value / limit).
        diverged_points: number of evaluated points with a diverging member; they were rejected.
        diverged_starts: number of descents that could not begin because their start diverged.
        history: every point evaluated.
        prices: of every entry of the limits, from the descent that ended at the weights; empty when
            none did.
        stabilised: whether a start diverged, and its descent began at weights chosen for
            their stable loops.
        stationary: whether the descent that ended at the weights ended where nothing promises more.
        exceeded: every limit that is not kept; empty of a feasible result.
    """

    weights: Weights
    outcome: Outcome
    feasible: bool
    violation: float
    diverged_points: int
    diverged_starts: int
    history: list[Evaluated]
    prices: list[Price]
    stabilised: bool
    stationary: bool
    exceeded: tuple[Exceeded, ...] = ()

    def __repr__(self) -> str:
        if self.feasible:
            verdict = "keeps every limit"
        else:
            verdict = "EXCEEDS LIMITS: " + "; ".join(map(str, self.exceeded))
        points = f"{len(self.history)} points, {self.diverged_points} diverged"
        weights = jax.tree.map(np.asarray, self.weights)
        return f"Tuned({verdict}; weights {weights}; {points})"


def tune(
    problem: Problem,
    start: Weights,
    effort: Effort = THOROUGH,
    on_step: Callable[[TuneState], None] = lambda state: None,
) -> Tuned:
    """Weights that make the objective small within the limits.

    Where no point keeps the limits, the result is that of least violation: `feasible` is false,
    and `exceeded` has the limits that it does not keep.

    Args:
        problem: the tuning problem.
        start: first weights.
        effort: how much is tried, and the seed.
        on_step: receives the state after every step, for progress and saving.

    Raises:
        ValueError: the start does not fit the space, or no start is stable.
    """
    state = TuneState()
    while not state.done:
        state = advance(problem, start, effort, state)
        on_step(state)
    return result(problem, start, state)


def result(problem: Problem, start: Weights, state: TuneState) -> Tuned:
    """The best of everything evaluated so far.

    Raises:
        ValueError: every point diverged.
    """
    rows = sound(state.history)
    if not rows:
        raise ValueError(_nothing_stable(problem, start, state))
    best = min(rows, key=rank)
    begun = {row.start for row in rows}
    descents = {row.start for row in state.history if row.start >= 0}
    ended = _ended(state)
    of_descent = 0 <= best.start < len(ended.stationary)
    prices = []
    if of_descent:
        of_entries = zip(problem.limit_entries(best.outcome), ended.prices[best.start], strict=True)
        prices = [Price(*entry, float(price)) for entry, price in of_entries]
    return Tuned(
        weights=Chart(problem.space, start).weights(jnp.asarray(best.z)),
        outcome=best.outcome,
        feasible=best.violation <= FEASIBLE,
        violation=best.violation,
        diverged_points=sum(row.diverged for row in state.history),
        diverged_starts=len(descents - begun),
        history=state.history,
        prices=prices,
        stabilised=state.stabilised,
        stationary=bool(of_descent and ended.stationary[best.start]),
        exceeded=_exceeded(problem, best),
    )


def advance(problem: Problem, start: Weights, effort: Effort, state: TuneState) -> TuneState:
    """One step of a run: the first point of a descent, an iteration, or a scattered point."""
    if state.start < 0:
        z = state.begin if state.begin.size else _first(problem, start)
        return _begun(problem, start, state, 0, z)
    descent, left = state.descent, effort.evaluations - len(state.history)
    if descent is not None:
        after = _moved_on(problem, start, effort, state, descent, left)
        if after is not None:
            return after
        within = np.max(descent.model.limits, initial=-np.inf) <= FEASIBLE
        if not effort.every_start and descent.stationary and within:
            return replace(_ended(state), done=True)
    if left < IN_ONE_STEP:
        return replace(_ended(state), done=True)
    scattered = sum(row.start < 0 for row in state.history)
    if scattered < effort.scatter and (effort.starts > 1 or descent is None):
        z = _scattered_point(problem, start, effort, state, scattered)
        evaluate = evaluate_values if effort.values_alone else evaluate_point
        return replace(state, history=[*state.history, _row(-1, z, evaluate(problem, start, z))])
    ended, index = _ended(state), state.start + 1
    z = next_start(ended.history, np.sum(ended.prices, axis=1)) if index < effort.starts else None
    if z is None:
        return replace(ended, done=True)
    return _begun(problem, start, ended, index, z)


def _moved_on(
    problem: Problem, start: Weights, effort: Effort, state: TuneState, descent: Descent, left: int
) -> TuneState | None:
    """State after an iteration of the descent, or its landing; None where it has ended."""
    history, box = list(state.history), _box(problem, start)

    def evaluate(z) -> Model | None:
        point = evaluate_point(problem, start, z)
        history.append(_row(state.start, z, point))
        return None if point.diverged else _model(point)

    beyond = outside(descent)
    needed = IN_ONE_STEP + (TRIES if beyond else 0)  # evaluations to land after it
    if not descent.done and descent.steps < effort.steps and left >= needed:
        descent = descend(descent, evaluate, box, effort.tolerance)
        met = _met(descent, state, effort.tolerance)
        if met is not None and not descent.done:
            descent = descent._replace(done=True, stationary=bool(state.stationary[met]))
    elif left > 0 and beyond and not descent.landed:
        descent = landed(descent, evaluate, box, effort.tolerance, min(left, TRIES))
    else:
        return None
    return replace(state, history=history, descent=descent)


def _begun(problem, start, state: TuneState, index: int, z: np.ndarray) -> TuneState:
    point = evaluate_point(problem, start, z)
    state = replace(state, start=index, history=[*state.history, _row(index, z, point)])
    if point.diverged:
        state, z, point = _stabilised(problem, start, state, z, point)
    descent = None if point.diverged else begin(z, _model(point))
    return replace(state, descent=descent)


def _box(problem: Problem, start: Weights) -> tuple[np.ndarray, np.ndarray]:
    """Smallest and largest coordinates."""
    first, reach = _first(problem, start), Chart(problem.space, start).reach()
    return first - reach, first + reach


def _met(descent: Descent, state: TuneState, tolerance: float) -> int | None:
    """Number of the descent before whose best point, the best of all, this one comes to.

    None where it does not, or is better.
    """
    before = [row for row in sound(state.history) if 0 <= row.start < state.start]
    if not before:
        return None
    best = min(before, key=rank)
    near = np.max(np.abs(best.z - descent.z)) < SAME
    no_better = descent.model.objective > np.log(best.objective) - tolerance
    return best.start if near and no_better else None


def _stabilised(problem, start, state: TuneState, z, point: Point):
    """State, first point of the descent and its outcome, once it is sound; else as they were."""
    history, latest = list(state.history), point
    least, least_z, looks = state.least_radius, state.least_z, state.looks

    def evaluate(there) -> Point:
        point = evaluate_point(problem, start, there)
        history.append(_row(state.start, there, point))
        return point

    def of_loops(there) -> Measured:
        nonlocal latest, least, least_z, looks
        looks += 1
        radii, slopes = loop_radii(problem, start, there)
        largest = float(radii.max())
        if np.exp(largest) < least:
            least, least_z = float(np.exp(largest)), there
        if largest < 0:
            latest = evaluate(there)
        return Measured(radii, slopes, largest < 0 and not latest.diverged)

    def of_runs(there) -> Measured:
        nonlocal latest
        latest = evaluate(there)
        departures, slopes = map(np.asarray, (latest.departures, latest.slopes.departures))
        return Measured(departures, slopes, not latest.diverged)

    first, end = z, None
    for measure in (of_runs,) if problem.loops is None else (of_loops, of_runs):
        if end is None or not end.sound:
            end = stabilised(z, measure)
            z = end.z
    assert end is not None
    state = replace(state, history=history, least_radius=least, least_z=least_z, looks=looks)
    return (replace(state, stabilised=True), z, latest) if end.sound else (state, first, point)


def _ended(state: TuneState) -> TuneState:
    """Prices and end of the descent in progress put to those before."""
    if state.start < len(state.stationary):
        return state
    descent = state.descent
    count = state.prices.shape[1] if descent is None else descent.prices.size
    prices = np.zeros(count) if descent is None else descent.prices
    before = np.zeros((state.start, count))  # none is known where the first starts diverged
    before[:, : state.prices.shape[1]] = state.prices
    return replace(
        state,
        prices=np.concatenate([before, [prices]]),
        stationary=np.append(state.stationary, descent is not None and descent.stationary),
    )


def _nothing_stable(problem: Problem, start: Weights, state: TuneState) -> str:
    if not np.isfinite(state.least_radius):
        return (
            "every start diverges: begin with a stabilising controller (see frozen_spectral_radius)"
        )
    weights = Chart(problem.space, start).weights(jnp.asarray(state.least_z))
    numbers = jax.tree.map(lambda w: np.array2string(np.asarray(w), precision=4), weights)
    place = f"found at {numbers}"
    if abs(state.least_radius - 1) < ROUNDING:
        return (
            "no start is stable: the frozen loops keep a mode that neither decays nor grows, as a "
            f"counter in the memory of the controller (spectral radius 1, {place}); what counts "
            "samples belongs in its plan (prepare)"
        )
    return (
        "every start diverges: the smallest spectral radius of the frozen loops is "
        f"{state.least_radius:.4g}, {place}"
    )


def _exceeded(problem: Problem, best: Evaluated) -> tuple[Exceeded, ...]:
    """Limits that a point does not keep, each by its worst entry."""
    if best.violation <= FEASIBLE:
        return ()
    limits = problem.limits
    named = zip(limits.names, limits.bounds, strict=True) if isinstance(limits, AtMost) else ()
    bounds = {name: float(bound) for name, bound in named}
    violations = np.asarray(limits(best.outcome))
    entries = problem.limit_entries(best.outcome)
    worst: dict[str, Exceeded] = {}
    for k in np.argsort(violations)[::-1]:
        entry, violation = entries[k], violations[k]
        if violation > FEASIBLE and entry.name not in worst:
            allowed = bounds.get(entry.name, 1.0)
            worst[entry.name] = Exceeded(*entry, float(np.exp(violation) * allowed), allowed)
    return tuple(worst.values())


def _first(problem: Problem, start: Weights) -> np.ndarray:
    return np.asarray(Chart(problem.space, start).coordinates())


def _model(point: Point) -> Model:
    slopes = point.slopes
    return Model(*map(np.asarray, (point.errors, point.limits, slopes.errors, slopes.limits)))


def _scattered_point(problem, start, effort: Effort, state: TuneState, index: int) -> np.ndarray:
    """A point around the best of the first descent, in the box that weights may not leave."""
    from scipy.stats.qmc import Sobol  # takes longer to import than the rest of the tuner

    first = _first(problem, start)
    begun = [row for row in sound(state.history) if row.start == 0]
    centre = min(begun, key=rank).z if begun else first
    count = 2 ** int(np.ceil(np.log2(effort.scatter)))
    *place, far = Sobol(first.size + 1, rng=effort.seed).random(count)[index]
    # as far away on average as with two weights, whatever their number
    spread = effort.spread * min(1.0, np.sqrt(2 / first.size))
    spread *= 2 if far > 0.5 else 1  # half of the points look twice as far
    z = centre + spread * (2 * np.array(place) - 1)
    return np.clip(z, *_box(problem, start))


def _row(start: int, z: np.ndarray, point: Point) -> Evaluated:
    violation = float(np.max(point.limits, initial=-np.inf))
    return Evaluated(start, z, point.objective, violation, point.outcome, bool(point.diverged))
