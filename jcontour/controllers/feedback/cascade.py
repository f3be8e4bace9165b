"""Cascaded P-PI, the industry's standard: a proportional position loop around a proportional-integral velocity loop, one for each axis.

    v_ref = k_pp (r - y) + k_ff v_r,     e = v_ref - v
    w+ = w + k_pv T_s e / T_iv,          u = k_pv e + w+ + u_r        (Yuan, 3.3; the integrator is
    updated before it is used)
with the reference's velocity v_r = (r(k+1) - r(k)) / T_s and, on top of the thesis, what its motion
needs of the motor,
    u_r = k_a a_r + k_v v_r + k_c sign(v_r),     a_r = (v_r(k) - v_r(k-1)) / T_s.
The integrator is kept as its share w of the control. Against windup w stays within the limits of
the control, as Lam et al. have it (their section 5), and so does u. Without a limit this is the
plain PI.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from jcontour.controller import Controller, check_limit, check_period, checked_gain
from jcontour.motion.references import Reference
from jcontour.sensors import Sensors
from jcontour.tracing import is_concrete


class CascadeGains(eqx.Module):
    """Gains of the loops: traceable, one number or one for each axis.

    Args:
        position: k_pp [1/s].
        velocity: k_pv, control per m/s.
        integral_time: T_iv [s].
        feedforward: k_ff, the share of the reference's velocity that is added to v_ref; 0 leaves it
            out, 1 removes the lag of a ramp.
        inertia: k_a, control per m/s^2; moving mass over force constant where the control is a
            current.
        viscous: k_v, control per m/s; that of the friction.
        coulomb: k_c, control that overcomes dry friction.

    Raises:
        ValueError: a gain is not finite or negative, or the integral time is not above zero.
    """

    position: Float[Array, "*m"]
    velocity: Float[Array, "*m"]
    integral_time: Float[Array, "*m"]
    feedforward: Float[Array, "*m"]
    inertia: Float[Array, "*m"]
    viscous: Float[Array, "*m"]
    coulomb: Float[Array, "*m"]

    def __init__(
        self,
        position,
        velocity,
        integral_time,
        feedforward: ArrayLike = 0.0,
        inertia: ArrayLike = 0.0,
        viscous: ArrayLike = 0.0,
        coulomb: ArrayLike = 0.0,
    ):
        loops = {
            "position": position,
            "velocity": velocity,
            "integral_time": integral_time,
            "feedforward": feedforward,
        }
        for name, value in {
            **loops,
            "inertia": inertia,
            "viscous": viscous,
            "coulomb": coulomb,
        }.items():
            setattr(self, name, checked_gain(name, value))
        if is_concrete(integral_time) and not np.all(np.asarray(integral_time) > 0):
            raise ValueError(f"integral_time: needs to be above zero, received {integral_time}")


class CascadePlan(eqx.Module):
    """Where every axis should be [m], its velocity from there to the next sample [m/s], and the control u_r that the motion needs."""

    position: Float[Array, "T m"]
    velocity: Float[Array, "T m"]
    control: Float[Array, "T m"]


class Cascade(Controller):
    """P-PI for every axis of a plant whose positions and velocities are measured.

    Args:
        gains: of the loops.
        sensors: what to read.
        dt: sample period T_s [s].
        limit: of the control, +-: one number or one for each axis; none when infinite.

    Raises:
        ValueError: `dt` is not above zero, a limit is not above zero, or the sensors give no
            velocities.
    """

    gains: CascadeGains
    sensors: Sensors
    limit: Float[Array, "*m"]
    dt: float = eqx.field(static=True)
    preview: int = eqx.field(static=True, default=1)

    def __init__(
        self,
        gains: CascadeGains,
        sensors: Sensors,
        dt: float,
        limit: Float[ArrayLike, "*m"] = np.inf,
    ):
        if not (np.isfinite(dt) and dt > 0):
            raise ValueError(
                f"dt: the sample period needs to be a positive number of seconds, received {dt}"
            )
        check_limit(limit)
        if not sensors.velocity:
            raise ValueError(
                "sensors: the velocity loop needs the velocities measured, received positions only"
            )
        self.gains, self.sensors, self.dt, self.limit, self.preview = (
            gains,
            sensors,
            float(dt),
            jnp.asarray(limit, float),
            1,
        )

    def prepare(self, reference: Reference) -> CascadePlan:
        """Positions, velocities by the difference to the next sample, and the feedforward of the control.

        Raises:
            ValueError: the reference has another sample period or number of axes.
        """
        axes = self.sensors.axes
        if reference.position.shape[-1] != axes:
            raise ValueError(
                f"sensors: the reference has {reference.position.shape[-1]} axes, the controller reads {axes}"
            )
        check_period(self.dt, reference)
        now, later = (
            reference.position[: reference.steps],
            reference.position[1 : reference.steps + 1],
        )
        velocity, gains = (later - now) / self.dt, self.gains
        acceleration = (
            jnp.diff(velocity, axis=0, prepend=reference.start_increment[None] / self.dt) / self.dt
        )
        control = (
            gains.inertia * acceleration
            + gains.viscous * velocity
            + gains.coulomb * jnp.sign(velocity)
        )
        return CascadePlan(now, velocity, control)

    def initial_memory(self, reference: Reference) -> Float[Array, " m"]:
        """Integrators at zero, in the unit of the control."""
        return jnp.zeros(self.sensors.axes, reference.position.dtype)

    def step(
        self, memory, plan: CascadePlan, measurement
    ) -> tuple[Float[Array, " m"], Float[Array, " m"]]:
        """Next integrators and the control, both within the limit."""
        position, velocity = self.sensors.read(measurement)
        return self.drive(memory, self.speed_command(plan, position) - velocity, plan.control)

    def speed_command(self, plan: CascadePlan, position: Float[Array, " m"]) -> Float[Array, " m"]:
        """The position loop: v_ref [m/s]."""
        return (
            self.gains.position * (plan.position - position)
            + self.gains.feedforward * plan.velocity
        )

    def drive(
        self, memory, error: Float[Array, " m"], ahead: Float[ArrayLike, "*m"] = 0.0
    ) -> tuple[Float[Array, " m"], Float[Array, " m"]]:
        """The velocity loop: next integrators and the control for its error e [m/s] beside what is fed `ahead`, both within the limit."""
        gains = self.gains
        integral = jnp.clip(
            memory + gains.velocity * self.dt / gains.integral_time * error, -self.limit, self.limit
        )
        return integral, jnp.clip(
            gains.velocity * error + integral + ahead, -self.limit, self.limit
        )
