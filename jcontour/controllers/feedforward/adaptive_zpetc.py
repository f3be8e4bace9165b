"""Adaptive zero phase error tracking (Tsao & Tomizuka; Smith & Lee, (19)-(21)).

    y(k+1) = -a_1 y(k) + b_0 r(k),    r(k) = (y_d(k+1) + a_1 y_d(k)) / b_0         (21)
    u(k) = k_p (r(k) - y(k)) + u_0

The closed position loop is modelled by one pole. a_1 and b_0 are estimated while the machine
moves. (21) prints r on its right side, for y_d. Positions count from the start of the run,
where u_0 holds a drive that takes a position.

The estimates are those of normalised recursive least squares with a dead zone and a constant
trace (Smith & Lee, (12)-(15)):

    n = max(|phi|, n_0),  x = phi / n,  g = F x,  D = 1 + x'g,  e = y / n - x'theta
    theta+ = theta + g e / D,   F+ = (F - g g'/D) / l,   l = (tr F - g'g/D) / tr F(0)

(15) prints l = 1 - (g'g/D) / tr F(0). It keeps the trace only in exact arithmetic: rounding grows
by 1/l a step. With our l the trace is restored at every step. y in (12) is divided by the same n
as phi.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jcontour._arrays import check_signs, is_concrete
from jcontour.controller import Controller, check_axes, check_period, checked_period, numbers
from jcontour.controllers.wrappers.adapters import WithoutLearning
from jcontour.motion.references import Reference
from jcontour.sensors import Sensors


class Estimate(NamedTuple):
    """Parameters and their gain; any batch of estimators."""

    theta: Float[Array, "*m q"]
    gain: Float[Array, "*m q q"]


class NormalisedLeastSquares(eqx.Module):
    """Estimator of y = theta . phi.

    >>> estimator = NormalisedLeastSquares(trace=2.0)
    >>> start = estimator.start(jnp.zeros(2))
    >>> learned = estimator.update(start, jnp.array([1.0, 0.0]), jnp.array(0.6))
    >>> learned.theta.tolist(), round(float(jnp.trace(learned.gain)), 12)
    ([0.3, 0.0], 2.0)

    Args:
        trace: tr F, which is kept.
        floor: n_0, in the unit of phi: below it phi is not scaled up.
        dead_zone: size of the error y - theta . phi up to which nothing is learned, one number or
            one for each y.

    Raises:
        ValueError: the trace or the floor is not above zero, or the dead zone is negative.
    """

    trace: Float[Array, ""] = eqx.field(converter=numbers)
    floor: Float[Array, ""] = eqx.field(converter=numbers, default=1.0)
    dead_zone: Float[Array, "*#m"] = eqx.field(converter=numbers, default=0.0)

    def __check_init__(self):
        check_signs(self, positive=("trace", "floor"))
        if is_concrete(self.dead_zone) and not np.all(self.dead_zone >= 0):
            raise ValueError(f"dead_zone: cannot be negative, received {self.dead_zone}")

    def start(self, theta: Float[Array | np.ndarray, "*m q"]) -> Estimate:
        """First estimate: F = (trace / q) I."""
        theta = jnp.asarray(theta, float)
        size = theta.shape[-1]
        share = self.trace / size * jnp.eye(size, dtype=theta.dtype)
        return Estimate(theta, jnp.broadcast_to(share, (*theta.shape, size)))

    @jax.jit
    def update(
        self, estimate: Estimate, phi: Float[Array, "*m q"], y: Float[Array, "*m"]
    ) -> Estimate:
        """Estimate after one more sample."""
        theta, F = estimate
        # the square before the root: its slope is finite at phi = 0
        n = jnp.sqrt(jnp.maximum(jnp.sum(phi**2, axis=-1), self.floor**2))
        x = phi / n[..., None]
        g = jnp.einsum("...ij,...j->...i", F, x)
        D = 1 + jnp.sum(x * g, axis=-1)
        error = y / n - jnp.sum(theta * x, axis=-1)
        learned = theta + g * (error / D)[..., None]
        drop = jnp.sum(g**2, axis=-1) / D
        forgetting = (jnp.trace(F, axis1=-2, axis2=-1) - drop) / self.trace
        shrunk = F - g[..., :, None] * g[..., None, :] / D[..., None, None]
        kept = shrunk / forgetting[..., None, None]
        heard = jnp.abs(error * n) > self.dead_zone
        return Estimate(
            jnp.where(heard[..., None], learned, theta), jnp.where(heard[..., None, None], kept, F)
        )


class AdaptiveMemory(NamedTuple):
    """Estimates of every axis, and the regressor of the last sample."""

    estimate: Estimate
    phi: Float[Array, "m 2"]  # (-y, r) [m]


class _Plan(NamedTuple):
    """Desired positions now and next, and where the run starts [m]."""

    now: Float[Array, "*T m"]
    later: Float[Array, "*T m"]
    start: Float[Array, "*T m"]


class AdaptiveZeroPhaseTracking(Controller):
    """A position loop whose filter adapts to the loop, each axis for itself.

    Args:
        gain: k_p, control per m.
        theta: first a_1 and b_0, (2,) for all axes or (m, 2).
        estimator: least squares; `trace` 2 f_0 of the paper, `floor` 1e-3 m: it divides lengths in
            mm by at least one.
        sensors: where the positions stand in the measurement.
        dt: sample period [s].
        smallest: least b_0 that an estimate may have: the model stays invertible.
        holding: control per m that holds an axis at rest, as in `Cascade`.

    Raises:
        ValueError: the gain, `smallest` or `dt` is not above zero, or b_0 begins below `smallest`.
    """

    laws_not_kept = {"restart": "positions are those from the point at which a run begins"}
    gain: Float[Array, "*m"] = eqx.field(converter=numbers)
    theta: Float[Array, "*m 2"] = eqx.field(converter=numbers)
    estimator: NormalisedLeastSquares
    sensors: Sensors
    dt: float = eqx.field(static=True, converter=checked_period)
    # a closed loop of 1 rad/s at 20 ms has b_0 = 0.02
    smallest: Float[Array, ""] = eqx.field(converter=numbers, default=0.02)
    holding: Float[Array, "*m"] = eqx.field(converter=numbers, default=0.0)
    preview: int = eqx.field(static=True, init=False, default=1)

    def __check_init__(self):
        check_signs(self, positive=("gain", "smallest"))
        theta, smallest = self.theta, self.smallest
        if is_concrete(theta, smallest) and not np.all(theta[..., 1] >= smallest):
            raise ValueError(f"theta: b_0 needs to be at least {smallest}, received {theta}")

    def prepare(self, reference: Reference) -> _Plan:
        check_axes(self.sensors.axes, reference)
        check_period(self.dt, reference)
        steps, start = reference.steps, reference.position[:1]
        away = reference.position - start
        return _Plan(away[:steps], away[1 : steps + 1], jnp.broadcast_to(start, away[:steps].shape))

    def initial_memory(self, reference: Reference) -> AdaptiveMemory:
        """First estimates; the empty regressor teaches nothing."""
        axes = reference.position.shape[1]
        theta = jnp.broadcast_to(self.theta, (axes, 2))
        return AdaptiveMemory(self.estimator.start(theta), jnp.zeros_like(theta))

    def without_planned_limits(self) -> WithoutLearning:
        return WithoutLearning(self)

    def step(
        self, memory: AdaptiveMemory, plan: _Plan, measurement
    ) -> tuple[AdaptiveMemory, Float[Array, " m"]]:
        position = self.sensors.positions(measurement) - plan.start
        estimate = self.estimator.update(memory.estimate, memory.phi, position)
        a, b = estimate.theta[:, 0], jnp.maximum(estimate.theta[:, 1], self.smallest)
        estimate = estimate._replace(theta=estimate.theta.at[:, 1].set(b))
        filtered = (plan.later + a * plan.now) / b
        phi = jnp.stack([-position, filtered], axis=-1)
        control = self.gain * (filtered - position) + self.holding * plan.start
        return AdaptiveMemory(estimate, phi), control
