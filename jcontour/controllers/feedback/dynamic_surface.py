"""Dynamic surface control of the axes of a cascade (Swaroop, Hedrick, Yip & Gerdes 2000).

Backstepping whose virtual control passes a lag, so that it needs no derivative:

    v* = r' + k_1 (r - y)
    tau alpha' + alpha = v*
    u = k_a alpha' + k_v r' + k_c sgn r' + k_2 (alpha - v),   alpha' = (v* - alpha) / tau
k_1, k_2, k_a, k_v, k_c are the position gain, the velocity gain and the feedforward gains of the
cascade; its integral time is not used. The lag is exact for a v* that is held over the sample.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from jcontour._tracing import is_concrete
from jcontour.controller import Controller
from jcontour.controllers.feedback.cascade import Cascade, CascadePlan
from jcontour.motion.references import Reference

Axes = Float[Array, " m"]


class DynamicSurface(Controller):
    """Dynamic surface control of every axis, on measured positions and speeds.

    Args:
        cascade: gains, sensors and limits of the axes.
        lag: tau [s], one number or one for each axis.

    Raises:
        ValueError: the lag is not above zero.
    """

    cascade: Cascade
    lag: Float[Array, ""] | Float[Array, " m"]
    preview: int = eqx.field(static=True, default=1)

    def __init__(self, cascade: Cascade, lag: ArrayLike):
        if is_concrete(lag) and not np.all(np.isfinite(lag) & (np.asarray(lag) > 0)):
            raise ValueError(f"lag: needs to be finite and above zero, received {lag}")
        self.cascade, self.lag, self.preview = cascade, jnp.asarray(lag, float), 1

    def prepare(self, reference: Reference) -> CascadePlan:
        """Commands of the axes; the control holds no inertia, alpha' has it."""
        plan, gains = self.cascade.prepare(reference), self.cascade.gains
        control = jnp.atleast_2d(gains.viscous) * plan.velocity
        control = control + jnp.atleast_2d(gains.coulomb) * jnp.sign(plan.velocity)
        return CascadePlan(plan.position, plan.velocity, control)

    def initial_memory(self, reference: Reference) -> Axes:
        """Filtered speed: that with which the machine enters [m/s]."""
        return reference.start_increment / self.cascade.dt

    def step(self, memory: Axes, plan: CascadePlan, measurement) -> tuple[Axes, Axes]:
        """Next filtered speed, and the control within its limit."""
        gains, cascade = self.cascade.gains, self.cascade
        position, velocity = cascade.sensors.read(measurement)
        wanted = plan.velocity + gains.position * (plan.position - position)
        slope = (wanted - memory) / self.lag
        control = gains.inertia * slope + plan.control + gains.velocity * (memory - velocity)
        filtered = wanted + jnp.exp(-cascade.dt / self.lag) * (memory - wanted)
        hold = cascade.holding * plan.position
        return filtered, jnp.clip(control + hold, -cascade.limit, cascade.limit)
