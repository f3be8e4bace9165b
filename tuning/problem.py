"""A tuning problem: controller, machines, contours, objective and limits."""

from collections.abc import Callable
from dataclasses import fields
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from jcontour.controller import Controller
from jcontour.motion.references import Reference
from jcontour.plant import Plant
from jcontour.simulation.evaluation import Batching, evaluate
from jcontour.simulation.metrics import Metrics
from tuning.objectives import Limits, Objective, no_limits
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
        objective: metrics (contour, plant) -> values, the largest of which is made small.
        limits: metrics -> vector that must not be above zero.
        space: one parameter per weight, see `parameters`.
        window: samples a..b-1 that are scored; all when None.
        batching: how contours are batched, on one device or on several (`devices.Spread`); chosen
            by the platform when None.
    """

    build: Callable[[Weights], Controller] = eqx.field(static=True)
    plants: Plant
    references: Reference
    objective: Objective = eqx.field(static=True)
    space: object
    limits: Limits = no_limits
    window: tuple[int, int] | None = eqx.field(static=True, default=None)
    batching: Batching | None = eqx.field(static=True, default=None)

    def metrics(self, weights: Weights) -> Metrics:
        """Metrics (contour, plant) of the controller that the weights build."""
        return evaluate(
            self.build(weights), self.plants, self.references, self.window, self.batching
        )

    def counts(self) -> tuple[int, int]:
        """Number of limits, and of values that the objective returns."""
        runs = (len(self.references.mask), len(jax.tree.leaves(self.plants)[0]))

        def both():
            ones = {row.name: jnp.ones(runs) for row in fields(Metrics)}
            metrics = Metrics(**{**ones, "diverged": jnp.ones(runs, bool)})
            return self.limits(metrics), self.objective(metrics)

        limits, values = jax.eval_shape(both)
        return limits.size, values.size


def smooth_maximum(values: Float[Numbers, " v"], shares: Float[Numbers, " v"]) -> Float[Array, ""]:
    """(sum of share v^p)^(1/p), p = SHARPNESS.

    It is smooth, and exactly the maximum once the shares are its multipliers.

    >>> values = jnp.array([3.0, 3.0])
    >>> round(float(smooth_maximum(values, jnp.array([0.5, 0.5]))), 12)
    3.0
    """
    largest = jax.lax.stop_gradient(jnp.max(values))
    return largest * jnp.sum(shares * (values / largest) ** SHARPNESS) ** (1 / SHARPNESS)


def earned_shares(
    values: Float[Numbers, " v"], shares: Float[Numbers, " v"]
) -> Float[np.ndarray, " v"]:
    """Next shares, in proportion to share v^p.

    This is the exponential method of multipliers for a minimax.
    """
    earned = shares * (values / np.max(values)) ** SHARPNESS
    return np.maximum(earned / np.sum(earned), LEAST_SHARE)


class Merit(NamedTuple):
    """Weights of objective and limits in the augmented Lagrangian."""

    multipliers: Float[Numbers, " c"]
    penalty: Float[Numbers, ""]
    scale: Float[Numbers, ""]  # of the objective
    shares: Float[Numbers, " v"]  # multipliers of the objective's values, with sum one


class Point(NamedTuple):
    """One evaluated point: Lagrangian and gradient for the optimiser, the rest for people."""

    lagrangian: Float[Numbers, ""]
    gradient: Float[Numbers, " d"]
    objective: Float[Numbers, " v"]
    limits: Float[Numbers, " c"]
    metrics: Metrics
    diverged: Bool[Numbers, ""]


@eqx.filter_jit
def evaluate_point(problem: Problem, start: Weights, z: Float[Array, " d"], merit: Merit) -> Point:
    """Augmented Lagrangian at z, with its gradient.

        L = f / scale + sum(max(0, lambda + mu (c + margin))^2 - lambda^2) / (2 mu)

    f is the smooth maximum of the objective's values under the shares they have earned so far.

    A point where any member of the family diverges on any contour is `diverged`; its other numbers
    mean nothing.
    """

    def lagrangian(z):
        metrics = problem.metrics(Chart(problem.space, start).weights(z))
        objective, limits = problem.objective(metrics), problem.limits(metrics)
        pressure = jnp.maximum(0.0, merit.multipliers + merit.penalty * (limits + LIMIT_MARGIN))
        value = smooth_maximum(objective, merit.shares) / merit.scale + jnp.sum(
            pressure**2 - merit.multipliers**2
        ) / (2 * merit.penalty)
        return value, (objective, limits, metrics)

    (value, (objective, limits, metrics)), gradient = jax.value_and_grad(lagrangian, has_aux=True)(
        z
    )
    finite = jnp.isfinite(value) & jnp.all(jnp.isfinite(gradient))
    return Point(value, gradient, objective, limits, metrics, jnp.any(metrics.diverged) | ~finite)
