"""Adaptive robust control of the axes of a cascade (Yao & Tomizuka 1996), desired compensation.

    p = v - r' + k_1 (y - r),   psi = (r'', r', sgn r', 1)
    u = theta . psi - k_a k_1 (v - r') - k_2 p
    theta' = Proj(-gamma psi p)
theta = (k_a, k_v, k_c, load) begins at the feedforward gains of the cascade, k_1 and k_2 are its
position and velocity gains. The projection keeps every estimate within its bounds, so that the
error keeps its robust bound whether they converge or not. The regressors are those of the reference
alone: noise of the encoders teaches nothing. At a limit of the control nothing is learned.
"""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from jcontour.controller import Controller, checked_gain
from jcontour.controllers.feedback.cascade import Cascade, CascadePlan
from jcontour.motion.references import Reference

Axes = Float[Array, " m"]
ACCELERATION, SPEED = 1.0, 0.1  # [m/s^2], [m/s] at which each estimate learns as fast as the load


class RobustPlan(eqx.Module):
    """Commands of the axes, and the regressors of every step."""

    command: CascadePlan
    regressors: Float[Array, "*T m 4"]


class Bounds(NamedTuple):
    """Bounds of the estimates (m, 4)."""

    low: Float[Array, "m 4"]
    high: Float[Array, "m 4"]


class AdaptiveRobust(Controller):
    """Adaptive robust control of every axis, on measured positions and speeds.

    Args:
        cascade: gains, sensors and limits of the axes.
        adaptation: 1/T_i [1/s]: the estimate of a load grows as the integral of a PI with T_i.
        share: part of inertia and viscous friction by which their estimates may be off.
        load: bound of the estimated load, and of dry friction beside its first estimate.

    Raises:
        ValueError: a number is negative or not finite.
    """

    cascade: Cascade
    adaptation: Float[Array, ""]
    share: Float[Array, ""]
    load: Float[Array, ""]
    preview: int = eqx.field(static=True, default=1)

    def __init__(self, cascade: Cascade, adaptation: ArrayLike, share: ArrayLike, load: ArrayLike):
        self.cascade, self.preview = cascade, 1
        self.adaptation = checked_gain("adaptation", adaptation)
        self.share, self.load = checked_gain("share", share), checked_gain("load", load)

    def prepare(self, reference: Reference) -> RobustPlan:
        """Commands, and accelerations, speeds and their signs."""
        plan, dt = self.cascade.prepare(reference), self.cascade.dt
        before = reference.start_increment[None] / dt
        acceleration = jnp.diff(plan.velocity, axis=0, prepend=before) / dt
        ones = jnp.ones_like(acceleration)
        columns = acceleration, plan.velocity, jnp.sign(plan.velocity), ones
        return RobustPlan(plan, jnp.stack(columns, axis=-1))

    def bounds(self) -> Bounds:
        """Bounds of the estimates around the first ones."""
        first, reach = self._first(), self.load * jnp.ones(self.cascade.sensors.axes)
        off = jnp.stack([*(self.share * first[:, i] for i in (0, 1)), reach, reach], axis=1)
        return Bounds(first - off, first + off)

    def initial_memory(self, reference: Reference) -> Float[Array, "m 4"]:
        """First estimates; a load that holds the axes where the reference begins."""
        held = self.cascade.holding * reference.position[0]
        return self._first().at[:, 3].add(held)

    def step(
        self, memory: Float[Array, "m 4"], plan: RobustPlan, measurement
    ) -> tuple[Float[Array, "m 4"], Axes]:
        """Next estimates, and the control within its limit."""
        gains, cascade, psi = self.cascade.gains, self.cascade, plan.regressors
        position, velocity = cascade.sensors.read(measurement)
        faster = velocity - plan.command.velocity
        p = faster + gains.position * (position - plan.command.position)
        free = jnp.sum(memory * psi, axis=1) - gains.velocity * p
        free = free - gains.inertia * gains.position * faster
        control = jnp.clip(free, -cascade.limit, cascade.limit)
        rates = np.array([ACCELERATION**-2, SPEED**-2, 1.0, 1.0])
        learning = (
            self.adaptation * gains.velocity * p * (control == free).astype(float) * cascade.dt
        )
        bounds, held = self.bounds(), (cascade.holding * plan.command.position)[:, None]
        centre = held * np.array([[0.0, 0.0, 0.0, 1.0]])
        moved = memory - learning[:, None] * rates[None] * psi
        return jnp.clip(moved, bounds.low + centre, bounds.high + centre), control

    def _first(self) -> Float[Array, "m 4"]:
        gains, axes = self.cascade.gains, self.cascade.sensors.axes
        values = gains.inertia, gains.viscous, gains.coulomb, jnp.zeros(())
        return jnp.stack([jnp.broadcast_to(one, (axes,)) for one in values], axis=1)
