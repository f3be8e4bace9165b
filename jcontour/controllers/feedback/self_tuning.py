"""A self-tuning servo: recursive least squares for the input gain, and placed poles.

Of Horowitz & McCormick in the volume of 1990 there is no text here: this is the textbook algorithm
(Astrom & Wittenmark) on the arm of a disk drive, a sampled double integrator of unknown gain b,

    y(k) = 2 y(k-1) - y(k-2) + b f(k),     f(k) = u(k-1) + u(k-2)
    D = forget + P f^2,    b += P f (y(k) - 2 y(k-1) + y(k-2) - b f) / D
    P = min((P - P^2 f^2 / D) / forget, P_max)
    u(k) = (k_p (r - y(k)) - k_r (y(k) - y(k-1))) / (2 max(b, b_min))
b_min is a part of the first b, P_max a multiple of the first P: no unit is favoured. With the
right b the poles are the roots of

    z^3 + ((k_p + k_r)/2 - 2) z^2 + (1 + k_p/2) z - k_r/2.
"""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float, Int

from jcontour._tracing import is_concrete
from jcontour.controller import Controller, check_axes, checked_gain
from jcontour.motion.references import Reference
from jcontour.sensors import Sensors


class Estimate(NamedTuple):
    """Memory: two samples of the past, and what is known of b."""

    position: Float[Array, "2 m"]  # y(k-1), y(k-2)
    control: Float[Array, "2 m"]  # u(k-1), u(k-2)
    gain: Float[Array, " m"]
    variance: Float[Array, " m"]
    sample: Int[Array, ""]


class SelfTuning(Controller):
    """Self-tuning servo of every axis, on measured positions.

    >>> first, second = placed_gains(0.9, 0.8)
    >>> round(first, 6), round(second, 6)
    (0.016608, 0.244211)

    Args:
        position: k_p, without unit.
        rate: k_r, without unit.
        sensors: where the positions stand in the measurement.
        gain: first estimate of b [m per unit of control]; K T^2 / 2 where a unit of control
            accelerates by K [m/s^2].
        variance: first P [1 / control^2]; large where P f^2 of the usual controls is far above one.
        forgetting: factor by which old samples count less.
        least: b_min over the first estimate of b.
        growth: P_max over the first P.

    Raises:
        ValueError: a gain is negative or not finite, the first estimate or `least` is not above
            zero, the factor is not above zero and at most one, or `growth` is below one.
    """

    position: Float[Array, ""]
    rate: Float[Array, ""]
    gain: Float[Array, ""]
    variance: Float[Array, ""]
    forgetting: Float[Array, ""]
    least: Float[Array, ""]
    growth: Float[Array, ""]
    sensors: Sensors
    preview: int = eqx.field(static=True, default=0)

    def __init__(
        self,
        position: ArrayLike,
        rate: ArrayLike,
        sensors: Sensors,
        gain: ArrayLike,
        variance: ArrayLike = 1e4,  # hardly anything is known at first, for controls about one
        forgetting: ArrayLike = 0.95,  # of the last twenty samples
        least: ArrayLike = 0.1,  # a wrong sample makes no control more than ten times as large
        growth: ArrayLike = 100.0,  # without excitation P would grow for ever
    ):
        self.position, self.rate = checked_gain("position", position), checked_gain("rate", rate)
        self.gain, self.variance = checked_gain("gain", gain), checked_gain("variance", variance)
        self.least, self.growth = checked_gain("least", least), checked_gain("growth", growth)
        for name, value in (("gain", gain), ("least", least)):
            if is_concrete(value) and not np.asarray(value) > 0:
                raise ValueError(f"{name}: needs to be above zero, received {value}")
        if is_concrete(growth) and not np.asarray(growth) >= 1:
            raise ValueError(f"growth: needs to be at least one, received {growth}")
        if is_concrete(forgetting) and not 0 < np.asarray(forgetting) <= 1:
            raise ValueError(
                f"forgetting: needs to be above zero and at most one, received {forgetting}"
            )
        self.forgetting, self.sensors = jnp.asarray(forgetting, float), sensors
        self.preview = 0

    def prepare(self, reference: Reference) -> Float[Array, "T m"]:
        """Positions of the reference.

        Raises:
            ValueError: the reference has another number of axes.
        """
        check_axes(self.sensors.axes, reference)
        return reference.position[: reference.steps]

    def initial_memory(self, reference: Reference) -> Estimate:
        """Nothing seen and no control yet."""
        axes = self.sensors.axes
        past = jnp.zeros((2, axes), reference.position.dtype)
        known = (jnp.full(axes, self.gain), jnp.full(axes, self.variance))
        return Estimate(past, past, *known, jnp.zeros((), int))

    def step(self, memory: Estimate, plan, measurement) -> tuple[Estimate, Float[Array, " m"]]:
        """Next estimate and the control.

        The first sample is taken at rest; b is learned from the third on.
        """
        y = self.sensors.positions(measurement)
        before = jnp.where(memory.sample == 0, y, memory.position[0])
        earlier = memory.position[1]
        f = memory.control[0] + memory.control[1]
        D = self.forgetting + memory.variance * f**2
        miss = y - 2 * before + earlier - memory.gain * f
        gain = memory.gain + memory.variance * f * miss / D
        variance = (memory.variance - memory.variance**2 * f**2 / D) / self.forgetting
        seen, largest = memory.sample >= 2, self.growth * self.variance
        gain = jnp.where(seen, gain, memory.gain)
        variance = jnp.where(seen, jnp.minimum(variance, largest), memory.variance)
        wanted = self.position * (plan - y) - self.rate * (y - before)
        control = wanted / (2 * jnp.maximum(gain, self.least * self.gain))
        positions = jnp.stack([y, before])
        controls = jnp.stack([control, memory.control[0]])
        return Estimate(positions, controls, gain, variance, memory.sample + 1), control


def placed_gains(first: complex | float, second: complex | float) -> tuple[float, float]:
    """Gains (k_p, k_r) that put two poles there; the third follows.

    Raises:
        ValueError: the poles are not finite, equal, at z = -1 or 1, or neither real nor a
            conjugate pair; or they need a negative gain or an unstable third pole.
    """
    poles = np.array([first, second], complex)
    named = f"received {first}, {second}"
    if not np.isfinite(poles).all():
        raise ValueError(f"poles: need to be finite, {named}")
    if np.min(np.abs(poles**2 - 1)) < 1e-9:
        raise ValueError(f"poles: need to be away from 1 and -1, {named}")
    if abs(first - second) < 1e-12 or abs(np.sum(poles).imag) > 1e-12:
        raise ValueError(f"poles: need two different real ones or a conjugate pair, {named}")
    # z^3 - 2 z^2 + z + k_p (z^2 + z)/2 + k_r (z^2 - 1)/2 = 0
    left = np.stack([(poles**2 + poles) / 2, (poles**2 - 1) / 2], axis=1)
    right = -(poles**3 - 2 * poles**2 + poles)
    gains = np.linalg.solve(left, right)
    if np.max(np.abs(gains.imag)) > 1e-9:
        raise ValueError(f"poles: need a conjugate pair, {named}")
    position, rate = (float(gain) for gain in gains.real)
    third = 2 - (position + rate) / 2 - float(np.sum(poles).real)
    if min(position, rate) < 0 or abs(third) >= 1:
        raise ValueError(
            f"poles: these need the gains {position:.4g} and {rate:.4g} and leave a third pole at "
            f"{third:.4g}, {named}"
        )
    return position, rate
