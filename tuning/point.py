"""Evaluated points: errors, limits and their slopes, and the next start among them.

Runs and frozen loops are two programs; the peaks of the loops are computed on the host; a third,
small program judges both.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jcontour._devices import on_cpu
from tuning.loops import Looked
from tuning.objectives import LEAST, Outcome, logarithm
from tuning.parameters import Chart, Weights
from tuning.problem import Problem


def objective_value(values: Float[np.ndarray, "g v"]) -> float:
    """Geometric mean over rows of the largest value of each.

    >>> round(objective_value(np.array([[1.0, 4.0], [9.0, 2.0]])), 12)
    6.0
    """
    largest = np.maximum(np.max(values, axis=-1), LEAST)
    return float(np.exp(np.mean(np.log(largest))))


class Judged(NamedTuple):
    """What counts of an outcome, or its derivative in z, which comes last."""

    errors: Float[Array | np.ndarray, "g v *d"]
    limits: Float[Array | np.ndarray, "c *d"]
    departures: Float[Array | np.ndarray, "r *d"]


class Point(NamedTuple):
    """One evaluated point, as NumPy arrays."""

    errors: Float[np.ndarray, "g v"]  # logarithms of the objective's values
    limits: Float[np.ndarray, " c"]  # must not be above zero
    # ln(largest tracking error / size of the contour) of every run; a run diverges above zero
    departures: Float[np.ndarray, " r"]
    slopes: Judged  # of the three; in no direction where none are asked for
    outcome: Outcome  # metrics of the runs, and peaks of the loops
    # whether a run diverges, a loop is unstable, or a number is not finite; then only departures
    # may be used
    diverged: bool

    @property
    def objective(self) -> float:
        """Value of the objective."""
        return objective_value(np.exp(self.errors))


def evaluate_point(problem: Problem, start: Weights, z: Float[np.ndarray, " d"]) -> Point:
    """Errors, limits and their slopes at z.

    A point where any member of the family diverges on any contour, or has an unstable frozen loop,
    is `diverged`.

    Raises:
        ValueError: the objective returns no rows, or the limits need what the problem lacks.
    """
    # loops in their own program: where others are looked at, that of the runs stays
    runs = _runs(replace(problem, loops=None), start, jnp.asarray(z))
    (metrics, use), (metric_slopes, use_slopes) = jax.device_get(runs)
    looked, loop_slopes = looked_at(problem, start, z)
    outcome = Outcome(metrics, use=use, **looked._asdict())
    slopes = Outcome(metric_slopes, use=use_slopes, **loop_slopes._asdict())
    judged, judged_slopes = jax.device_get(_judged(problem, outcome, slopes))
    numbers = [*judged[:2], *judged_slopes[:2]]
    finite = all(np.isfinite(number).all() for number in numbers)
    return Point(*judged, judged_slopes, outcome, bool(outcome.diverged) or not finite)


def evaluate_values(problem: Problem, start: Weights, z: Float[np.ndarray, " d"]) -> Point:
    """Errors and limits at z without slopes: a third of the cost of `evaluate_point`.

    Raises:
        ValueError: as `evaluate_point`.
    """
    (metrics, use), matrices = jax.device_get(_values(problem, start, jnp.asarray(z)))
    looked = Looked()
    if problem.loops is not None:
        none = jax.tree.map(lambda matrix: np.zeros((*matrix.shape, 0)), matrices)
        looked = problem.loops.look(matrices, none)[0]
    outcome = Outcome(metrics, use=use, **looked._asdict())
    judged = jax.device_get(_judged_alone(problem, outcome))
    finite = all(np.isfinite(number).all() for number in judged[:2])
    none = Judged(*(np.zeros((*number.shape, 0)) for number in judged))
    return Point(*judged, none, outcome, bool(outcome.diverged) or not finite)


def looked_at(
    problem: Problem, start: Weights, z: Float[Array | np.ndarray, " d"]
) -> tuple[Looked, Looked]:
    """What is seen of the frozen loops, and its slopes; nothing where they are not looked at."""
    if problem.loops is None:
        return Looked(), Looked()
    with on_cpu():  # in forward mode
        loops = jax.device_get(_loops(problem, start, jnp.asarray(z)))
    return problem.loops.look(*loops)


@eqx.filter_jit
def _runs(problem: Problem, start: Weights, z: Float[Array, " d"]) -> tuple[Any, Any]:
    """Metrics and use of the limits, and their slopes."""
    return _with_slopes(problem.runs, Chart(problem.space, start), z)


@eqx.filter_jit
def _loops(problem: Problem, start: Weights, z: Float[Array, " d"]) -> tuple[Any, Any]:
    """Matrices of the frozen loops, and their slopes."""
    loops = problem.loops
    assert loops is not None

    def matrices(weights: Weights) -> Any:
        return loops.matrices(problem.plants, problem.build(weights))

    return _with_slopes(matrices, Chart(problem.space, start), z)


def _with_slopes(function, chart: Chart, z: Float[Array, " d"]) -> tuple[Any, Any]:
    """Arrays of a function of the weights, and derivatives in z of those that are floats.

    In forward mode: there are few weights, and many numbers of many runs.
    """

    def moving(z):
        arrays = function(chart.weights(z))
        return eqx.filter(arrays, eqx.is_inexact_array), arrays

    slopes, arrays = jax.jacfwd(moving, has_aux=True)(z)
    return arrays, slopes


@eqx.filter_jit
def _values(problem: Problem, start: Weights, z: Float[Array, " d"]) -> tuple[Any, Any]:
    """Metrics and use of the limits, and matrices of the frozen loops."""
    weights, loops = Chart(problem.space, start).weights(z), problem.loops
    matrices = None if loops is None else loops.matrices(problem.plants, problem.build(weights))
    return problem.runs(weights), matrices


def _judge(problem: Problem, outcome: Outcome) -> Judged:
    errors = problem.objective(outcome)
    if errors.ndim != 2 or 0 in errors.shape:
        raise ValueError(
            f"objective: needs rows of values (g, v), received the shape {errors.shape}"
        )
    size = problem.references.contour.size[:, None]
    departures = jnp.ravel(logarithm(outcome.metrics.peak_tracking_error / size))
    return Judged(logarithm(errors), problem.limits(outcome), departures)


_judged_alone = eqx.filter_jit(_judge)


@eqx.filter_jit
def _judged(problem: Problem, outcome: Outcome, slopes: Outcome) -> tuple[Judged, Judged]:
    moving, fixed = eqx.partition(outcome, eqx.is_inexact_array)

    def judge(moving: Outcome) -> Judged:
        return _judge(problem, eqx.combine(moving, fixed))

    def slope(direction: Outcome) -> Judged:
        return jax.jvp(judge, (moving,), (direction,))[1]

    return judge(moving), jax.vmap(slope, in_axes=-1, out_axes=-1)(slopes)


FEASIBLE = 1e-6  # a limit may be exceeded by this relative amount
# ln(objective) that an excess of one costs, where no multiplier is known yet
PRICE = 5.0
# distance in ln(error, error, increment) from every descent so far that makes a start worth while
NEW_BEHAVIOUR = 0.5


class Evaluated(NamedTuple):
    """One row of the history: a point that was tried, and its outcome."""

    start: int  # number of the descent; -1 for a scattered point
    z: np.ndarray
    objective: float
    violation: float  # largest limit, ln(value / limit); -inf without limits
    outcome: Outcome
    diverged: bool


def sound(history: Sequence[Evaluated]) -> list[Evaluated]:
    """Points that did not diverge."""
    return [row for row in history if not row.diverged]


def rank(row: Evaluated) -> tuple[float, float]:
    """Order of points: the least violation first, and of the feasible ones the least objective."""
    return max(row.violation, FEASIBLE), row.objective


def next_start(
    history: Sequence[Evaluated], prices: Float[np.ndarray, " n"]
) -> Float[np.ndarray, " d"] | None:
    """The most promising scattered point whose loop behaves unlike all descents so far, or None.

    Its promise is ln(objective) + price * violation. Where nothing is feasible yet, the least
    violation comes first; where everything diverged, the least departure from the contours.

    Args:
        history: every point so far.
        prices: sum of the multipliers at the end of every descent; the largest counts.
    """
    tried = {row.z.tobytes() for row in history if row.start >= 0}
    left = [row for row in history if row.start < 0 and row.z.tobytes() not in tried]
    rows = sound(history)
    if not rows:
        return min(left, key=_departure).z if left else None
    seen = np.array([_behaviour(row) for row in rows if row.start >= 0])
    new = [row for row in sound(left) if _apart(_behaviour(row), seen)]
    if not new:
        return None
    if all(row.violation > FEASIBLE for row in rows):
        return min(new, key=rank).z
    price = float(np.max(prices, initial=PRICE))
    promise = [np.log(max(one.objective, 1e-300)) + price * max(one.violation, 0.0) for one in new]
    return new[int(np.argmin(promise))].z


def _behaviour(row: Evaluated) -> np.ndarray:
    """Logarithms of the mean errors and increment of the loop.

    Weights that look different may behave alike, as all tiny betas do.
    """
    metrics = row.outcome.metrics
    measures = (metrics.rms_contour_error, metrics.rms_tracking_error, metrics.rms_increment)
    return np.log([max(float(np.mean(measure)), 1e-300) for measure in measures])


def _apart(behaviour: np.ndarray, seen: np.ndarray) -> bool:
    return len(seen) == 0 or bool(np.min(np.linalg.norm(seen - behaviour, axis=1)) > NEW_BEHAVIOUR)


def _departure(row: Evaluated) -> float:
    largest = float(np.max(row.outcome.metrics.peak_tracking_error))
    return largest if np.isfinite(largest) else np.inf
