"""The industry's loops on each axis: the cascaded P-PI, and the position loop alone.

The cascade is a position loop around a velocity loop.

    v_ref = k_pp (r - y) + k_ff v_r,     e = v_ref - v
    w+ = w + k_pv T_s e / T_iv,          u = k_pv e + w+ + u_r        (Yuan, 3.3)
The position loop is proportional, the velocity loop proportional-integral. The integrator is
updated before it is used. v_r = (r(k+1) - r(k)) / T_s is the velocity of the reference. On top of
the thesis, u_r is the control that the motion of the reference needs,

    u_r = k_a a_r + k_v v_r + k_c sign(v_r),     a_r = (v_r(k) - v_r(k-1)) / T_s.
The integrator is kept as its share w of the control. Against windup w stays within the limits of
the control, as Lam et al. have it (their section 5), and so does u. Without a limit this is the
plain PI. A run begins in equilibrium: w is the control that holds the axis where it stands,
which a drive needs that takes a position.

The proportional position loop with feedforward is the simplest law of a drive.

    u = k_v (k_pp (r - y) + v_r) + k_0 r + k_a a_r

v_r = (r(k+1) - r(k)) / T_s and a_r = (v_r(k) - v_r(k-1)) / T_s are the velocity and acceleration of
the reference. k_v is the control per velocity of a drive that takes a speed, so that k_pp is the
K_v of a position loop in 1/s. A drive that takes a position needs the control k_0 per position.
"""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from jcontour._arrays import check_signs
from jcontour.controller import (
    Axes,
    Controller,
    PerAxis,
    check_axes,
    check_limit,
    check_period,
    checked_period,
    numbers,
)
from jcontour.motion.references import Reference
from jcontour.sensors import Sensors


class CascadeGains(eqx.Module):
    """Gains of the loops: traceable, one number or one for each axis.

    Args:
        position: k_pp [1/s].
        velocity: k_pv, control per m/s.
        integral_time: T_iv [s].
        feedforward: k_ff, the share of the reference's velocity in v_ref; 0 leaves it out, 1
            removes the lag of a ramp.
        inertia: k_a, control per m/s^2; moving mass over force constant where the control is a
            current.
        viscous: k_v, control per m/s against viscous friction.
        coulomb: k_c, control that overcomes dry friction.

    Raises:
        ValueError: a gain is not finite or negative, or the integral time is not above zero.
    """

    position: PerAxis = eqx.field(converter=numbers)
    velocity: PerAxis = eqx.field(converter=numbers)
    integral_time: PerAxis = eqx.field(converter=numbers)
    feedforward: PerAxis = eqx.field(converter=numbers, default=0.0)
    inertia: PerAxis = eqx.field(converter=numbers, default=0.0)
    viscous: PerAxis = eqx.field(converter=numbers, default=0.0)
    coulomb: PerAxis = eqx.field(converter=numbers, default=0.0)

    def __check_init__(self):
        others = "position", "velocity", "feedforward", "inertia", "viscous", "coulomb"
        check_signs(self, positive=("integral_time",), not_negative=others)


class Commanded(eqx.Module):
    """Motion of the reference; T samples as `commanded` makes it, one row in a step."""

    position: Float[Array, "*T m"]  # [m]
    velocity: Float[Array, "*T m"]  # from this sample to the next [m/s]
    acceleration: Float[Array, "*T m"]  # since the sample before [m/s^2]


def commanded(reference: Reference, sensors: Sensors, dt: float) -> Commanded:
    """Motion of every step.

    Raises:
        ValueError: the reference has other axes than the sensors, or another sample period.
    """
    check_axes(sensors.axes, reference)
    check_period(dt, reference)
    velocity = jnp.diff(reference.position[: reference.steps + 1], axis=0) / dt
    before = reference.start_increment[None] / dt
    acceleration = jnp.diff(velocity, axis=0, prepend=before) / dt
    return Commanded(reference.position[: reference.steps], velocity, acceleration)


class CascadePlan(eqx.Module):
    """Commands of every axis; T samples as `prepare` makes it, one row in a step."""

    position: Float[Array, "*T m"]  # [m]
    velocity: Float[Array, "*T m"]  # from this sample to the next [m/s]
    control: Float[Array, "*T m"]  # u_r that the motion needs


