"""The tuner: scattered starts, L-BFGS descents, and hard limits by an augmented Lagrangian.

A run is a sequence of `advance` calls on a `TuneState`. The state holds everything: a run that is
saved after any call and loaded again ends with the same bits.

First, scattered points are evaluated. A given start whose loops are unstable is stabilised
(`stabilise`). Then the run descends from the given start and from the most
promising scattered points. The best feasible point of all is the result. One descent has two loops:

    inner   minimise L(z; lambda, mu) along L-BFGS directions (from optax);
            a step is cut back until L falls and no member of the family diverges
    outer   lambda <- max(0, lambda + mu c);
            mu grows when the violation does not shrink to a quarter;
            of several objective values, those near the largest gain shares in the smooth maximum

Near the limits the objective is divided by its last value, so that one tolerance on L suits large
and small optima.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optax

from tuning.outcome import Outcome
from tuning.parameters import Chart, Weights
from tuning.problem import (
    LIMIT_MARGIN,
    Merit,
    Point,
    Problem,
    earned_shares,
    evaluate_point,
    geometric_mean,
    objective_value,
    smooth_maximum,
)
from tuning.stabilise import stabilised

FEASIBLE = 1e-6  # a limit may be exceeded by this relative amount
NEARLY_FEASIBLE = 0.02  # violation below which the objective tells its size at the optimum
# a point 10 % above a limit is as promising as a feasible one with a 65 % larger objective
PROMISE_LOST = 5.0
LARGEST_MOVE = 2.0  # in z: no weight changes by more than e^2 in one step
LEAST_FALL = 1e-4  # Armijo: part of the predicted fall that a step must reach
# times the best objective so far: a nearly feasible descent this far above it is given up
HOPELESS = 1.2
# distance in ln(error, error, increment) from every descent so far that makes a start worth while
NEW_BEHAVIOUR = 0.5
TRIALS = 8  # shortenings before a direction is given up
# low, so that a descent may cross what the limits forbid on its way to a better valley
FIRST_PENALTY = 4.0


@dataclass(frozen=True)
class Effort:
    """How much a run may try: `QUICK`, `THOROUGH`, or numbers of your own.

    >>> replace(QUICK, seed=1).outer_steps
    4

    Attributes:
        starts: descents, from the given weights first, then from promising scattered points;
            hopeless ones are given up early.
        scatter: points evaluated before the first descent, a Sobol sequence around the start.
        inner_steps: L-BFGS steps per outer step.
        outer_steps: multiplier updates.
        tolerance: relative change of objective and weights at which a descent ends.
        spread: half width in ln(weight) of the box that the scattered points fill.
        seed: of the Sobol sequence.

    Raises:
        ValueError: a number is below its least sensible value.
    """

    starts: int
    scatter: int
    inner_steps: int
    outer_steps: int
    tolerance: float
    spread: float = 7.0  # three decades up and down
    seed: int = 0

    def __post_init__(self):
        """Check the ranges."""
        least = {
            "starts": 1,
            "scatter": 0,
            "spread": 0,
            "inner_steps": 1,
            "outer_steps": 1,
            "seed": 0,
        }
        for name, bound in least.items():
            if getattr(self, name) < bound:
                raise ValueError(f"{name}: needs at least {bound}, received {getattr(self, name)}")
        if not self.tolerance > 0:
            raise ValueError(f"tolerance: needs to be above zero, received {self.tolerance}")


# a tenth of a per cent within a minute: less than a plant model is good for
QUICK = Effort(starts=2, scatter=6, inner_steps=12, outer_steps=4, tolerance=1e-3)
# for publication; two to thirteen weights need no more steps than these
THOROUGH = Effort(starts=5, scatter=24, inner_steps=15, outer_steps=12, tolerance=1e-5)


class Evaluated(NamedTuple):
    """One row of the history: a point that was tried, and its outcome."""

    start: int  # number of the descent; -1 for a scattered point
    z: np.ndarray
    objective: float
    violation: float  # largest limit, ln(value / limit); -inf without limits
    outcome: Outcome
    diverged: bool


@dataclass(frozen=True)
class TuneState:
    """Complete state of a run: enough to go on with the same bits."""

    history: list[Evaluated] = field(default_factory=list)
    start: int = -1  # -1 while scattered points are looked at
    outer: int = 0
    inner: int = 0
    z: np.ndarray = field(default_factory=lambda: np.zeros(0))
    memory: Any = None  # of the L-BFGS direction
    merit: Merit | None = None
    lagrangian: float = np.inf  # at z
    gradient: np.ndarray = field(default_factory=lambda: np.zeros(0))  # likewise
    violation: float = np.inf  # at the last multiplier update
    objective: float = np.inf  # likewise
    # multipliers of the limits (descent, c), as slopes of ln(objective)
    prices: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))
    stabilised: bool = False
    least_radius: float = np.inf  # where nothing stable was found
    least_z: np.ndarray = field(default_factory=lambda: np.zeros(0))  # likewise
    done: bool = False


class Price(NamedTuple):
    """What one limit costs: d ln(objective) / d ln(bound) = -price.

    Attributes:
        name: of the limit.
        row: index of the contour, or of the probe for a limit on the loops.
        plant: index in the family.
        price: zero for a limit that does not act.
    """

    name: str
    row: int
    plant: int
    price: float


class Tuned(NamedTuple):
    """Result of a run.

    Attributes:
        weights: the best feasible weights; those of least violation when none is feasible.
        outcome: metrics of these weights (contour, plant), and peaks of their loops.
        feasible: whether every limit holds to `FEASIBLE`.
        violation: largest ln(value / limit).
        diverged_points: number of evaluated points with a diverging member; they were rejected.
        diverged_starts: number of descents that could not begin because their start diverged.
        history: every point evaluated.
        prices: of every entry of the limits, from the descent that found the weights; empty when
            none did.
        stabilised: whether the given start diverged, and the first descent began at weights that
            were found for their stable loops.
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


