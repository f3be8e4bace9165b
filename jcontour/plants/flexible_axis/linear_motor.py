"""Permanent-magnet linear motor and its current controller in front of an axis (Yuan, section 3.3).

    u_d = R i_d + L di_d/dt - w L i_q                                    (3.3)
    u_q = R i_q + L di_q/dt + w L i_d + k_e v,    w = p pi v / tau       (3.4)
    force = k_t i_q,    k_t = 3/2 k_e                                    (3.6)
In one complex number i = i_d + j i_q this is L di/dt = u - (R + j w L) i - j k_e v. Over a period
of the drive the voltage is held and the speed taken as constant; the current then follows exactly.
The axis is pushed by the mean current at the speed before. The current follows at the mean of the
speeds before and after. So the method is of second order in the period.

The thesis leaves the current controller to the drive. Here it is a PI controller for each of d and
q that cancels the pole of the winding. The rotation and the back EMF are fed forward, so that the
current answers a command like a first-order lag.
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float

from jcontour._arrays import ranked
from jcontour._tracing import is_concrete
from jcontour.plant import Plant
from jcontour.plants.flexible_axis.axis import FlexibleAxis, SmoothFlexibleAxis

Axes = Float[Array, " m"]
PerAxis = Float[Array, "#m"]  # one value, or one for each axis
Phasors = Complex[Array, " m"]

# [rad/s] of the current loop: fifty times the position loop, a twentieth of a 10 kHz drive
BANDWIDTH = 2 * np.pi * 500
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

    resistance: PerAxis
    inductance: PerAxis
    back_emf: PerAxis
    pole_pitch: PerAxis
    pole_pairs: PerAxis

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
            setattr(self, name, ranked(value, 1))

    @property
    def force_constant(self) -> PerAxis:
        """Force constant k_t = 3/2 k_e [N/A]: the power of k_e v in three phases is mechanical."""
        return 1.5 * self.back_emf

    def electrical_speed(self, speed: Axes) -> Axes:
        """Electrical angular speed w [rad/s] at the speed of the motor."""
        return self.pole_pairs * jnp.pi / self.pole_pitch * speed

    def advance(
        self, current: Phasors, voltage: Phasors, speed: Axes, h: float
    ) -> tuple[Phasors, Phasors]:
        """Current after h seconds of this voltage at this speed, and its mean over them."""
        rate = _phasor(self.resistance / self.inductance, self.electrical_speed(speed))
        induced = _phasor(0.0, self.back_emf * speed)
        settled = (voltage - induced) / (_phasor(self.inductance, 0.0) * rate)
        decay = jnp.exp(-rate * h)
        away = current - settled
        return settled + decay * away, settled + (1 - decay) / (rate * h) * away


def thesis_motor() -> LinearMotor:
    """LinX motor of the thesis as printed in section 3.3; it prints no number of pole pairs."""
    return LinearMotor(resistance=12.51, inductance=10.7e-3, back_emf=52.89, pole_pitch=0.0875)


class DrivenState(NamedTuple):
    """State of the axis and of the current controller, d and q in two columns."""

    axis: Any
    current: Float[Array, "m 2"]  # [A]
    integral: Float[Array, "m 2"]  # integrators [V]
    voltage: Float[Array, "m 2"]  # last applied [V]


class DrivenAxis(Plant):
    """An axis behind its motor and current controller.

    The control is the commanded i_q [A]; i_d is commanded to zero. In every period of the drive the
    current and the speed are measured, and the voltage is computed without delay and held. The
    period is the `dt` of the axis.

    Args:
        axis: the axis under a current.
        motor: its windings.
        dt: sample period of the position controller [s], whole periods of the drive.
        bandwidth: bandwidth of the current loop [rad/s].
        voltage_limit: limit of the length of (u_d, u_q) [V]; none when infinite.

    Raises:
        ValueError: the period of the drive does not divide `dt`, the bandwidth is too high for it,
            or the axis's force constant and that of the motor contradict each other.
    """

    axis: FlexibleAxis | SmoothFlexibleAxis
    motor: LinearMotor
    bandwidth: PerAxis
    voltage_limit: PerAxis
    dt: float = eqx.field(static=True)
    periods: int = eqx.field(static=True)

    def __init__(
        self,
        axis: FlexibleAxis | SmoothFlexibleAxis,
        motor: LinearMotor,
        dt: float,
        bandwidth=BANDWIDTH,
        voltage_limit=np.inf,
    ):
        periods = round(dt / axis.dt) if np.isfinite(dt) else 0
        if periods < 1 or abs(periods * axis.dt - dt) > 1e-9 * dt:
            needed = f"the period of the drive, {axis.dt} s, needs to divide the sample period"
            raise ValueError(f"dt: {needed}, received {dt} s")
        if is_concrete(bandwidth):
            values = np.asarray(bandwidth)
            if not np.all((values > 0) & (values * axis.dt < 1)):
                needed = f"above 0 and below 1/period = {1 / axis.dt:g} rad/s"
                raise ValueError(f"bandwidth: needs to be {needed}, received {bandwidth}")
        if is_concrete(voltage_limit) and not np.all(np.asarray(voltage_limit) > 0):
            raise ValueError(f"voltage_limit: needs to be above zero, received {voltage_limit}")
        _check_force(axis.parameters.force_constant, motor)
        self.axis, self.motor, self.dt, self.periods = axis, motor, float(dt), periods
        self.bandwidth = ranked(bandwidth, 1)
        self.voltage_limit = ranked(voltage_limit, 1)

    @property
    def alike_everywhere(self) -> bool | tuple[bool, ...]:
        """As the axis is."""
        return self.axis.alike_everywhere

    def initial_state(self, position, increment) -> DrivenState:
        """State of the axis in steady motion, `increment` per sample of this plant; no current."""
        none = jnp.zeros((*jnp.shape(position), 2), position.dtype)
        axis = self.axis.initial_state(position, increment / self.periods)
        return DrivenState(axis, none, none, none)

    def step(self, state: DrivenState, control: Axes) -> DrivenState:
        return jax.lax.fori_loop(0, self.periods, lambda _, s: self._period(s, control), state)

    def output(self, state: DrivenState) -> Axes:
        return self.axis.output(state.axis)

    def measure(self, state: DrivenState) -> Any:
        return self.axis.measure(state.axis)

    def _period(self, state: DrivenState, command: Axes) -> DrivenState:
        motor, h = self.motor, self.axis.dt
        current, integral = _complex(state.current), _complex(state.integral)
        speed = self.axis.measure(state.axis)[1]
        error = _phasor(0.0, command) - current
        integral = integral + _phasor(h * self.bandwidth * motor.resistance, 0.0) * error
        rotation = _phasor(motor.electrical_speed(speed) * motor.inductance, 0.0) * current
        fed_forward = 1j * (rotation + _phasor(motor.back_emf * speed, 0.0))
        proportional = _phasor(self.bandwidth * motor.inductance, 0.0) * error
        wanted = proportional + integral + fed_forward
        share = jnp.minimum(1, self.voltage_limit / jnp.maximum(jnp.abs(wanted), 1e-300))
        voltage = wanted * _phasor(share, 0.0)
        # the integral is held while the voltage is limited
        integral = jnp.where(voltage == wanted, integral, _complex(state.integral))
        _, mean_current = motor.advance(current, voltage, speed, h)
        pushed = state._replace(axis=self.axis.step(state.axis, mean_current.imag))
        mean_speed = (speed + self.axis.measure(pushed.axis)[1]) / 2
        after, _ = motor.advance(current, voltage, mean_speed, h)
        return DrivenState(pushed.axis, _real(after), _real(integral), _real(voltage))


def _check_force(stated: Axes, motor: LinearMotor) -> None:
    if not is_concrete(stated, motor.back_emf):
        return
    if not np.allclose(stated, motor.force_constant, rtol=AGREEMENT, atol=0):
        found = f"the axis has {np.asarray(stated)} N/A"
        raise ValueError(
            f"force_constant: {found}, its motor 3/2 k_e = {np.asarray(motor.force_constant)}"
        )


def _phasor(d, q) -> Phasors:
    """d + j q."""
    return jax.lax.complex(*jnp.broadcast_arrays(jnp.asarray(d, float), jnp.asarray(q, float)))


def _complex(pair: Float[Array, "m 2"]) -> Phasors:
    return _phasor(pair[:, 0], pair[:, 1])


def _real(phasor: Phasors) -> Float[Array, "m 2"]:
    return jnp.stack([phasor.real, phasor.imag], axis=-1)
