"""Linear motor and end effector joined by a spring and a damper (Yuan, section 3.1).

    M_m dv_m = k_t u - k_s (x_m - x_e) - c_s (v_m - v_e) - F_c(x_m) - F_f        (3.1)
    M_e dv_e = k_s (x_m - x_e) + c_s (v_m - v_e)                                 (3.2)
    F_c = sum_j S_j sin(2 pi j x_m / tau) + C_j cos(2 pi j x_m / tau)            (3.7), cogging
with friction F_f as in `friction`, for any number of axes. The current loop is ideal. A sample is
integrated by classical Runge-Kutta substeps under a held control.

Its linear models are eqs. 3.1, 3.2 without dry friction and cogging. The viscous part is kept. The
state is [x_m, v_m, x_e, v_e], each for all m axes: the measured states come first. The output is
the end effector.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from jcontour._arrays import check_signs, is_concrete, ranked
from jcontour.linear.plant import LinearPlant, Pattern
from jcontour.linear.transformations import zoh
from jcontour.plant import Plant
from jcontour.plants.friction import Friction, by_axis, caught, runge_kutta, substeps_of

# [s] of the reference numbers; shorter ones change the thesis's trajectories by less than 1e-11 m
SUBSTEP = 5e-5
UNROLLED = 2  # substeps in one turn of the loop: a third quicker than one; more gain nothing

Axes = Float[Array, " m"]
PerAxis = Float[Array, "#m"]  # one value, or one for each axis
Harmonics = Float[Array, "#m P"]  # P harmonics, one row or one for each axis
NOT_NEGATIVE = ("stiffness", "damping")
POSITIVE = ("motor_mass", "tool_mass", "force_constant", "pole_pitch")


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


def _harmonics(value) -> Harmonics:
    return ranked(value, 2)


class AxisParameters(eqx.Module):
    """Masses, link, motor, friction and cogging: one number each, or one for each axis.

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

    motor_mass: Axes = eqx.field(converter=by_axis)
    tool_mass: PerAxis = eqx.field(converter=by_axis)
    stiffness: PerAxis = eqx.field(converter=by_axis)
    damping: PerAxis = eqx.field(converter=by_axis)
    force_constant: PerAxis = eqx.field(converter=by_axis)
    friction: Friction
    cogging_sine: Harmonics = eqx.field(converter=_harmonics)
    cogging_cosine: Harmonics = eqx.field(converter=_harmonics)
    pole_pitch: PerAxis = eqx.field(converter=by_axis)

    def __check_init__(self):
        check_signs(self, POSITIVE, NOT_NEGATIVE)
        wanted, found = self.cogging_sine.shape, self.cogging_cosine.shape
        if wanted != found:
            raise ValueError(f"cogging_cosine: needs shape {wanted}, received {found}")
        for name in ("cogging_sine", "cogging_cosine"):
            value = getattr(self, name)
            if is_concrete(value) and not np.isfinite(value).all():
                raise ValueError(
                    f"{name}: every entry needs to be finite, received {np.asarray(value)}"
                )
        for name in (*POSITIVE, *NOT_NEGATIVE, "cogging_sine"):
            count = getattr(self, name).shape[0]
            if count not in (1, self.axes):
                wanted = f"one value, or one for each of {self.axes} axes"
                raise ValueError(f"{name}: needs {wanted}, received {count}")

    @property
    def axes(self) -> int:
        """Number of axes m."""
        return self.motor_mass.shape[0]

    def cogging(self, motor: Axes) -> Axes:
        """Cogging F_c at a motor position [N], eq. 3.7; harmonics by the angle-addition theorem."""
        angle = 2 * jnp.pi / self.pole_pitch * motor
        first_sine, first_cosine = jnp.sin(angle), jnp.cos(angle)
        sine, cosine, force = first_sine, first_cosine, jnp.zeros_like(motor)
        for j in range(self.cogging_sine.shape[1]):
            force = force + self.cogging_sine[:, j] * sine + self.cogging_cosine[:, j] * cosine
            next_sine = sine * first_cosine + cosine * first_sine
            next_cosine = cosine * first_cosine - sine * first_sine
            sine, cosine = next_sine, next_cosine
        return force

    def drive_force(self, x: Motion, control: Axes) -> Axes:
        """Force on the motor of the current, cogging and the link, without friction [N]."""
        return self.force_constant * control - self.cogging(x.motor) - self.link_force(x)

    def link_force(self, x: Motion) -> Axes:
        """Force of spring and damper, from the motor to the tool [N]."""
        return self.stiffness * (x.motor - x.tool) + self.damping * (x.motor_speed - x.tool_speed)


