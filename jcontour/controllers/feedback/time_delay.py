"""Time-delay control: what acted one sample ago stands for the disturbance of now.

Youcef-Toumi & Ito (1990); of Youcef-Toumi & Reddy in the volume of 1990 there is no text here, so
this is the textbook algorithm. With y'' = h + b u, whatever h is, and an estimate bhat of b,

    u(k) = u(k-1) + (r'' + k_v (r' - v) + k_p (r - y) - a(k-1)) / bhat
    a(k-1) = (v(k) - v(k-1)) / T
The sampled loop needs about b / bhat < 2, because the old control is undone with bhat and done with
b. The u(k-1) of the law is the control that acted. It stays within the limits of the machine, and
so does u: the sum over the samples does not wind up.
"""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from jcontour._tracing import is_concrete
from jcontour.controller import (
    Controller,
    check_axes,
    check_limit,
    check_period,
    checked_gain,
    checked_period,
)
from jcontour.motion.references import Reference
from jcontour.sensors import Sensors

PerAxis = Float[Array, ""] | Float[Array, " m"]


class Past(NamedTuple):
    """Memory: the last control that acted and the last speed [m/s]."""

    control: Float[Array, " m"]
    speed: Float[Array, " m"]


class Motion(eqx.Module):
    """Position [m], speed [m/s] and acceleration [m/s^2] of the reference."""

    position: Float[Array, "*T m"]
    speed: Float[Array, "*T m"]
    acceleration: Float[Array, "*T m"]


class TimeDelayControl(Controller):
    """Time-delay control of every axis, on measured positions and speeds.

    >>> from jcontour.sensors import motors
    >>> control = TimeDelayControl(400.0, 40.0, 1.0, motors(1), dt=1e-3)
    >>> at_rest = Motion(jnp.array([0.01]), jnp.zeros(1), jnp.zeros(1))
    >>> past = Past(jnp.zeros(1), jnp.zeros(1))
    >>> control.step(past, at_rest, (jnp.zeros(1), jnp.zeros(1)))[1].tolist()
    [4.0]

    Args:
        stiffness: k_p [1/s^2].
        damping: k_v [1/s].
        input_gain: bhat [m/s^2 per unit of control].
        sensors: where positions and speeds stand in the measurement.
        dt: sample period T [s].
        limit: limit of the control, +-: one number or one for each axis; none when infinite.

    Raises:
        ValueError: a gain is negative or not finite, the input gain is zero, `dt` or a limit is
            not above zero, or the sensors give no speeds.
    """

    stiffness: PerAxis
    damping: PerAxis
    input_gain: PerAxis
    sensors: Sensors
    limit: PerAxis
    dt: float = eqx.field(static=True)
    preview: int = eqx.field(static=True, default=1)

    def __init__(
        self,
        stiffness: ArrayLike,
        damping: ArrayLike,
        input_gain: ArrayLike,
        sensors: Sensors,
        dt: float,
        limit: ArrayLike = np.inf,  # a plant without a limit
    ):
        self.stiffness = checked_gain("stiffness", stiffness)
        self.damping = checked_gain("damping", damping)
        self.input_gain = checked_gain("input_gain", input_gain)
        if is_concrete(input_gain) and not np.all(np.asarray(input_gain) > 0):
            raise ValueError(f"input_gain: needs to be above zero, received {input_gain}")
        check_limit(limit)
        if not sensors.velocity:
            raise ValueError("sensors: time-delay control needs speeds, received positions only")
        self.limit = jnp.asarray(limit, float)
        self.sensors, self.dt, self.preview = sensors, checked_period(dt), 1

    def prepare(self, reference: Reference) -> Motion:
        """Positions, speeds and accelerations by differences.

        Raises:
            ValueError: the reference has another sample period or number of axes.
        """
        check_axes(self.sensors.axes, reference)
        check_period(self.dt, reference)
        steps = reference.steps
        speed = jnp.diff(reference.position[: steps + 1], axis=0) / self.dt
        before = reference.start_increment[None] / self.dt
        acceleration = jnp.diff(speed, axis=0, prepend=before) / self.dt
        return Motion(reference.position[:steps], speed, acceleration)

    def initial_memory(self, reference: Reference) -> Past:
        """No control yet, at the speed with which the reference begins."""
        nothing = jnp.zeros(self.sensors.axes, reference.position.dtype)
        return Past(nothing, reference.start_increment / self.dt)

    def step(self, memory: Past, plan: Motion, measurement) -> tuple[Past, Float[Array, " m"]]:
        """Control that adds what is missing to the one that acted, within the limit."""
        position, speed = self.sensors.read(measurement)
        acted = (speed - memory.speed) / self.dt
        wanted = plan.acceleration + self.damping * (plan.speed - speed)
        wanted = wanted + self.stiffness * (plan.position - position)
        free = memory.control + (wanted - acted) / self.input_gain
        control = jnp.clip(free, -self.limit, self.limit)
        return Past(control, speed), control
