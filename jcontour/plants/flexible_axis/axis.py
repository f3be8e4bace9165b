"""Linear motor and end effector joined by a spring and a damper (Yuan, section 3.1), any number of axes side by side.

    M_m dv_m = k_t u - k_s (x_m - x_e) - c_s (v_m - v_e) - F_c(x_m) - F_f        (3.1)
    M_e dv_e = k_s (x_m - x_e) + c_s (v_m - v_e)                                 (3.2)
    F_c = sum_j S_j sin(2 pi j x_m / tau) + C_j cos(2 pi j x_m / tau)            (3.7), cogging
with friction F_f as in `friction`. The current loop is ideal. Classical Runge-Kutta substeps under
a control that is held.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from jcontour.plant import Plant
from jcontour.plants.friction import Axes, Friction, caught
from jcontour.plants.integrators import runge_kutta
from jcontour.tracing import is_concrete

# [s] of the reference numbers; shorter ones change the thesis's trajectories by less than 1e-11 m
SUBSTEP = 5e-5
UNROLLED = 2  # substeps in one turn of the loop: a third quicker than one; more gain nothing


class Motion(NamedTuple):
    """Position and speed of motor and end effector [m, m/s]."""

    motor: Axes
    motor_speed: Axes
    tool: Axes
    tool_speed: Axes


class SlidingMotion(NamedTuple):
    """Motion, and whether the motor sticks (0) or slips (-1, 1)."""

    motion: Motion
    mode: Int[Array, " m"]


class AxisParameters(eqx.Module):
    """Of every axis: one number for each.

    Args:
        motor_mass: M_m [kg].
        tool_mass: M_e [kg].
        stiffness: k_s [N/m].
        damping: c_s [N s/m].
        force_constant: k_t [N/A].
        friction: of the motor's guide way.
        cogging_sine: S_j [N], (m, P) or (P,).
        cogging_cosine: C_j [N], likewise.
        pole_pitch: tau [m].

    Raises:
        ValueError: a mass, the force constant or the pitch is not above zero, stiffness or damping
            is negative, or the numbers of harmonics differ or one of them is not finite; or a value
            is there for another number of axes than there are motor masses.
    """

    motor_mass: Axes
    tool_mass: Axes
    stiffness: Axes
    damping: Axes
    force_constant: Axes
    friction: Friction
    cogging_sine: Float[Array, "m P"]
    cogging_cosine: Float[Array, "m P"]
    pole_pitch: Axes

    def __init__(
        self,
        motor_mass,
        tool_mass,
        stiffness,
        damping,
        force_constant,
        friction,
        cogging_sine,
        cogging_cosine,
        pole_pitch,
    ):
        positive = {
            "motor_mass": motor_mass,
            "tool_mass": tool_mass,
            "force_constant": force_constant,
            "pole_pitch": pole_pitch,
        }
        for name, value in {**positive, "stiffness": stiffness, "damping": damping}.items():
            if is_concrete(value):
                numbers = np.asarray(value, float)
                if not np.all(
                    np.isfinite(numbers) & ((numbers > 0) if name in positive else (numbers >= 0))
                ):
                    raise ValueError(
                        f"{name}: needs to be finite and {'above' if name in positive else 'at least'} zero, received {value}"
                    )
            setattr(self, name, jnp.atleast_1d(jnp.asarray(value, float)))
        self.friction = friction
        self.cogging_sine, self.cogging_cosine = (
            jnp.atleast_2d(jnp.asarray(c, float)) for c in (cogging_sine, cogging_cosine)
        )
        if self.cogging_sine.shape != self.cogging_cosine.shape:
            raise ValueError(
                f"cogging_cosine: needs shape {self.cogging_sine.shape}, received {self.cogging_cosine.shape}"
            )
        for name in ("cogging_sine", "cogging_cosine"):
            if is_concrete(getattr(self, name)) and not np.isfinite(getattr(self, name)).all():
                raise ValueError(
                    f"{name}: every entry needs to be finite, received {np.asarray(getattr(self, name))}"
                )
        for name in (
            "tool_mass",
            "stiffness",
            "damping",
            "force_constant",
            "pole_pitch",
            "cogging_sine",
        ):
            if getattr(self, name).shape[0] not in (1, self.axes):
                raise ValueError(
                    f"{name}: needs one value, or one for each of {self.axes} axes, received {getattr(self, name).shape[0]}"
                )

    @property
    def axes(self) -> int:
        """Number of axes m."""
        return self.motor_mass.shape[0]

    def cogging(self, motor: Axes) -> Axes:
        """F_c at a motor position [N], eq. 3.7; harmonics by the angle-addition theorem."""
        angle = 2 * jnp.pi / self.pole_pitch * motor
        first_sine, first_cosine = jnp.sin(angle), jnp.cos(angle)
        sine, cosine, force = first_sine, first_cosine, jnp.zeros_like(motor)
        for j in range(self.cogging_sine.shape[1]):
            force = force + self.cogging_sine[:, j] * sine + self.cogging_cosine[:, j] * cosine
            sine, cosine = (
                sine * first_cosine + cosine * first_sine,
                cosine * first_cosine - sine * first_sine,
            )
        return force

    def drive_force(self, x: Motion, control: Axes) -> Axes:
        """Everything that acts on the motor but friction [N]."""
        return self.force_constant * control - self.cogging(x.motor) - self.link_force(x)

    def link_force(self, x: Motion) -> Axes:
        """What spring and damper carry from the motor to the tool [N]."""
        return self.stiffness * (x.motor - x.tool) + self.damping * (x.motor_speed - x.tool_speed)

    def energy(self, x: Motion) -> Axes:
        """Kinetic energy and that of the spring [J]."""
        kinetic = self.motor_mass * x.motor_speed**2 + self.tool_mass * x.tool_speed**2
        return (kinetic + self.stiffness * (x.motor - x.tool) ** 2) / 2


def thesis_axis() -> AxisParameters:
    """The test bench of the thesis, section 3.3: masses, link, friction and three harmonics of cogging as printed."""
    friction = Friction(coulomb=36.36, stribeck=22.04, stribeck_speed=2.82, viscous=250.9)
    return AxisParameters(
        motor_mass=39.62,
        tool_mass=0.38,
        stiffness=2908.0,
        damping=2.10,
        force_constant=79.33,
        friction=friction,
        cogging_sine=[4.07, 0.95, -0.72],
        cogging_cosine=[9.20, -0.26, 0.57],
        pole_pitch=0.0875,
    )


class _Axis(Plant):
    """What the true axis and its smooth twin share."""

    parameters: AxisParameters
    dt: float = eqx.field(static=True)
    substeps: int = eqx.field(static=True)

    def __init__(self, parameters: AxisParameters, dt: float, substeps: int | None = None):
        """`substeps` per sample; as many as `SUBSTEP` fits into the sample when not given."""
        self.parameters, self.dt = parameters, float(dt)
        if not (np.isfinite(dt) and dt > 0):
            raise ValueError(f"dt: needs to be finite and above zero, received {dt}")
        count = round(dt / SUBSTEP) if substeps is None else substeps
        if substeps is None and (count < 1 or abs(count * SUBSTEP - dt) > 1e-9 * dt):
            raise ValueError(
                f"substeps: {SUBSTEP} s does not divide the sample period {dt} s; give their number"
            )
        if count < 1 or count != int(count):
            raise ValueError(f"substeps: needs a whole number, at least one, received {substeps}")
        self.substeps = int(count)

    @property
    def side_by_side(self) -> bool:
        """A handful of numbers leaves the lanes of a core empty: six axes take hardly longer than one."""
        return True

    def _motion(self, position, increment) -> Motion:
        speed = jnp.asarray(increment) / self.dt
        position = jnp.asarray(position)
        return Motion(position, speed, position, speed)


class FlexibleAxis(_Axis):
    """The axis with stick and slip. It has no useful derivative where it sticks: tune on `SmoothFlexibleAxis`.

    Before a substep a slider at rest may break loose, after it one whose speed has turned sticks:
    see `friction`.

    Raises:
        ValueError: `dt` is not above zero, or the substep does not divide it.
    """

    def initial_state(self, position, increment) -> SlidingMotion:
        """No deformation: at rest and stuck, or at a steady speed."""
        motion = self._motion(position, increment)
        return SlidingMotion(motion, jnp.sign(motion.motor_speed).astype(jnp.int32))

    def step(self, state: SlidingMotion, control: Axes) -> SlidingMotion:
        """Substeps of classical Runge-Kutta with the mode frozen in each."""
        p, h = self.parameters, self.dt / self.substeps

        def substep(_, state: SlidingMotion) -> SlidingMotion:
            mode = p.friction.released(state.mode, p.drive_force(state.motion, control))
            slips = mode != 0

            def rates(x: Motion) -> Motion:
                force = p.drive_force(x, control) - p.friction.slipping(mode, x.motor_speed)
                return Motion(
                    jnp.where(slips, x.motor_speed, 0),
                    jnp.where(slips, force / p.motor_mass, 0),
                    x.tool_speed,
                    p.link_force(x) / p.tool_mass,
                )

            motion = runge_kutta(rates, state.motion, h)
            mode = caught(mode, motion.motor_speed)
            return SlidingMotion(
                motion._replace(motor_speed=jnp.where(mode == 0, 0, motion.motor_speed)), mode
            )

        return jax.lax.fori_loop(0, self.substeps, substep, state, unroll=UNROLLED)

    def output(self, state: SlidingMotion) -> Axes:
        """The end effector [m]."""
        return state.motion.tool

    def measure(self, state: SlidingMotion) -> tuple[Axes, Axes]:
        """Position and speed of the motors: the end effector is not measured."""
        return state.motion.motor, state.motion.motor_speed


class SmoothFlexibleAxis(_Axis):
    """The differentiable twin: friction follows tanh(sharpness v).

    Args:
        parameters: as of the true axis.
        dt: sample period [s].
        sharpness: 1/speed [s/m] within which friction turns; stiff beyond 1 / substep times mass
            over force.

    Raises:
        ValueError: as `FlexibleAxis`.
    """

    sharpness: Float[Array, ""]

    def __init__(
        self,
        parameters: AxisParameters,
        dt: float,
        sharpness: float = 1e3,
        substeps: int | None = None,
    ):  # 1 mm/s
        super().__init__(parameters, dt, substeps)
        self.sharpness = jnp.asarray(sharpness, float)

    def initial_state(self, position, increment) -> Motion:
        """No deformation, at rest or at a steady speed."""
        return self._motion(position, increment)

    def step(self, state: Motion, control: Axes) -> Motion:
        """Substeps of classical Runge-Kutta."""
        p, h = self.parameters, self.dt / self.substeps

        def rates(x: Motion) -> Motion:
            force = p.drive_force(x, control) - p.friction.smooth(x.motor_speed, self.sharpness)
            return Motion(
                x.motor_speed, force / p.motor_mass, x.tool_speed, p.link_force(x) / p.tool_mass
            )

        return jax.lax.fori_loop(
            0, self.substeps, lambda _, x: runge_kutta(rates, x, h), state, unroll=UNROLLED
        )

    def output(self, state: Motion) -> Axes:
        """The end effector [m]."""
        return state.tool

    def measure(self, state: Motion) -> tuple[Axes, Axes]:
        """Position and speed of the motors."""
        return state.motor, state.motor_speed
