"""Disturbance observer: the nominal model inverted behind a low pass gives the disturbance.

    d = Q (P_n^-1 x_m - u),    u = u_inner - d          (Yuan, eqs. 2.6 and 2.7, Fig. 2.7)
The estimate d is subtracted from the control of the wrapped controller. P_n is a double integrator,
b0 / s^2 with b0 = k_t / M. It is inverted in the form the controller meets, under zero-order hold:

    P_n = b0 T^2 / 2 (z + 1) / (z - 1)^2,    Q = D(1) / 2 (z + 1) / D(z)
    Q P_n^-1 = D(1) / (b0 T^2) (z - 1)^2 / D(z)
D has the poles exp(s T) of s^2 + 2 zeta w s + w^2. Q keeps the zero at -1 of the sampled model,
which must not be inverted. Its gain at rest is one, and it uses no control before it is known. A
machine that equals P_n is left as it was: d = Q d_i, whatever u is.
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jcontour._tracing import is_concrete
from jcontour.controller import Controller, Wrapper, check_period
from jcontour.motion.references import Reference
from jcontour.sensors import Sensors

Axes = Float[Array, " m"]
PerAxis = Float[Array, ""] | Float[Array, " m"]  # one number, or one for each axis
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
    bandwidth: PerAxis
    input_gain: PerAxis
    damping: PerAxis
    dt: float = eqx.field(static=True)

    def __init__(
        self,
        controller: Controller,
        sensors: Sensors,
        bandwidth,
        input_gain,
        dt: float,
        damping=BUTTERWORTH,
    ):
        named = {"bandwidth": bandwidth, "input_gain": input_gain, "dt": dt, "damping": damping}
        for name, value in named.items():
            if is_concrete(value) and not np.all(np.isfinite(value) & (np.asarray(value) > 0)):
                raise ValueError(f"{name}: needs to be finite and above zero, received {value}")
        if is_concrete(damping) and not np.all(np.asarray(damping) < 1):
            raise ValueError(f"damping: needs to be below one, received {damping}")
        self.controller, self.sensors, self.dt = controller, sensors, float(dt)
        self.bandwidth, self.input_gain, self.damping = (
            jnp.asarray(value, float) for value in (bandwidth, input_gain, damping)
        )

    def initial_memory(self, reference: Reference) -> DisturbanceMemory:
        """Filters in the steady motion of the start, without disturbance.

        Raises:
            ValueError: the reference has another sample period or number of axes.
        """
        check_period(self.dt, reference)
        axes, found = self.sensors.axes, reference.position.shape[-1]
        if found != axes:
            raise ValueError(f"sensors: the reference has {found} axes, the observer reads {axes}")
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
