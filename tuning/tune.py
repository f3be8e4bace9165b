"""The tuner: multi-start, L-BFGS directions from optax, hard limits by an augmented Lagrangian, the best feasible point kept.

A run is a sequence of `advance` calls on a `TuneState`, which holds everything: saved after any of
them and loaded again, a run ends with the same bits. First scattered points are looked at; then the
start that was given and the most promising of those points are descended from:
    inner: minimise L(z; lambda, mu) along L-BFGS directions, steps cut back until L falls and no
    run diverges
    outer: lambda <- max(0, lambda + mu c);  mu grows when the violation does not shrink to a
    quarter;
           of several values to make small, those near the largest earn shares in the smooth
           maximum;
           near the limits the objective is scaled by its last value: L then means the same for
           coarse and fine optima
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optax

from jcontour.simulation.metrics import Metrics
from tuning.parameters import Chart, Weights
from tuning.problem import (
    LIMIT_MARGIN,
    Merit,
    Point,
    Problem,
    earned_shares,
    evaluate_point,
    smooth_maximum,
)

FEASIBLE = 1e-6  # a limit may be exceeded by this relative amount
NEARLY_FEASIBLE = 0.02  # violation below which the objective tells its size at the optimum
PROMISE_LOST = (
    5.0  # a point 10 % above a limit is as promising as a feasible one with a 65 % larger objective
)
LARGEST_MOVE = 2.0  # in z: no weight changes by more than e^2 in one step
LEAST_FALL = 1e-4  # Armijo: part of the predicted fall that a step must reach
HOPELESS = (
    1.2  # times the best objective so far: a nearly feasible descent this far above it is given up
)
# distance in ln(error, error, increment) from every descent so far that makes a start worth while
NEW_BEHAVIOUR = 0.5
TRIALS = 8  # shortenings before a direction is given up
FIRST_PENALTY = (
    4.0  # low, so that a descent may cross what the limits forbid on its way to a better valley
)


@dataclass(frozen=True)
class Settings:
    """How much a run may try.

    Raises:
        ValueError: a number is below its least sensible value.
    """

    # descents: one from the weights given, the others from promising points; hopeless ones are
    # given up early
    starts: int = 5
    scatter: int = 24  # points looked at before descending: a Sobol sequence around the start
    spread: float = 7.0  # half width of the box they fill, in ln(weight): three decades up and down
    inner_steps: int = 15  # L-BFGS steps per outer step; two to thirteen weights need no more
    outer_steps: int = 12  # multiplier updates
    tolerance: float = 1e-5  # relative change of objective and weights at which a descent ends
    seed: int = 0

    def __post_init__(self):
        """Check the ranges."""
        for name, least in (
            ("starts", 1),
            ("scatter", 0),
            ("spread", 0),
            ("inner_steps", 1),
            ("outer_steps", 1),
            ("seed", 0),
        ):
            if getattr(self, name) < least:
                raise ValueError(f"{name}: needs at least {least}, received {getattr(self, name)}")
        if not self.tolerance > 0:
            raise ValueError(f"tolerance: needs to be above zero, received {self.tolerance}")


class Evaluated(NamedTuple):
    """One row of the history: what was tried and what came of it."""

    start: int  # which descent; -1 for a scattered point
    z: np.ndarray
    objective: float
    violation: float  # largest limit, ln(value / limit); -inf without limits
    metrics: Metrics
    diverged: bool


@dataclass(frozen=True)
class TuneState:
    """Where a run stands, whole: enough to go on with the same bits."""

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
    done: bool = False


class Tuned(NamedTuple):
    """What a run found.

    Attributes:
        weights: the best feasible weights; of the least violation when none is feasible.
        metrics: theirs, (contour, plant).
        feasible: whether every limit holds to `FEASIBLE`.
        violation: largest ln(value / limit) of them.
        diverged_points: how many evaluated points had a diverging member; they were rejected.
        diverged_starts: how many descents could not begin because their start diverged.
        history: every point evaluated.
    """

    weights: Weights
    metrics: Metrics
    feasible: bool
    violation: float
    diverged_points: int
    diverged_starts: int
    history: list[Evaluated]


def tune(
    problem: Problem,
    start: Weights,
    settings: Settings = Settings(),
    on_step: Callable[[TuneState], None] = lambda state: None,
) -> Tuned:
    """Weights that make the objective small within the limits.

    Args:
        problem: what is tuned.
        start: first weights.
        settings: effort and seed.
        on_step: told the state after every step, for progress and saving.

    Raises:
        ValueError: the start does not fit the space, or every start diverges.
    """
    state = TuneState()
    while not state.done:
        state = advance(problem, start, settings, state)
        on_step(state)
    return result(problem, start, state)


def result(problem: Problem, start: Weights, state: TuneState) -> Tuned:
    """The best of everything evaluated so far.

    Raises:
        ValueError: every point diverged.
    """
    sound = [row for row in state.history if not row.diverged]
    if not sound:
        raise ValueError(
            "every start diverges: begin with a stabilising controller (see frozen_spectral_radius)"
        )
    best = min(sound, key=_rank)
    began = [
        next((row for row in state.history if row.start == s), None) for s in range(state.start + 1)
    ]
    return Tuned(
        Chart(problem.space, start).weights(jnp.asarray(best.z)),
        best.metrics,
        best.violation <= FEASIBLE,
        best.violation,
        sum(row.diverged for row in state.history),
        sum(row is not None and row.diverged for row in began),
        state.history,
    )


def advance(problem: Problem, start: Weights, settings: Settings, state: TuneState) -> TuneState:
    """One step: a scattered point, the first point of a descent, an L-BFGS step, or a multiplier update."""
    if state.start < 0:
        if len(state.history) < settings.scatter:
            z = _scattered_point(problem, start, settings, len(state.history))
            point = _point(problem, start, z)
            return replace(state, history=[*state.history, _row(-1, z, point)])
        return _begin(problem, start, settings, state, 0)
    if state.inner >= settings.inner_steps:
        return _update_multipliers(problem, start, settings, state)
    return _descend(problem, start, settings, state)


def _begin(problem, start, settings, state: TuneState, index: int) -> TuneState:
    if index >= settings.starts:
        return replace(state, done=True)
    z = (
        np.asarray(Chart(problem.space, start).coordinates())
        if index == 0
        else _next_start(state.history)
    )
    if z is None:
        return replace(state, done=True)
    point = _point(problem, start, z)
    merit = _first_merit(point.limits.size, point.objective.size)._replace(
        scale=np.max(point.objective)
    )
    state = replace(
        state,
        history=[*state.history, _row(index, z, point)],
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
    return _begin(problem, start, settings, state, index + 1) if bool(point.diverged) else state


def _descend(problem, start, settings, state: TuneState) -> TuneState:
    step, memory = _direction(state.z, state.gradient, state.memory)
    fall = float(step @ state.gradient)
    if -fall < settings.tolerance**2:  # of a Lagrangian of order one
        return replace(state, inner=settings.inner_steps)
    history, length = state.history, 1.0
    for _ in range(TRIALS):
        z = state.z + length * step
        there = _point(problem, start, z, state.merit)
        history = [*history, _row(state.start, z, there)]
        change = np.inf if there.diverged else float(there.lagrangian) - state.lagrangian
        if change <= LEAST_FALL * fall * length:
            reached = replace(state, history=history, z=z, memory=memory, inner=state.inner + 1)
            return replace(reached, lagrangian=float(there.lagrangian), gradient=there.gradient)
        parabola = (
            -fall * length**2 / (2 * (change - fall * length))
        )  # its lowest point through here, slope and there
        length = np.clip(parabola, 0.1 * length, 0.5 * length)
    gave_up = (
        int(state.memory.count) == 0
    )  # steepest descent found nothing either: this is the bottom
    return replace(
        state,
        history=history,
        memory=_fresh(state.z),
        inner=settings.inner_steps if gave_up else state.inner + 1,
    )


def _update_multipliers(problem, start, settings, state: TuneState) -> TuneState:
    assert state.merit is not None  # a descent has begun
    here = _point(problem, start, state.z, state.merit)
    multipliers, penalty, scale, shares = state.merit
    limits = here.limits + LIMIT_MARGIN
    violation = float(
        np.max(np.abs(np.maximum(limits, -multipliers / penalty)), initial=0.0)
    )  # of limits and complementarity
    objective = float(np.max(here.objective))
    overstated = 1 - float(smooth_maximum(here.objective, shares)) / objective
    settled = (
        abs(objective - state.objective) < settings.tolerance * objective
        and abs(overstated) < 10 * settings.tolerance
    )
    converged = violation < LIMIT_MARGIN and settled
    hopeless = violation < NEARLY_FEASIBLE and objective > HOPELESS * _best_so_far(state.history)
    if converged or hopeless or state.outer + 1 >= settings.outer_steps:
        return _begin(problem, start, settings, state, state.start + 1)
    new_scale = np.asarray(objective) if violation < NEARLY_FEASIBLE else scale
    merit = Merit(
        np.maximum(0.0, multipliers + penalty * limits) * scale / new_scale,
        penalty if violation <= max(state.violation / 4, LIMIT_MARGIN / 2) else 4 * penalty,
        new_scale,
        earned_shares(here.objective, shares),
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
    return min(
        (row.objective for row in history if not row.diverged and row.violation <= FEASIBLE),
        default=np.inf,
    )


def _weighed(problem, start, state: TuneState) -> TuneState:
    here = _point(problem, start, state.z, state.merit)
    return replace(state, lagrangian=float(here.lagrangian), gradient=here.gradient)


_lbfgs = optax.scale_by_lbfgs(memory_size=10)
_lbfgs_update = jax.jit(_lbfgs.update)


def _fresh(z: np.ndarray):
    return _lbfgs.init(jnp.asarray(z))


def _direction(z: np.ndarray, gradient, memory) -> tuple[np.ndarray, Any]:
    update, memory = _lbfgs_update(gradient, memory, jnp.asarray(z))
    step, gradient = -np.asarray(update), np.asarray(gradient)
    if not step @ gradient < 0:  # negative curvature spoilt the memory
        step, memory = -gradient, _fresh(z)
    return step * min(1.0, LARGEST_MOVE / max(np.abs(step).max(), 1e-300)), memory


def _point(problem, start, z, merit: Merit | None = None) -> Point:
    merit = (
        _first_merit(*problem.counts()) if merit is None else merit
    )  # a first look is for the numbers only
    return jax.device_get(
        evaluate_point(problem, start, jnp.asarray(z), jax.tree.map(jnp.asarray, merit))
    )


def _first_merit(limits: int, values: int) -> Merit:
    return Merit(
        np.zeros(limits), np.asarray(FIRST_PENALTY), np.asarray(1.0), np.full(values, 1 / values)
    )


def _scattered_point(problem, start, settings: Settings, index: int) -> np.ndarray:
    from scipy.stats.qmc import (
        Sobol,
    )  # here, because it takes longer to import than the rest of the tuner

    z = np.asarray(Chart(problem.space, start).coordinates())
    points = Sobol(z.size, rng=settings.seed).random(2 ** int(np.ceil(np.log2(settings.scatter))))
    return z + settings.spread * (2 * points[index] - 1)


def _row(start: int, z: np.ndarray, point: Point) -> Evaluated:
    objective, violation = (
        float(np.max(point.objective)),
        float(np.max(point.limits, initial=-np.inf)),
    )
    return Evaluated(start, z, objective, violation, point.metrics, bool(point.diverged))


def _next_start(history: list[Evaluated]) -> np.ndarray | None:
    """The most promising scattered point that behaves like no point of the descents so far; None when there is none."""
    seen = np.array([_behaviour(row) for row in history if row.start >= 0 and not row.diverged])
    new = [
        row
        for row in history
        if row.start < 0 and not row.diverged and _apart(_behaviour(row), seen)
    ]
    return min(new, key=_promise).z if new else None


def _behaviour(row: Evaluated) -> np.ndarray:
    """Logarithms of what the loop does: weights that look different may do the same, as a tiny beta does."""
    metrics = row.metrics
    measures = (metrics.rms_contour_error, metrics.rms_tracking_error, metrics.rms_increment)
    return np.log([max(float(np.mean(measure)), 1e-300) for measure in measures])


def _apart(behaviour: np.ndarray, seen: np.ndarray) -> bool:
    return len(seen) == 0 or bool(np.min(np.linalg.norm(seen - behaviour, axis=1)) > NEW_BEHAVIOUR)


def _promise(row: Evaluated) -> float:
    return np.log(max(row.objective, 1e-300)) + PROMISE_LOST * max(row.violation, 0.0)


def _rank(row: Evaluated) -> tuple[float, float]:
    return max(row.violation, FEASIBLE), row.objective