class Cascade(Controller):
    """P-PI for every axis of a plant whose positions and velocities are measured.

    >>> from jcontour.sensors import motors
    >>> gains = CascadeGains(position=30.0, velocity=55.67, integral_time=0.04)
    >>> cascade = Cascade(gains, motors(1), dt=1e-3, limit=10.0)
    >>> memory, control = cascade.drive(jnp.zeros(1), error=jnp.array([1.0]))
    >>> round(float(memory[0]), 3), control.tolist()
    (1.392, [10.0])

    Args:
        gains: gains of the loops.
        sensors: where the positions and velocities stand in the measurement.
        dt: sample period T_s [s].
        limit: limit of the control, +-: one number or one for each axis; none when infinite.
        holding: control per m that holds an axis at rest: 1 / K of a drive that takes a position,
            zero of one that takes a speed or a force.

    Raises:
        ValueError: `dt` is not above zero, a limit is not above zero, or the sensors give no
            velocities.
    """

    gains: CascadeGains
    sensors: Sensors
    dt: float = eqx.field(static=True, converter=checked_period)
    limit: PerAxis = eqx.field(converter=numbers, default=np.inf)
    holding: PerAxis = eqx.field(converter=numbers, default=0.0)
    preview: int = eqx.field(static=True, init=False, default=1)

    def __check_init__(self):
        check_limit(self.limit)
        if not self.sensors.velocity:
            raise ValueError(
                "sensors: the velocity loop needs the velocities measured, received positions only"
            )

    def prepare(self, reference: Reference) -> CascadePlan:
        gains, motion = self.gains, commanded(reference, self.sensors, self.dt)
        control = (
            jnp.atleast_2d(gains.inertia) * motion.acceleration
            + jnp.atleast_2d(gains.viscous) * motion.velocity
            + jnp.atleast_2d(gains.coulomb) * direction(motion.velocity * self.dt)
        )
        return CascadePlan(motion.position, motion.velocity, control)

    def initial_memory(self, reference: Reference) -> Axes:
        """Integrators that hold the axes where the reference begins, in the unit of the control."""
        return jnp.clip(self.holding * reference.position[0], -self.limit, self.limit)

    def step(self, memory: Axes, plan: CascadePlan, measurement) -> tuple[Axes, Axes]:
        position, velocity = self.sensors.read(measurement)
        return self.drive(memory, self.speed_command(plan, position) - velocity, plan.control)

    def with_integrals_held(self, before: Axes, after: Axes, holds: Any) -> Axes:
        """The memory is all integrators."""
        return jnp.where(holds, before, after)

    def speed_command(self, plan: CascadePlan, position: Axes) -> Axes:
        """Output v_ref of the position loop [m/s]."""
        gains = self.gains
        return gains.position * (plan.position - position) + gains.feedforward * plan.velocity

    def drive(self, memory: Axes, error: Axes, ahead: ArrayLike = 0.0) -> tuple[Axes, Axes]:
        """Next integrators and the control of the velocity loop, both within the limit.

        Args:
            memory: the integrators w.
            error: e [m/s].
            ahead: control u_r that is fed forward.
        """
        gains = self.gains
        share = gains.velocity * self.dt / gains.integral_time * error
        integral = jnp.clip(memory + share, -self.limit, self.limit)
        control = gains.velocity * error + integral + ahead
        return integral, jnp.clip(control, -self.limit, self.limit)


STANDS = 1e-9  # [m] in a sample: less is rounding of the reference


def direction(increment: Float[Array, "T m"]) -> Float[Array, "T m"]:
    """Sign of every increment of a reference [m]; 0 where it stands, up to its rounding."""
    return jnp.where(jnp.abs(increment) > STANDS, jnp.sign(increment), 0.0)


class PositionLoop(Controller):
    """Proportional position loop for every axis of a plant whose positions are measured.

    >>> loop = PositionLoop(18.0, 50.0, 1.5, Sensors([0]), dt=1e-3)
    >>> at = CascadePlan(jnp.array([1e-3]), jnp.zeros(1), jnp.zeros(1))
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

    position: PerAxis = eqx.field(converter=numbers)
    viscous: PerAxis = eqx.field(converter=numbers)
    inertia: PerAxis = eqx.field(converter=numbers)
    sensors: Sensors
    dt: float = eqx.field(static=True, converter=checked_period)
    level: PerAxis = eqx.field(converter=numbers, default=0.0)
    preview: int = eqx.field(static=True, init=False, default=1)

    def __check_init__(self):
        check_signs(self, not_negative=("position", "viscous", "inertia", "level"))

    def prepare(self, reference: Reference) -> CascadePlan:
        motion = commanded(reference, self.sensors, self.dt)
        control = (
            jnp.atleast_2d(self.level) * motion.position
            + jnp.atleast_2d(self.viscous) * motion.velocity
            + jnp.atleast_2d(self.inertia) * motion.acceleration
        )
        return CascadePlan(motion.position, motion.velocity, control)

    def initial_memory(self, reference: Reference) -> None:
        return None

    def step(
        self, memory: None, plan: CascadePlan, measurement: Array
    ) -> tuple[None, Float[Array, " m"]]:
        error = plan.position - self.sensors.positions(measurement)
        return None, self.viscous * self.position * error + plan.control
