"""Permanent-magnet linear motor and its current controller in front of any axis whose control is a current (Yuan, section 3.3).

    u_d = R i_d + L di_d/dt - w L i_q,    u_q = R i_q + L di_q/dt + w L i_d + k_e v,    w = p pi v /
    tau       (3.3), (3.4) force = k_t i_q,    k_t = 3/2 k_e
    (3.6)
In one complex number i = i_d + j i_q this is L di/dt = u - (R + j w L) i - j k_e v. Over a period
of the drive the voltage is held and the speed taken as constant; the current then follows exactly.
The axis is pushed by the mean current that the speed before would leave, and
the current follows the mean of the speeds before and after: second order in the period.

The thesis leaves the current controller to the drive. Here it is the usual one: a PI law for each
of d and q that cancels the pole of the winding, with the rotation and the back EMF fed forward, so
that the current answers a command like a first-order lag.
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float

from jcontour.plant import Plant
from jcontour.tracing import is_concrete

Axes = Float[Array, " m"]
Phasors = Complex[Array, " m"]

BANDWIDTH = (
    2 * np.pi * 500
)  # [rad/s] of the current loop: fifty times the position loop, a twentieth of a 10 kHz drive
AGREEMENT = 0.01  # relative: how far k_t and 3/2 k_e may differ before one of them must be wrong


class LinearMotor(eqx.Module):
    """The windings of every axis.

    Args:
        resistance: R [Ohm].
        inductance: L [H], the same along d and q.
        back_emf: k_e [V s/m].
        pole_pitch: tau [m].
        pole_pairs: p in w = p pi v / tau; 1 where tau is the distance between neighbouring poles.

    Raises:
        ValueError: a value is not finite or not above zero.
    """

    resistance: Axes
    inductance: Axes
    back_emf: Axes
    pole_pitch: Axes
    pole_pairs: Axes

    def __init__(self, resistance, inductance, back_emf, pole_pitch, pole_pairs=1.0):
        named = {
            "resistance": resistance,
            "inductance": inductance,
            "back_emf": back_emf,
            "pole_pitch": pole_pitch,
            "pole_pairs": pole_pairs,
        }
        for name, value in named.items():
            if is_concrete(value) and not np.all(np.isfinite(value) & (np.asarray(value) > 0)):
                raise ValueError(f"{name}: needs to be finite and above zero, received {value}")
            setattr(self, name, jnp.atleast_1d(jnp.asarray(value, float)))

    @property
    def force_constant(self) -> Axes:
        """k_t = 3/2 k_e [N/A]: what the voltage k_e v takes from three phases is mechanical power."""
        return 1.5 * self.back_emf

    def electrical_speed(self, speed: Axes) -> Axes:
        """W [rad/s] at the speed of the motor."""
        return self.pole_pairs * jnp.pi / self.pole_pitch * speed

    def advance(
        self, current: Phasors, voltage: Phasors, speed: Axes, h: float
    ) -> tuple[Phasors, Phasors]:
        """Current after h seconds of this voltage at this speed, and its mean over them."""
        rate = self.resistance / self.inductance + 1j * self.electrical_speed(speed)
        settled = (voltage - 1j * self.back_emf * speed) / (self.inductance * rate)
        decay = jnp.exp(-rate * h)
        return settled + decay * (current - settled), settled + (1 - decay) / (rate * h) * (
            current - settled
        )


def thesis_motor() -> LinearMotor:
    """The LinX motor of the thesis as printed, section 3.3; it prints no number of pole pairs."""
    return LinearMotor(resistance=12.51, inductance=10.7e-3, back_emf=52.89, pole_pitch=0.0875)


class DrivenState(NamedTuple):
    """State of the axis; currents, integrators and the voltage last applied, d and q in two columns (m, 2) [A, V, V]."""

    axis: Any
    current: Float[Array, "m 2"]
    integral: Float[Array, "m 2"]
    voltage: Float[Array, "m 2"]


class DrivenAxis(Plant):
    """An axis behind its motor and current controller; the control is the commanded i_q [A], i_d is commanded to zero.

    Every period of the drive: measure current and speed, compute the voltage (no delay), hold it.
    The period is the axis's own `dt`.

    Args:
        axis: a plant that takes currents and measures (position, speed) of the motors,
            `FlexibleAxis` for one.
        motor: its windings.
        dt: sample period of the position controller [s], whole periods of the drive.
        bandwidth: of the current loop [rad/s].
        voltage_limit: of the length of (u_d, u_q) [V]; none when infinite.

    Raises:
        ValueError: the period of the drive does not divide `dt`, the bandwidth is too high for it,
            or the axis's force constant and that of the motor contradict each other.
    """

    axis: Plant
    motor: LinearMotor
    bandwidth: Axes
    voltage_limit: Axes
    dt: float = eqx.field(static=True)
    periods: int = eqx.field(static=True)

    def __init__(
        self, axis: Plant, motor: LinearMotor, dt: float, bandwidth=BANDWIDTH, voltage_limit=np.inf
    ):
        periods = round(dt / axis.dt) if np.isfinite(dt) else 0
        if periods < 1 or abs(periods * axis.dt - dt) > 1e-9 * dt:
            raise ValueError(
                f"dt: the period of the drive, {axis.dt} s, needs to divide the sample period, received {dt} s"
            )
        if is_concrete(bandwidth) and not np.all(
            (np.asarray(bandwidth) > 0) & (np.asarray(bandwidth) * axis.dt < 1)
        ):
            raise ValueError(
                f"bandwidth: needs to be above 0 and below 1/period = {1 / axis.dt:g} rad/s, received {bandwidth}"
            )
        if is_concrete(voltage_limit) and not np.all(np.asarray(voltage_limit) > 0):
            raise ValueError(f"voltage_limit: needs to be above zero, received {voltage_limit}")
        _check_force(axis, motor)
        self.axis, self.motor, self.dt, self.periods = axis, motor, float(dt), periods
        self.bandwidth, self.voltage_limit = (
            jnp.atleast_1d(jnp.asarray(value, float)) for value in (bandwidth, voltage_limit)
        )

    def initial_state(self, position, increment) -> DrivenState:
        """The axis as it starts itself, `increment` per sample of this plant; no current."""
        none = jnp.zeros((*jnp.shape(position), 2), position.dtype)
        return DrivenState(
            self.axis.initial_state(position, increment / self.periods), none, none, none
        )

    def step(self, state: DrivenState, control: Axes) -> DrivenState:
        """All periods of the drive in one sample."""
        return jax.lax.fori_loop(0, self.periods, lambda _, s: self._period(s, control), state)

    def output(self, state: DrivenState) -> Axes:
        """That of the axis [m]."""
        return self.axis.output(state.axis)

    def measure(self, state: DrivenState) -> Any:
        """That of the axis."""
        return self.axis.measure(state.axis)

    def _period(self, state: DrivenState, command: Axes) -> DrivenState:
        motor, h = self.motor, self.axis.dt
        current, integral = _complex(state.current), _complex(state.integral)
        speed = self.axis.measure(state.axis)[1]
        error = 1j * command - current
        integral = integral + h * self.bandwidth * motor.resistance * error
        fed_forward = 1j * (
            motor.electrical_speed(speed) * motor.inductance * current + motor.back_emf * speed
        )
        wanted = self.bandwidth * motor.inductance * error + integral + fed_forward
        voltage = wanted * jnp.minimum(1, self.voltage_limit / jnp.maximum(jnp.abs(wanted), 1e-300))
        integral = jnp.where(
            voltage == wanted, integral, _complex(state.integral)
        )  # held while the voltage is limited
        pushed = self.axis.step(state.axis, motor.advance(current, voltage, speed, h)[1].imag)
        mean_speed = (speed + self.axis.measure(pushed)[1]) / 2
        after, _ = motor.advance(current, voltage, mean_speed, h)
        return DrivenState(pushed, _real(after), _real(integral), _real(voltage))


def _check_force(axis: Plant, motor: LinearMotor) -> None:
    stated = getattr(getattr(axis, "parameters", None), "force_constant", None)
    if stated is None or not (is_concrete(stated) and is_concrete(motor.back_emf)):
        return
    if not np.allclose(stated, motor.force_constant, rtol=AGREEMENT, atol=0):
        raise ValueError(
            f"force_constant: the axis has {np.asarray(stated)} N/A, its motor 3/2 k_e = {np.asarray(motor.force_constant)}"
        )


def _complex(pair: Float[Array, "m 2"]) -> Phasors:
    return pair[:, 0] + 1j * pair[:, 1]


def _real(phasor: Phasors) -> Float[Array, "m 2"]:
    return jnp.stack([phasor.real, phasor.imag], axis=-1)