def tune(
    problem: Problem,
    start: Weights,
    effort: Effort = THOROUGH,
    on_step: Callable[[TuneState], None] = lambda state: None,
) -> Tuned:
    """Weights that make the objective small within the limits.

    Args:
        problem: the tuning problem.
        start: first weights.
        effort: how much is tried, and the seed.
        on_step: receives the state after every step, for progress and saving.

    Raises:
        ValueError: the start does not fit the space, or every start diverges.
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
    sound = [row for row in state.history if not row.diverged]
    if not sound:
        raise ValueError(_nothing_stable(problem, start, state))
    best = min(sound, key=_rank)
    begun = {row.start for row in sound}
    descents = {row.start for row in state.history if row.start >= 0}
    return Tuned(
        weights=Chart(problem.space, start).weights(jnp.asarray(best.z)),
        outcome=best.outcome,
        feasible=best.violation <= FEASIBLE,
        violation=best.violation,
        diverged_points=sum(row.diverged for row in state.history),
        diverged_starts=len(descents - begun),
        history=state.history,
        prices=_prices(problem, best, state),
        stabilised=state.stabilised,
    )


def _nothing_stable(problem: Problem, start: Weights, state: TuneState) -> str:
    if not np.isfinite(state.least_radius):
        return (
            "every start diverges: begin with a stabilising controller (see frozen_spectral_radius)"
        )
    weights = Chart(problem.space, start).weights(jnp.asarray(state.least_z))
    return (
        "every start diverges: the smallest spectral radius of the frozen loops is "
        f"{state.least_radius:.4g}, found at {jax.tree.map(lambda w: f'{w:.4g}', weights)}"
    )


def _prices(problem: Problem, best: Evaluated, state: TuneState) -> list[Price]:
    if not 0 <= best.start < len(state.prices):
        return []
    entries = problem.limit_entries(best.outcome)
    values = state.prices[best.start]
    return [Price(*entry, float(value)) for entry, value in zip(entries, values, strict=True)]


def advance(problem: Problem, start: Weights, effort: Effort, state: TuneState) -> TuneState:
    """One step of a run.

    It evaluates a scattered point or the first point of a descent, makes an L-BFGS step, or updates
    the multipliers.
    """
    if state.start < 0:
        if len(state.history) < effort.scatter:
            z = _scattered_point(problem, start, effort, len(state.history))
            point = _point(problem, start, z)
            return replace(state, history=[*state.history, _row(-1, z, point)])
        return _begin(problem, start, effort, state, 0)
    if state.inner >= effort.inner_steps:
        return _update_multipliers(problem, start, effort, state)
    return _descend(problem, start, effort, state)


def _begin(problem, start, effort, state: TuneState, index: int) -> TuneState:
    if index >= effort.starts:
        return replace(state, done=True)
    if index == 0:
        z = np.asarray(Chart(problem.space, start).coordinates())
    else:
        z = _next_start(state.history)
    if z is None:
        return replace(state, done=True)
    point = _point(problem, start, z)
    state = replace(state, history=[*state.history, _row(index, z, point)])
    if point.diverged and index == 0 and problem.loops is not None:
        state, z, point = _stabilised(problem, start, state, z, point)
    merit = _first_merit(point.limits.size, point.objective.shape)
    merit = merit._replace(scale=np.asarray(objective_value(point.objective)))
    no_prices = np.zeros((1, point.limits.size))
    prices = state.prices.reshape(index, point.limits.size)
    state = replace(
        state,
        prices=np.concatenate([prices, no_prices]),
        start=index,
        outer=0,
        inner=0,
        z=z,
        memory=_fresh(z),
        merit=merit,
        violation=np.inf,
        objective=np.inf,
    )
    state = _weighed(problem, start, state)
    return _begin(problem, start, effort, state, index + 1) if bool(point.diverged) else state


def _stabilised(problem, start, state: TuneState, z, point: Point):
    """The state, and the first point of the descent, once it is stable; else as they were."""
    history, found = list(state.history), point

    def accept(there) -> bool:
        nonlocal found
        found = _point(problem, start, there)
        history.append(_row(0, there, found))
        return not found.diverged

    end = stabilised(problem, start, z, accept)
    state = replace(state, history=history, least_radius=end.radius, least_z=end.z)
    if not end.accepted:
        return state, z, point
    return replace(state, stabilised=True), end.z, found


def _descend(problem, start, effort, state: TuneState) -> TuneState:
    step, memory = _direction(state.z, state.gradient, state.memory)
    fall = float(step @ state.gradient)
    if -fall < effort.tolerance**2:  # of a Lagrangian of order one
        return replace(state, inner=effort.inner_steps)
    history, length = state.history, 1.0
    for _ in range(TRIALS):
        z = state.z + length * step
        there = _point(problem, start, z, state.merit)
        history = [*history, _row(state.start, z, there)]
        change = np.inf if there.diverged else float(there.lagrangian) - state.lagrangian
        if change <= LEAST_FALL * fall * length:
            reached = replace(state, history=history, z=z, memory=memory, inner=state.inner + 1)
            return replace(reached, lagrangian=float(there.lagrangian), gradient=there.gradient)
        # lowest point of the parabola through the value and slope here and the value there
        parabola = -fall * length**2 / (2 * (change - fall * length))
        length = np.clip(parabola, 0.1 * length, 0.5 * length)
    steepest = int(state.memory.count) == 0  # the last direction: nothing else is left to try
    inner = effort.inner_steps if steepest else state.inner + 1
    return replace(state, history=history, memory=_fresh(state.z), inner=inner)


def _update_multipliers(problem, start, effort, state: TuneState) -> TuneState:
    assert state.merit is not None  # a descent has begun
    here = _point(problem, start, state.z, state.merit)
    multipliers, penalty, scale, shares = state.merit
    limits = here.limits + LIMIT_MARGIN
    slack = -multipliers / penalty
    violation = float(np.max(np.abs(np.maximum(limits, slack)), initial=0.0))  # and complementarity
    nearly_feasible = violation < NEARLY_FEASIBLE
    objective = objective_value(here.objective)
    overstated = 1 - float(geometric_mean(smooth_maximum(here.objective, shares))) / objective
    next_multipliers = np.maximum(0.0, multipliers + penalty * limits)
    prices = state.prices.copy()
    prices[state.start] = next_multipliers * scale / objective
    state = replace(state, prices=prices)
    still = abs(objective - state.objective) < effort.tolerance * objective
    settled = still and abs(overstated) < 10 * effort.tolerance
    converged = violation < LIMIT_MARGIN and settled
    hopeless = nearly_feasible and objective > HOPELESS * _best_so_far(state.history)
    if converged or hopeless or state.outer + 1 >= effort.outer_steps:
        return _begin(problem, start, effort, state, state.start + 1)
    new_scale = np.asarray(objective) if nearly_feasible else scale
    shrunk = violation <= max(state.violation / 4, LIMIT_MARGIN / 2)
    merit = Merit(
        multipliers=next_multipliers * scale / new_scale,
        penalty=penalty if shrunk else 4 * penalty,
        scale=new_scale,
        shares=earned_shares(here.objective, shares),
    )
    state = replace(
        state,
        outer=state.outer + 1,
        inner=0,
        memory=_fresh(state.z),
        merit=merit,
        violation=violation,
        objective=objective,
    )
    return _weighed(problem, start, state)


def _best_so_far(history: list[Evaluated]) -> float:
    sound = [row for row in history if not row.diverged]
    return min((row.objective for row in sound if row.violation <= FEASIBLE), default=np.inf)


def _weighed(problem, start, state: TuneState) -> TuneState:
    here = _point(problem, start, state.z, state.merit)
    return replace(state, lagrangian=float(here.lagrangian), gradient=here.gradient)


_lbfgs = optax.scale_by_lbfgs(memory_size=10)
_lbfgs_update = jax.jit(_lbfgs.update)


def _fresh(z: np.ndarray):
    return _lbfgs.init(jnp.asarray(z))


def _direction(z: np.ndarray, gradient, memory) -> tuple[np.ndarray, Any]:
    with jax.numpy_dtype_promotion("standard"):  # optax adds counters of 32 and of 64 bits
        update, memory = _lbfgs_update(gradient, memory, jnp.asarray(z))
    step, gradient = -np.asarray(update), np.asarray(gradient)
    if not step @ gradient < 0:  # negative curvature spoilt the memory
        step, memory = -gradient, _fresh(z)
    return step * min(1.0, LARGEST_MOVE / max(np.abs(step).max(), 1e-300)), memory


def _point(problem, start, z, merit: Merit | None = None) -> Point:
    if merit is None:  # a first look is for the numbers only
        merit = _first_merit(*problem.counts(start))
    traced = jax.tree.map(jnp.asarray, merit)
    return jax.device_get(evaluate_point(problem, start, jnp.asarray(z), traced))


def _first_merit(limits: int, values: tuple[int, ...]) -> Merit:
    return Merit(
        multipliers=np.zeros(limits),
        penalty=np.asarray(FIRST_PENALTY),
        scale=np.asarray(1.0),
        shares=np.full(values, 1 / values[-1]),
    )


def _scattered_point(problem, start, effort: Effort, index: int) -> np.ndarray:
    from scipy.stats.qmc import Sobol  # takes longer to import than the rest of the tuner

    z = np.asarray(Chart(problem.space, start).coordinates())
    count = 2 ** int(np.ceil(np.log2(effort.scatter)))
    points = Sobol(z.size, rng=effort.seed).random(count)
    return z + effort.spread * (2 * points[index] - 1)


def _row(start: int, z: np.ndarray, point: Point) -> Evaluated:
    objective = objective_value(point.objective)
    violation = float(np.max(point.limits, initial=-np.inf))
    return Evaluated(start, z, objective, violation, point.outcome, bool(point.diverged))


def _next_start(history: list[Evaluated]) -> np.ndarray | None:
    """The most promising scattered point whose loop behaves unlike all descents so far, or None."""
    sound = [row for row in history if not row.diverged]
    seen = np.array([_behaviour(row) for row in sound if row.start >= 0])
    new = [row for row in sound if row.start < 0 and _apart(_behaviour(row), seen)]
    return min(new, key=_promise).z if new else None


def _behaviour(row: Evaluated) -> np.ndarray:
    """Logarithms of the mean errors and increment of the loop.

    Weights that look different may behave alike, as all tiny betas do.
    """
    metrics = row.outcome.metrics
    measures = (metrics.rms_contour_error, metrics.rms_tracking_error, metrics.rms_increment)
    return np.log([max(float(np.mean(measure)), 1e-300) for measure in measures])


def _apart(behaviour: np.ndarray, seen: np.ndarray) -> bool:
    return len(seen) == 0 or bool(np.min(np.linalg.norm(seen - behaviour, axis=1)) > NEW_BEHAVIOUR)


def _promise(row: Evaluated) -> float:
    return np.log(max(row.objective, 1e-300)) + PROMISE_LOST * max(row.violation, 0.0)


def _rank(row: Evaluated) -> tuple[float, float]:
    return max(row.violation, FEASIBLE), row.objective