def thesis_axis() -> AxisParameters:
    """Test bench of the thesis as printed in section 3.3, with three harmonics of cogging."""
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
    """Common part of the true axis and its smooth twin."""

    parameters: AxisParameters
    dt: float = eqx.field(static=True)
    substeps: int = eqx.field(static=True)

    def __init__(self, parameters: AxisParameters, dt: float, substeps: int | float | None = None):
        """Take `substeps` per sample; as many as `SUBSTEP` fits into the sample when not given."""
        self.parameters, self.dt = parameters, float(dt)
        self.substeps = substeps_of(dt, substeps, SUBSTEP)

    @property
    def side_by_side(self) -> bool:
        """True: few numbers leave a core's lanes empty; six axes take hardly longer than one."""
        return True

    @property
    def alike_everywhere(self) -> tuple[bool, ...]:
        """Axes without cogging, a force of the place."""
        p = self.parameters
        harmonics = np.abs(p.cogging_sine) + np.abs(p.cogging_cosine)
        return tuple((harmonics.max(axis=-1) == 0.0).tolist())

    def _motion(self, position, increment) -> Motion:
        speed = jnp.asarray(increment) / self.dt
        position = jnp.asarray(position)
        return Motion(position, speed, position, speed)


class FlexibleAxis(_Axis):
    """The axis with stick and slip.

    It has no useful derivative where it sticks: tune on `SmoothFlexibleAxis`. Before each substep a
    slider at rest may break loose. After it a slider whose speed has turned sticks; see `friction`.

    >>> axis = FlexibleAxis(thesis_axis(), dt=1e-3)
    >>> rest = axis.initial_state(jnp.zeros(1), jnp.zeros(1))
    >>> [bool(axis.output(axis.step(rest, jnp.array([current])))[0] > 0) for current in (0.7, 1.0)]
    [False, True]

    Raises:
        ValueError: `dt` is not above zero, or the substep does not divide it.
    """

    def initial_state(self, position, increment) -> SlidingMotion:
        motion = self._motion(position, increment)
        return SlidingMotion(motion, jnp.sign(motion.motor_speed).astype(jnp.int32))

    def step(self, state: SlidingMotion, control: Axes) -> SlidingMotion:
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
            speed = jnp.where(mode == 0, 0, motion.motor_speed)
            return SlidingMotion(motion._replace(motor_speed=speed), mode)

        return jax.lax.fori_loop(0, self.substeps, substep, state, unroll=UNROLLED)

    def output(self, state: SlidingMotion) -> Axes:
        return state.motion.tool

    def measure(self, state: SlidingMotion) -> tuple[Axes, Axes]:
        """Position and speed of the motors: the end effector is not measured."""
        return state.motion.motor, state.motion.motor_speed


