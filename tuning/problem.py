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
from jcontour.motion.references import Reference
from jcontour.plant import Plant
from jcontour.simulation.evaluation import Batching, Score, evaluate
from jcontour.simulation.limit_use import AxisLimits, LimitUse, limit_use
from jcontour.simulation.metrics import Metrics, score_signals
from tuning.objectives import Entry, Limits, Objective, no_limits
from tuning.outcome import LoopPeaks, Outcome
from tuning.parameters import Chart, Weights

Numbers = Array | np.ndarray  # inside jit or on the host

# exponent of the smooth maximum: low enough for a curved valley to stay easy
SHARPNESS = 16.0
LEAST_SHARE = 1e-6  # a value that does not matter now may come back
# the tuner aims this much inside every limit: its last point is feasible to 1e-6 without a repair
LIMIT_MARGIN = 1e-5


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


def geometric_mean(rows: Float[Numbers, " g"]) -> Float[Array, ""]:
    """(prod of rows)^(1/g)."""
    return jnp.exp(jnp.mean(jnp.log(jnp.maximum(rows, 1e-300))))


def objective_value(values: Float[Numbers, "g v"]) -> float:
    """Geometric mean over rows of the largest value of each.

    >>> round(objective_value(np.array([[1.0, 4.0], [9.0, 2.0]])), 12)
    6.0
    """
    return float(geometric_mean(np.max(values, axis=-1)))


def smooth_maximum(
    values: Float[Numbers, "*g v"], shares: Float[Numbers, "*g v"]
) -> Float[Array, "*g"]:
    """(sum of share v^p)^(1/p) of every row, p = SHARPNESS.

    It is smooth, and exactly the maximum once the shares are its multipliers.

    >>> values = jnp.array([3.0, 3.0])
    >>> round(float(smooth_maximum(values, jnp.array([0.5, 0.5]))), 12)
    3.0
    """
    largest = jax.lax.stop_gradient(jnp.max(values, axis=-1, keepdims=True))
    powers = jnp.sum(shares * (values / largest) ** SHARPNESS, axis=-1)
    return largest[..., 0] * powers ** (1 / SHARPNESS)


def earned_shares(
    values: Float[Numbers, "*g v"], shares: Float[Numbers, "*g v"]
) -> Float[np.ndarray, "*g v"]:
    """Next shares, in proportion to share v^p within every row.

    This is the exponential method of multipliers for a minimax.
    """
    earned = shares * (values / np.max(values, axis=-1, keepdims=True)) ** SHARPNESS
    return np.maximum(earned / np.sum(earned, axis=-1, keepdims=True), LEAST_SHARE)


class Merit(NamedTuple):
    """Weights of objective and limits in the augmented Lagrangian."""

    multipliers: Float[Numbers, " c"]
    penalty: Float[Numbers, ""]
    scale: Float[Numbers, ""]  # of the objective
    shares: Float[Numbers, "g v"]  # multipliers of the objective's values; sum one in every row


class Point(NamedTuple):
    """One evaluated point: Lagrangian and gradient for the optimiser, the rest for people."""

    lagrangian: Float[Numbers, ""]
    gradient: Float[Numbers, " d"]
    objective: Float[Numbers, "g v"]
    limits: Float[Numbers, " c"]
    outcome: Outcome
    diverged: Bool[Numbers, ""]


@eqx.filter_jit
def evaluate_point(problem: Problem, start: Weights, z: Float[Array, " d"], merit: Merit) -> Point:
    """Augmented Lagrangian at z, with its gradient.

        L = f / scale + sum(max(0, lambda + mu (c + margin))^2 - lambda^2) / (2 mu)

    f is the geometric mean over rows of the smooth maximum of the objective's values, under the
    shares they have earned so far.

    A point where any member of the family diverges on any contour, or has an unstable frozen loop,
    is `diverged`; its other numbers mean nothing.
    """

    def lagrangian(z):
        outcome = problem.outcome(Chart(problem.space, start).weights(z))
        objective, limits = problem.objective(outcome.metrics), problem.limits(outcome)
        pressure = jnp.maximum(0.0, merit.multipliers + merit.penalty * (limits + LIMIT_MARGIN))
        rows = smooth_maximum(objective, merit.shares)
        value = geometric_mean(rows) / merit.scale + jnp.sum(pressure**2 - merit.multipliers**2) / (
            2 * merit.penalty
        )
        return value, (objective, limits, outcome)

    (value, (objective, limits, outcome)), gradient = jax.value_and_grad(lagrangian, has_aux=True)(
        z
    )
    finite = jnp.isfinite(value) & jnp.all(jnp.isfinite(gradient))
    return Point(value, gradient, objective, limits, outcome, outcome.diverged | ~finite)
