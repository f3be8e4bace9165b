"""A tuning problem: controller, machines, contours, objective and limits."""

from collections.abc import Callable
from dataclasses import fields
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from jcontour.controller import Controller
from jcontour.kernels.dispatch import on_gpu
from jcontour.motion.references import Reference
from jcontour.plant import Plant
from jcontour.simulation.evaluation import Batching, Score, evaluate
from jcontour.simulation.limit_use import AxisLimits, LimitUse, limit_use
from jcontour.simulation.metrics import Metrics, score_signals
from tuning.objectives import Entry, Limits, Objective, no_limits
from tuning.outcome import LoopPeaks, Outcome
from tuning.parameters import Chart, Weights

Numbers = Array | np.ndarray  # inside jit or on the host

LEAST = 1e-30  # error [m], or ratio: nothing measurable is smaller, and ln 0 would have no slope


class Problem(eqx.Module):
    """A tuning problem.

    Args:
        build: weights -> controller; traced, so that gradients flow through it.
        plants: the family, stacked; every member counts.
        references: the training contours, stacked.
        objective: metrics (contour, plant) -> rows of values (g, v), see `objectives`.
        limits: outcome -> vector that must not be above zero.
        space: one parameter per weight, see `parameters`.
        window: samples a..b-1 that are scored; all when None.
        batching: how contours are batched, on one device or on several (`devices.Spread`); chosen
            by the platform when None.
        loops: controller, family -> peaks of the frozen loops; they are not looked at when None.
        axis_limits: limits of the machine, whose use is looked at; it is not when None.
    """

    build: Callable[[Weights], Controller] = eqx.field(static=True)
    plants: Plant
    references: Reference
    objective: Objective
    space: object
    limits: Limits = no_limits
    window: tuple[int, int] | None = eqx.field(static=True, default=None)
    batching: Batching | None = eqx.field(static=True, default=None)
    loops: Callable[[Controller, Plant], LoopPeaks] | None = None
    axis_limits: AxisLimits | None = None

    def metrics(self, weights: Weights) -> Metrics:
        """Metrics (contour, plant) of the controller that the weights build."""
        return self._metrics(self.build(weights))

    def outcome(self, weights: Weights) -> Outcome:
        """Metrics, and peaks of the frozen loops where the problem asks for them."""
        controller = self.build(weights)
        loops = None if self.loops is None else self.loops(controller, self.plants)
        if self.axis_limits is None:
            return Outcome(self._metrics(controller), loops)
        metrics, use = self._evaluated(controller, self._score_with_use)
        return Outcome(metrics, loops, use)

    def loop_peaks(self, weights: Weights) -> LoopPeaks:
        """Peaks of the frozen loops alone, without a run.

        Raises:
            ValueError: the problem does not look at its loops.
        """
        if self.loops is None:
            raise ValueError("loops: this problem does not look at its frozen loops")
        return self.loops(self.build(weights), self.plants)

    def counts(self, start: Weights) -> tuple[int, tuple[int, ...]]:
        """Number of limits, and shape (g, v) of the values that the objective returns.

        Raises:
            ValueError: the objective returns no rows, or the limits need what the problem lacks.
        """
        limits, values = jax.eval_shape(self._judged, start)
        if len(values.shape) != 2 or 0 in values.shape:
            raise ValueError(
                f"objective: needs rows of values (g, v), received the shape {values.shape}"
            )
        return limits.size, values.shape

    def limit_entries(self, outcome: Outcome) -> list[Entry]:
        """Names of the entries of the limits, in their order.

        Limits that cannot tell are numbered.
        """
        entries = getattr(self.limits, "entries", None)
        if entries is not None:
            return entries(outcome)
        return [Entry("limit", k, 0) for k in range(self.limits(outcome).size)]

    def _metrics(self, controller: Controller) -> Metrics:
        return self._evaluated(controller, score_signals)

    def _evaluated(self, controller: Controller, score: Score) -> Any:
        return evaluate(controller, self.plants, self.references, self.window, self.batching, score)

    def _score_with_use(self, output, control, reference, window) -> tuple[Metrics, LimitUse]:
        assert self.axis_limits is not None
        use = limit_use(output, control, reference, self.axis_limits)
        return score_signals(output, control, reference, window), use

    def _judged(self, start: Weights) -> tuple[Array, Array]:
        runs = (len(self.references.mask), len(jax.tree.leaves(self.plants)[0]))
        ones = {row.name: jnp.ones(runs) for row in fields(Metrics)}
        metrics = Metrics(**{**ones, "diverged": jnp.ones(runs, bool)})
        loops = None if self.loops is None else self.loop_peaks(start)
        use = None if self.axis_limits is None else LimitUse(*([jnp.ones(runs)] * 4))
        return self.limits(Outcome(metrics, loops, use)), self.objective(metrics)


def objective_value(values: Float[Numbers, "g v"]) -> float:
    """Geometric mean over rows of the largest value of each.

    >>> round(objective_value(np.array([[1.0, 4.0], [9.0, 2.0]])), 12)
    6.0
    """
    largest = np.maximum(np.max(values, axis=-1), LEAST)
    return float(np.exp(np.mean(np.log(largest))))


class Slopes(NamedTuple):
    """Derivatives in z of what is beside them in `Point`."""

    errors: Float[Numbers, "g v d"]
    limits: Float[Numbers, "c d"]
    departures: Float[Numbers, "r d"]


class Point(NamedTuple):
    """One evaluated point.

    Attributes:
        errors: logarithms of the objective's values.
        limits: must not be above zero.
        departures: ln(largest tracking error / size of the contour) of every run; a run diverges
            above zero.
        slopes: of the three.
        outcome: metrics of the runs, and peaks of the loops.
        diverged: whether a run diverges, a loop is unstable, or a number is not finite; then only
            departures may be used.
    """

    errors: Float[Numbers, "g v"]
    limits: Float[Numbers, " c"]
    departures: Float[Numbers, " r"]
    slopes: Slopes
    outcome: Outcome
    diverged: Bool[Numbers, ""]

    @property
    def objective(self) -> float:
        """Value of the objective."""
        return objective_value(np.exp(self.errors))


@eqx.filter_jit
def evaluate_point(problem: Problem, start: Weights, z: Float[Array, " d"]) -> Point:
    """Errors, limits and their slopes at z.

    A point where any member of the family diverges on any contour, or has an unstable frozen loop,
    is `diverged`.
    """

    def judged(z):
        outcome = problem.outcome(Chart(problem.space, start).weights(z))
        errors = _log(problem.objective(outcome.metrics))
        size = problem.references.contour.size[:, None]
        departures = jnp.ravel(_log(outcome.metrics.peak_tracking_error / size))
        numbers = errors, problem.limits(outcome), departures
        return numbers, (numbers, outcome)

    # a CPU has few weights and many numbers; the kernels of a GPU have a reverse mode only
    jacobian = jax.jacrev if on_gpu() else jax.jacfwd
    slopes, (numbers, outcome) = jacobian(judged, has_aux=True)(z)
    judged_numbers = [*numbers[:2], *slopes[:2]]
    finite = jnp.all(jnp.array([jnp.all(jnp.isfinite(number)) for number in judged_numbers]))
    return Point(*numbers, Slopes(*slopes), outcome, outcome.diverged | ~finite)


def _log(value: Float[Array, "*any"]) -> Float[Array, "*any"]:
    return jnp.log(jnp.maximum(value, LEAST))