class SmoothFlexibleAxis(_Axis):
    """The differentiable twin of `FlexibleAxis`: friction follows tanh(sharpness v).

    Args:
        parameters: those of the true axis.
        dt: sample period [s].
        sharpness: inverse of the speed [s/m] within which friction turns. The equation is stiff
            beyond mass over force and substep.
        substeps: per sample; as many as `SUBSTEP` fits into the sample when not given.

    Raises:
        ValueError: as `FlexibleAxis`.
    """

    sharpness: Float[Array, ""]

    def __init__(
        self,
        parameters: AxisParameters,
        dt: float,
        sharpness: float | Float[Array, ""] = 1e3,  # friction turns within 1 mm/s
        substeps: int | float | None = None,
    ):
        super().__init__(parameters, dt, substeps)
        self.sharpness = jnp.asarray(sharpness, float)

    def initial_state(self, position, increment) -> Motion:
        return self._motion(position, increment)

    def step(self, state: Motion, control: Axes) -> Motion:
        p, h = self.parameters, self.dt / self.substeps

        def rates(x: Motion) -> Motion:
            force = p.drive_force(x, control) - p.friction.smooth(x.motor_speed, self.sharpness)
            return Motion(
                x.motor_speed, force / p.motor_mass, x.tool_speed, p.link_force(x) / p.tool_mass
            )

        def substep(_, state: Motion) -> Motion:
            return runge_kutta(rates, state, h)

        # one substep in a turn: its derivatives take a sixth of the time to compile
        return jax.lax.fori_loop(0, self.substeps, substep, state)

    def output(self, state: Motion) -> Axes:
        return state.tool

    def measure(self, state: Motion) -> tuple[Axes, Axes]:
        return state.motor, state.motor_speed


@eqx.filter_jit
def zoh_model(parameters: AxisParameters, dt: float) -> LinearPlant:
    """Model that is exact under a control held over the sample.

    Raises:
        ValueError: `dt` is not above zero.
    """
    A, B = jax.vmap(lambda A, B: zoh(A, B, dt))(*rate_matrices(parameters))
    return _side_by_side(A, B, dt)


@eqx.filter_jit
def euler_model(parameters: AxisParameters, dt: float) -> LinearPlant:
    """Model by forward Euler, A = I + dt A_c (Yuan, eq. 4.4).

    It makes the thesis's axis unstable at 1 ms: |eig A| = 1.00104.

    Raises:
        ValueError: `dt` is not above zero.
    """
    A, B = rate_matrices(parameters)
    return _side_by_side(jnp.broadcast_to(jnp.eye(4), A.shape) + dt * A, dt * B, dt)


def rate_matrices(p: AxisParameters) -> tuple[Float[Array, "m 4 4"], Float[Array, "m 4 1"]]:
    """Rates of every axis, dx/dt = A x + B u, x = (x_m, v_m, x_e, v_e)."""
    values = (p.motor_mass, p.tool_mass, p.stiffness, p.damping, p.friction.viscous)
    M, m, k, c, b = (jnp.broadcast_to(value, (p.axes,)) for value in values)
    zero, one = jnp.zeros(p.axes), jnp.ones(p.axes)
    rows = [
        [zero, one, zero, zero],
        [-k / M, -(c + b) / M, k / M, c / M],
        [zero, zero, zero, one],
        [k / m, c / m, -k / m, -c / m],
    ]
    A = jnp.stack([jnp.stack(row, axis=-1) for row in rows], axis=-2)
    return A, jnp.stack([zero, p.force_constant / M, zero, zero], axis=-1)[..., None]


def _side_by_side(A: Float[Array, "m 4 4"], B: Float[Array, "m 4 1"], dt: float) -> LinearPlant:
    """One plant of all axes; its pattern is known even where the parameters are traced."""
    axes = A.shape[0]
    apart = np.eye(axes)
    whole = jnp.einsum("kij,kl->ikjl", A, apart).reshape(4 * axes, 4 * axes)
    inputs = jnp.einsum("ki,kl->ikl", B[..., 0], apart).reshape(4 * axes, axes)
    tool = np.kron([0.0, 0.0, 1.0, 0.0], apart)
    pattern = Pattern.of(np.kron(np.ones((4, 4)), apart), np.kron(np.ones((4, 1)), apart), tool)
    return LinearPlant(whole, inputs, tool, dt, pattern)
