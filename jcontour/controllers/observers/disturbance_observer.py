"""Disturbances and states from a nominal model.

The disturbance observer inverts the nominal model behind a low pass:

    d = Q (P_n^-1 x_m - u),    u = u_inner - d          (Yuan, eqs. 2.6 and 2.7, Fig. 2.7)
The estimate d is subtracted from the control of the wrapped controller. P_n is a double integrator,
b0 / s^2 with b0 = k_t / M. It is inverted in the form the controller meets, under zero-order hold:

    P_n = b0 T^2 / 2 (z + 1) / (z - 1)^2,    Q = D(1) / 2 (z + 1) / D(z)
    Q P_n^-1 = D(1) / (b0 T^2) (z - 1)^2 / D(z)
D has the poles exp(s T) of s^2 + 2 zeta w s + w^2. Q keeps the zero at -1 of the sampled model,
which must not be inverted. Its gain at rest is one, and it uses no control before it is known. A
machine that equals P_n is left as it was: d = Q d_i, whatever u is.

The reduced-order Luenberger observer estimates the unmeasured states (Yuan, section 4.2.1). The
state is split into the measured part s and the rest, A = [[A11, A12], [A21, A22]], B = [B1; B2].
With z = rest - L_r s,

    Lambda = A22 - L_r A12                                                     (4.9)
    z(k+1) = Lambda z + (B2 - L_r B1) u + (Lambda L_r + A21 - L_r A11) s       (4.10)
The estimation error obeys Lambda. With the thesis's L_r it is stable for the zero-order-hold model
of the axis (|eig| = 0.9972), not for the forward Euler model that the thesis prints (1.00103),
which is refused.

Under time-delay control what acted one sample ago stands for the disturbance of now.
Youcef-Toumi & Ito (1990); of Youcef-Toumi & Reddy in the volume of 1990 there is no text here, so
this is the textbook algorithm. With y'' = h + b u, whatever h is, and an estimate bhat of b,

    u(k) = u(k-1) + (r'' + k_v (r' - v) + k_p (r - y) - a(k-1)) / bhat
    a(k-1) = (v(k) - v(k-1)) / T
The sampled loop needs about b / bhat < 2, because the old control is undone with bhat and done with
b. The u(k-1) of the law is the control that acted. It stays within the limits of the machine, and
so does u: the sum over the samples does not wind up.
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from jcontour._arrays import check_signs, is_concrete
from jcontour.controller import (
    Axes,
    Controller,
    PerAxis,
    Wrapper,
    check_axes,
    check_limit,
    check_period,
    checked_period,
    numbers,
)
from jcontour.controllers.feedback.cascade import Commanded, commanded
from jcontour.linear.plant import LinearPlant, check_stable
from jcontour.motion.references import Reference
from jcontour.sensors import Sensors, row

BUTTERWORTH = np.sqrt(0.5)  # damping of the flattest low pass of second order


class DisturbanceMemory(NamedTuple):
    """States of the filters, and the memory of the wrapped controller."""

    first: Axes
    second: Axes
    inner: Any


class DisturbanceObserver(Wrapper):
    """Any controller with a disturbance observer on every axis; control i drives axis i.

    Args:
        controller: the wrapped controller.
        sensors: where the motors' positions are measured.
        bandwidth: w of Q [rad/s], one number or one for each axis.
        input_gain: b0 [m/s^2 per unit of the control], likewise.
        dt: sample period T [s].
        damping: zeta of Q, between 0 and 1.

    Raises:
        ValueError: a value is not finite and above zero, or the damping is not below one.
    """

    controller: Controller
    sensors: Sensors
    bandwidth: PerAxis = eqx.field(converter=numbers)
    input_gain: PerAxis = eqx.field(converter=numbers)
    dt: float = eqx.field(static=True, converter=float)
    damping: PerAxis = eqx.field(converter=numbers, default=BUTTERWORTH)

    def __check_init__(self):
        check_signs(self, positive=("bandwidth", "input_gain", "dt", "damping"))
        if is_concrete(self.damping) and not np.all(self.damping < 1):
            raise ValueError(f"damping: needs to be below one, received {self.damping}")

    def initial_memory(self, reference: Reference) -> DisturbanceMemory:
        """Filters in the steady motion of the start, without disturbance."""
        check_period(self.dt, reference)
        check_axes(self.sensors.axes, reference)
        now, (_, inverse, _) = reference.position[0], self._filters()
        before = now - reference.start_increment
        inner = self.controller.initial_memory(reference)
        return DisturbanceMemory(-inverse * now, inverse * before, inner)

    def step(
        self, memory: DisturbanceMemory, plan: Any, measurement: Any
    ) -> tuple[DisturbanceMemory, Axes]:
        """Both filters in one, in transposed direct form, around the control that acts."""
        (d1, d0), inverse, low_pass = self._filters()
        x = inverse * self.sensors.positions(measurement)
        disturbance = x + memory.first
        inner, control = self.controller.step(memory.inner, plan, measurement)
        control = control - disturbance
        first = -2 * x - low_pass * control - d1 * disturbance + memory.second
        return DisturbanceMemory(first, x - low_pass * control - d0 * disturbance, inner), control

    def _filters(self) -> tuple[tuple[PerAxis, PerAxis], PerAxis, PerAxis]:
        """D = z^2 + d1 z + d0, and the factors before (z - 1)^2 / D and (z + 1) / D."""
        decay = self.damping * self.bandwidth * self.dt
        angle = jnp.sqrt(1 - self.damping**2) * self.bandwidth * self.dt
        d1, d0 = -2 * jnp.exp(-decay) * jnp.cos(angle), jnp.exp(-2 * decay)
        # 1 + d1 + d0 without its cancellation
        at_rest = jnp.expm1(-decay) ** 2 + 4 * jnp.exp(-decay) * jnp.sin(angle / 2) ** 2
        return (d1, d0), at_rest / (self.input_gain * self.dt**2), at_rest / 2


class ReducedMemory(NamedTuple):
    """The part z of the estimate (n - q,), and the memory of the wrapped controller."""

    z: Float[Array, " rest"]
    inner: Any


class ReducedObserver(Wrapper):
    """A state-feedback controller fed the measured states and an estimate of the others.

    Args:
        controller: fed the whole state.
        model: model of the machine, its q measured states first.
        gain: L_r (n - q, q).

    Raises:
        ValueError: the gain has another shape, or Lambda has an eigenvalue that is not inside the
            unit circle.
    """

    controller: Controller
    model: LinearPlant
    gain: Float[Array, "rest q"] = eqx.field(converter=jnp.asarray)

    def __check_init__(self):
        states, shape = self.model.states, self.gain.shape
        if self.gain.ndim != 2 or sum(shape) != states:
            raise ValueError(f"gain: needs shape (n - q, q) with n = {states}, received {shape}")
        check_stable("gain: the observer", error_matrix(self.model, self.gain))

    def initial_memory(self, reference: Reference) -> ReducedMemory:
        """Memory in the state in which the reference begins."""
        check_period(self.model.dt, reference)
        start = self.model.initial_state(reference.position[0], reference.start_increment)
        measured, rest = jnp.split(start, [self.gain.shape[1]])
        return ReducedMemory(rest - self.gain @ measured, self.controller.initial_memory(reference))

    def step(
        self, memory: ReducedMemory, plan: Any, measurement: Any
    ) -> tuple[ReducedMemory, Float[Array, " p"]]:
        """Control on the present estimate, then eq. 4.10."""
        measured = row(measurement)
        q = measured.size
        estimate = jnp.concatenate([measured, memory.z + self.gain @ measured])
        inner, control = self.controller.step(memory.inner, plan, estimate)
        augmented = augmented_model(self.model, self.gain)
        known = jnp.concatenate([measured, memory.z])
        z = augmented.A[q:] @ known + augmented.B[q:] @ control
        return ReducedMemory(z, inner), control


def error_matrix(model: LinearPlant, gain: Float[ArrayLike, "rest q"]) -> Float[Array, "rest rest"]:
    """Lambda = A22 - L_r A12, by which the estimation error moves on in a sample (eq. 4.11)."""
    gain = jnp.asarray(gain)
    q = gain.shape[1]
    return model.A[q:, q:] - gain @ model.A[:q, q:]


def augmented_model(model: LinearPlant, gain: Float[ArrayLike, "rest q"]) -> LinearPlant:
    """Model with the state [s, z] and the output [s, estimate of the rest] (eq. 4.12).

    It holds for an estimate without error.
    """
    gain = jnp.asarray(gain)
    q = gain.shape[1]
    to_z = jnp.block([[jnp.eye(q), jnp.zeros(gain.T.shape)], [-gain, jnp.eye(gain.shape[0])]])
    back = jnp.block([[jnp.eye(q), jnp.zeros(gain.T.shape)], [gain, jnp.eye(gain.shape[0])]])
    return LinearPlant(to_z @ model.A @ back, to_z @ model.B, back, model.dt)


def thesis_gain(axes: int = 1) -> Float[np.ndarray, "rest q"]:
    """Gain L_r as printed in section 4.2.1, for axes side by side."""
    return np.kron([[0.0, 1e-3], [0.0, 1e-3]], np.eye(axes))


class Past(NamedTuple):
    """Memory: the last control that acted and the last speed [m/s]."""

    control: Float[Array, " m"]
    speed: Float[Array, " m"]


class TimeDelayControl(Controller):
    """Time-delay control of every axis, on measured positions and speeds.

    >>> from jcontour.sensors import motors
    >>> control = TimeDelayControl(400.0, 40.0, 1.0, motors(1), dt=1e-3)
    >>> at_rest = Commanded(jnp.array([0.01]), jnp.zeros(1), jnp.zeros(1))
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

    stiffness: PerAxis = eqx.field(converter=numbers)
    damping: PerAxis = eqx.field(converter=numbers)
    input_gain: PerAxis = eqx.field(converter=numbers)
    sensors: Sensors
    dt: float = eqx.field(static=True, converter=checked_period)
    limit: PerAxis = eqx.field(converter=numbers, default=np.inf)  # a plant without a limit
    preview: int = eqx.field(static=True, init=False, default=1)

    def __check_init__(self):
        check_signs(self, positive=("input_gain",), not_negative=("stiffness", "damping"))
        check_limit(self.limit)
        if not self.sensors.velocity:
            raise ValueError("sensors: time-delay control needs speeds, received positions only")

    def prepare(self, reference: Reference) -> Commanded:
        return commanded(reference, self.sensors, self.dt)

    def initial_memory(self, reference: Reference) -> Past:
        nothing = jnp.zeros(self.sensors.axes, reference.position.dtype)
        return Past(nothing, reference.start_increment / self.dt)

    def step(self, memory: Past, plan: Commanded, measurement) -> tuple[Past, Float[Array, " m"]]:
        """Control that adds what is missing to the one that acted, within the limit."""
        position, speed = self.sensors.read(measurement)
        acted = (speed - memory.speed) / self.dt
        wanted = plan.acceleration + self.damping * (plan.velocity - speed)
        wanted = wanted + self.stiffness * (plan.position - position)
        free = memory.control + (wanted - acted) / self.input_gain
        control = jnp.clip(free, -self.limit, self.limit)
        return Past(control, speed), control
