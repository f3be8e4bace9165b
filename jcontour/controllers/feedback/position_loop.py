"""Proportional position loop with feedforward, the simplest law of a drive.

    u = k_v (k_pp (r - y) + v_r) + k_0 r + k_a a_r

v_r = (r(k+1) - r(k)) / T_s and a_r = (v_r(k) - v_r(k-1)) / T_s are the velocity and acceleration of
the reference. k_v is the control per velocity of a drive that takes a speed, so that k_pp is the
K_v of a position loop in 1/s. A drive that takes a position needs the control k_0 per position.
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from jcontour.controller import Controller, check_axes, check_period, checked_gain, checked_period
from jcontour.motion.references import Reference
from jcontour.sensors import Sensors

PerAxis = Float[Array, ""] | Float[Array, " m"]  # one number, or one for each axis


class PositionLoopPlan(eqx.Module):
    """Commands of every axis; T samples as `PositionLoop.prepare` makes it, one row in a step."""

    position: Float[Array, "*T m"]  # [m]
    control: Float[Array, "*T m"]  # that the motion needs


class PositionLoop(Controller):
    """Proportional position loop for every axis of a plant whose positions are measured.

    >>> loop = PositionLoop(18.0, 50.0, 1.5, Sensors([0]), dt=1e-3)
    >>> at = PositionLoopPlan(position=jnp.array([1e-3]), control=jnp.array([0.0]))
    >>> loop.step(None, at, jnp.array([0.0]))[1].tolist()
    [0.9]

    Args:
        position: k_pp [1/s].
        viscous: k_v, control per m/s.
        inertia: k_a, control per m/s^2.
        sensors: where the positions stand in the measurement.
        dt: sample period T_s [s].
        level: k_0, control per m.

    Raises:
        ValueError: a gain is not finite or negative, or `dt` is not above zero.
    """

    position: PerAxis
    viscous: PerAxis
    inertia: PerAxis
    level: PerAxis
    sensors: Sensors
    dt: float = eqx.field(static=True)
    preview: int = eqx.field(static=True, default=1)

    def __init__(
        self,
        position: ArrayLike,
        viscous: ArrayLike,
        inertia: ArrayLike,
        sensors: Sensors,
        dt: float,
        level: ArrayLike = 0.0,
    ):
        self.position = checked_gain("position", position)
        self.viscous = checked_gain("viscous", viscous)
        self.inertia = checked_gain("inertia", inertia)
        self.level = checked_gain("level", level)
        self.sensors, self.dt, self.preview = sensors, checked_period(dt), 1

    def prepare(self, reference: Reference) -> PositionLoopPlan:
        """Positions, and the feedforward of the control.

        Raises:
            ValueError: the reference has another sample period or number of axes.
        """
        check_axes(self.sensors.axes, reference)
        check_period(self.dt, reference)
        steps, start = reference.steps, reference.start_increment
        position = reference.position[:steps]
        velocity = (reference.position[1 : steps + 1] - position) / self.dt
        acceleration = jnp.diff(velocity, axis=0, prepend=start[None] / self.dt) / self.dt
        control = (
            jnp.atleast_2d(self.level) * position
            + jnp.atleast_2d(self.viscous) * velocity
            + jnp.atleast_2d(self.inertia) * acceleration
        )
        return PositionLoopPlan(position, control)

    def initial_memory(self, reference: Reference) -> None:
        """None: the law keeps nothing."""
        return None

    def step(
        self, memory: None, plan: PositionLoopPlan, measurement: Array
    ) -> tuple[None, Float[Array, " m"]]:
        """Control of the sample."""
        error = plan.position - self.sensors.positions(measurement)
        return None, self.viscous * self.position * error + plan.control
