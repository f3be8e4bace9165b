"""Poles placed once, and poles placed while the gain of the machine is estimated.

For axes with one input each Ackermann's formula gives (Yuan, section 2.2.3)

    K = [0 ... 0 1] [B, D B, ..., D^(n-1) B]^-1 (D - q_1 I) ... (D - q_n I)
    D = A - I,  q_i = p_i - 1
Poles of a machine sampled fast crowd around 1. Differences from 1 keep the digits that the powers
of A would lose.

The self-tuning servo has recursive least squares for the input gain, and placed poles.

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

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Complex, Float, Int, Num

from jcontour._arrays import check_signs, is_concrete, ranked
from jcontour.controller import Controller, check_axes, numbers
from jcontour.linear.plant import Axis, LinearPlant, decoupled_axes
from jcontour.linear.small_matrices import small_solve
from jcontour.motion.references import Reference
from jcontour.sensors import Sensors


def placed_gain(
    model: LinearPlant, poles: Num[ArrayLike, "*m s"] | Sequence[float | complex]
) -> Float[Array, "p n"]:
    """Gain K that gives every axis of the loop A - B K these poles.

    Args:
        model: decoupled axes with one input each.
        poles: poles of the sampled loop, the same for all axes or one row for each, as many as
            an axis has states; complex ones in pairs.

    Raises:
        ValueError: an axis has another number of inputs or poles, cannot be controlled, or a pole
            is not inside the unit circle or lacks its conjugate.
    """
    axes = decoupled_axes(model.pattern)
    poles = jnp.asarray(poles, complex)
    for axis in axes:
        if len(axis.inputs) != 1:
            received = f"states {list(axis.states)} have {len(axis.inputs)}"
            raise ValueError(f"model: pole placement needs one input for each axis, {received}")
        if poles.shape[-1] != len(axis.states):
            raise ValueError(
                f"poles: the axis has {len(axis.states)} states, received {poles.shape[-1]} poles"
            )
    if is_concrete(poles):
        for wanted in np.asarray(poles).reshape(-1, poles.shape[-1]):
            received = f"received {np.array2string(wanted, precision=6)}"
            if not np.all(np.abs(wanted) < 1):
                raise ValueError(f"poles: need to be inside the unit circle, {received}")
            pair = np.sort_complex(wanted), np.sort_complex(wanted.conj())
            if not np.allclose(*pair, rtol=0, atol=1e-9):
                raise ValueError(f"poles: complex ones need to come in pairs, {received}")
    K = _of_axes(model.A, model.B, poles, axes)
    if is_concrete(K):
        for axis in axes:
            if not np.isfinite(np.asarray(K)[axis.inputs[0]]).all():
                raise ValueError(
                    f"model: the axis of the states {list(axis.states)} cannot be controlled"
                )
    return K


def damped_poles(
    frequency: ArrayLike | Sequence[float], damping: ArrayLike | Sequence[float], dt: float
) -> Complex[Array, " s"]:
    """Sampled poles exp(s dt) of k pairs s^2 + 2 zeta w s + w^2, w [rad/s].

    Raises:
        ValueError: a frequency is not above zero, or a damping not between zero and one.
    """
    w = ranked(frequency, 1)
    zeta = ranked(damping, 1)
    if is_concrete(w) and not np.all(np.asarray(w) > 0):
        raise ValueError(f"frequency: needs to be above zero, received {frequency}")
    if is_concrete(zeta) and not np.all((np.asarray(zeta) > 0) & (np.asarray(zeta) < 1)):
        raise ValueError(f"damping: needs to be between 0 and 1, received {damping}")
    s = jax.lax.complex(-(w * zeta), w * jnp.sqrt(1 - zeta**2))
    return jnp.exp(dt * jnp.concatenate([s, s.conj()]))


@partial(jax.jit, static_argnums=3)
def _of_axes(
    A: Float[Array, "n n"],
    B: Float[Array, "n p"],
    poles: Complex[Array, "*m s"],
    axes: tuple[Axis, ...],
) -> Float[Array, "p n"]:
    K = jnp.zeros((B.shape[1], B.shape[0]))
    poles = jnp.broadcast_to(poles, (len(axes), poles.shape[-1]))
    for axis, wanted in zip(axes, poles, strict=True):
        rows, motor = np.array(axis.states), axis.inputs[0]
        K = K.at[motor, rows].set(_ackermann(A[np.ix_(rows, rows)], B[rows, motor], wanted))
    return K


def _ackermann(
    A: Float[Array, "n n"], B: Float[Array, " n"], poles: Complex[Array, " n"]
) -> Float[Array, " n"]:
    n = B.size
    D = A - jnp.eye(n)
    scale = jnp.max(jnp.abs(D)) ** jnp.arange(n, dtype=A.dtype)  # of columns, each a power of D
    columns, column = [], B
    for _ in range(n):
        columns.append(column)
        column = D @ column
    reach = jnp.stack(columns, axis=1) / scale[None]
    last = small_solve(reach.T, jnp.zeros(n).at[-1].set(1.0)) / scale[-1]
    last, D, identity = (x.astype(poles.dtype) for x in (last, D, jnp.eye(n)))
    for q in poles - 1:
        last = last @ (D - q * identity)
    return last.real


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
        learning: whether b is estimated; margins are those of the loop without.

    Raises:
        ValueError: a gain is negative or not finite, the first estimate or `least` is not above
            zero, the factor is not above zero and at most one, or `growth` is below one.
    """

    position: Float[Array, ""] = eqx.field(converter=numbers)
    rate: Float[Array, ""] = eqx.field(converter=numbers)
    sensors: Sensors
    gain: Float[Array, ""] = eqx.field(converter=numbers)
    # hardly anything is known at first, for controls about one
    variance: Float[Array, ""] = eqx.field(converter=numbers, default=1e4)
    # of the last twenty samples
    forgetting: Float[Array, ""] = eqx.field(converter=numbers, default=0.95)
    # a wrong sample makes no control more than ten times as large
    least: Float[Array, ""] = eqx.field(converter=numbers, default=0.1)
    # without excitation P would grow for ever
    growth: Float[Array, ""] = eqx.field(converter=numbers, default=100.0)
    learning: bool = eqx.field(static=True, default=True)
    preview: int = eqx.field(static=True, init=False, default=0)

    def __check_init__(self):
        check_signs(self, ("gain", "least"), ("position", "rate", "variance", "growth"))
        if is_concrete(self.growth) and not self.growth >= 1:
            raise ValueError(f"growth: needs to be at least one, received {self.growth}")
        if is_concrete(self.forgetting) and not 0 < self.forgetting <= 1:
            raise ValueError(
                f"forgetting: needs to be above zero and at most one, received {self.forgetting}"
            )

    def prepare(self, reference: Reference) -> Float[Array, "T m"]:
        check_axes(self.sensors.axes, reference)
        return reference.position[: reference.steps]

    def initial_memory(self, reference: Reference) -> Estimate:
        axes = self.sensors.axes
        past = jnp.zeros((2, axes), reference.position.dtype)
        known = (jnp.full(axes, self.gain), jnp.full(axes, self.variance))
        return Estimate(past, past, *known, jnp.zeros((), int))

    def without_planned_limits(self) -> "SelfTuning":
        return replace(self, learning=False)

    def step(self, memory: Estimate, plan, measurement) -> tuple[Estimate, Float[Array, " m"]]:
        """Next estimate and the control.

        The first sample is taken at rest; b is learned from the third on.
        """
        y = self.sensors.positions(measurement)
        before = jnp.where((memory.sample == 0) & self.learning, y, memory.position[0])
        earlier = memory.position[1]
        f = memory.control[0] + memory.control[1]
        D = self.forgetting + memory.variance * f**2
        miss = y - 2 * before + earlier - memory.gain * f
        gain = memory.gain + memory.variance * f * miss / D
        variance = (memory.variance - memory.variance**2 * f**2 / D) / self.forgetting
        seen, largest = memory.sample >= 2, self.growth * self.variance
        gain = jnp.where(seen, gain, memory.gain)
        variance = jnp.where(seen, jnp.minimum(variance, largest), memory.variance)
        if not self.learning:
            gain, variance = jax.lax.stop_gradient((memory.gain, memory.variance))
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
