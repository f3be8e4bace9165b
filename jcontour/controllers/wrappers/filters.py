"""Filters of the control and of the reference, and compensation, around any controller.

Notches work against a resonance, low passes against noise.

A section H(s) of second order becomes, by Tustin's rule s = c (z - 1) / (z + 1),

    y(k) = b0 x(k) + b1 x(k-1) + b2 x(k-2) - a1 y(k-1) - a2 y(k-2)
with c = 2 / dt, or c = w / tan(w dt / 2), which keeps the gain exact at w (prewarped). It runs in
the transposed direct form.

An input shaper makes the reference a weighted sum of delayed copies. The score is still taken
against the reference itself, so that the shaper's delay counts as an error. The reference is known
at its samples only; between them copies are interpolated linearly. So a mode w keeps up to (w dt)^2
/ 8 of its vibration in spite of the shaper.

A compensation of the machine's nonlinear terms adds to the control, u = u' + f(measurement, u').
Under feedback linearisation (Yuan, eq. 5.44) the wrapped controller is designed for the linear
machine that f leaves.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from jcontour._arrays import is_concrete
from jcontour.controller import Controller, Memory, Plan, Wrapper
from jcontour.motion.input_shaping import Shaper
from jcontour.motion.references import Reference


class Biquad(eqx.Module):
    """A digital filter of second order.

    Raises:
        ValueError: a coefficient is not finite, or a pole is not inside the unit circle.
    """

    numerator: Float[Array, "3"]  # b0, b1, b2
    denominator: Float[Array, "2"]  # a1, a2

    def __check_init__(self):
        if is_concrete(self.numerator, self.denominator):
            poles = np.roots([1.0, *np.asarray(self.denominator)])
            if not (np.all(np.isfinite(self.numerator)) and np.all(np.abs(poles) < 1)):
                raise ValueError(
                    f"filter: is not stable, its poles are {np.array2string(poles, precision=4)}"
                )

    def steady(self, x: Float[Array, "*p"]) -> Float[Array, "2 *p"]:
        """Memory under a constant x, whose output is H(1) x with H(1) = sum b / (1 + sum a)."""
        (b0, _, b2), (_, a2) = self.numerator, self.denominator
        y = jnp.sum(self.numerator) / (1 + jnp.sum(self.denominator)) * x
        return jnp.stack([y - b0 * x, b2 * x - a2 * y])

    def step(
        self, memory: Float[Array, "2 *p"], x: Float[Array, "*p"]
    ) -> tuple[Float[Array, "2 *p"], Float[Array, "*p"]]:
        (b0, b1, b2), (a1, a2) = self.numerator, self.denominator
        y = b0 * x + memory[0]
        return jnp.stack([b1 * x - a1 * y + memory[1], b2 * x - a2 * y]), y


def tustin(numerator, denominator, dt: float, prewarp=None) -> Biquad:
    """Digital form of (n2 s^2 + n1 s + n0) / (d2 s^2 + d1 s + d0), coefficients from s^2 down.

    Args:
        numerator: (3,) n2, n1, n0.
        denominator: (3,) d2, d1, d0.
        dt: sample period [s].
        prewarp: frequency [rad/s] at which the gain stays exact; none when not given.

    Raises:
        ValueError: the digital filter is not stable, or `prewarp` is not below the Nyquist
            frequency.
    """
    if prewarp is not None and is_concrete(prewarp) and not 0 < float(prewarp) < np.pi / dt:
        needed = f"a frequency above zero and below {np.pi / dt:.4g} rad/s"
        raise ValueError(f"prewarp: needs {needed}, received {prewarp}")
    c = 2 / dt if prewarp is None else prewarp / jnp.tan(prewarp * dt / 2)

    def sampled(polynomial):
        q2, q1, q0 = jnp.asarray(polynomial, float)
        return jnp.stack([q2 * c**2 + q1 * c + q0, 2 * (q0 - q2 * c**2), q2 * c**2 - q1 * c + q0])

    b, a = sampled(numerator), sampled(denominator)
    return Biquad(b / a[0], a[1:] / a[0])


def notch(frequency, depth, damping, dt: float, prewarp: bool = False) -> Biquad:
    """Notch with the gain g at w and the gain one far away (Yuan, eq. 3.9).

        (s^2 + 2 g zeta w s + w^2) / (s^2 + 2 zeta w s + w^2)

    Args:
        frequency: w [rad/s].
        depth: g, the gain left at w.
        damping: zeta, half the relative width.
        dt: sample period [s].
        prewarp: keep the notch exactly at w; the thesis's numbers are without.

    Raises:
        ValueError: as `tustin`.
    """
    w = jnp.asarray(frequency, float)
    one = jnp.ones_like(w)
    denominator = jnp.stack([one, 2 * damping * w, w**2])
    numerator = denominator * jnp.stack([one, jnp.asarray(depth, float), one])
    return tustin(numerator, denominator, dt, frequency if prewarp else None)


def low_pass(frequency, damping, dt: float) -> Biquad:
    """Low pass w^2 / (s^2 + 2 zeta w s + w^2), prewarped at w.

    Raises:
        ValueError: as `tustin`.
    """
    w = jnp.asarray(frequency, float)
    none = jnp.zeros_like(w)
    numerator = jnp.stack([none, none, w**2])
    denominator = jnp.stack([jnp.ones_like(w), 2 * damping * w, w**2])
    return tustin(numerator, denominator, dt, frequency)


class FilterMemory(NamedTuple):
    """Memory of the filter, and of the wrapped controller."""

    filter: Float[Array, "2 p"]
    inner: Any


class Filtered(Wrapper):
    """Any controller with a filter on every control, which starts in equilibrium.

    >>> from jcontour.controllers.feedback.cascade import Cascade, CascadeGains
    >>> from jcontour.sensors import motors
    >>> cascade = Cascade(CascadeGains(30.0, 55.67, 0.04), motors(1), dt=1e-3)
    >>> filtered = Filtered(cascade, notch(frequency=87.0, depth=0.85, damping=0.05, dt=1e-3), 1)
    >>> [round(float(b), 4) for b in filtered.filter.numerator]
    [0.9994, -1.9838, 0.992]

    Args:
        controller: the wrapped controller.
        filter: filter of its controls.
        inputs: number of controls p.
        holding: control per m that holds an axis at rest, as in `Cascade`; none when not given.
    """

    controller: Controller
    filter: Biquad
    inputs: int = eqx.field(static=True)
    holding: Float[ArrayLike, "*p"] | None = None

    def initial_memory(self, reference: Reference) -> FilterMemory:
        """Filter in its steady state under the control that holds the first place, and the rest."""
        held = jnp.zeros(self.inputs, self.filter.numerator.dtype)
        if self.holding is not None:
            held = held + self.holding * reference.position[0]
        return FilterMemory(self.filter.steady(held), self.controller.initial_memory(reference))

    def step(
        self, memory: FilterMemory, plan: Any, measurement: Any
    ) -> tuple[FilterMemory, Float[Array, " p"]]:
        inner, control = self.controller.step(memory.inner, plan, measurement)
        filtered, control = self.filter.step(memory.filter, control)
        return FilterMemory(filtered, inner), control

    def with_integrals_held(
        self, before: FilterMemory, after: FilterMemory, holds: Any
    ) -> FilterMemory:
        inner = self.controller.with_integrals_held(before.inner, after.inner, holds)
        return after._replace(inner=inner)


class Shaped(Wrapper):
    """A controller behind an input shaper.

    >>> from jcontour.controllers.feedback.cascade import Cascade, CascadeGains
    >>> from jcontour.motion.input_shaping import zv
    >>> from jcontour.sensors import motors
    >>> cascade = Cascade(CascadeGains(30.0, 55.67, 0.04), motors(1), dt=1e-3)
    >>> Shaped(cascade, zv(frequency=87.0, damping=0.0)).shaper.amplitudes.tolist()
    [0.5, 0.5]

    Args:
        controller: the wrapped controller.
        shaper: shaper of `input_shaping`.
    """

    laws_not_kept = {"restart": "the shaper reads samples before the one at which a run begins"}
    controller: Controller
    shaper: Shaper

    def prepare(self, reference: Reference) -> Plan:
        """Plan of the wrapped controller for the shaped positions.

        Tangents and arc lengths stay those of the reference.
        """
        positions = shaped_positions(reference, self.shaper)
        return self.controller.prepare(eqx.tree_at(lambda r: r.position, reference, positions))


@jax.jit
def shaped_positions(reference: Reference, shaper: Shaper) -> Float[Array, "S m"]:
    """Weighted sum of delayed copies [m].

    Before its first sample the reference was in the steady motion of its start.
    """
    samples = reference.position
    count = samples.shape[0]
    at = jnp.arange(count, dtype=samples.dtype)[:, None] - (shaper.times / reference.dt)[None]
    below = jnp.clip(jnp.floor(at).astype(int), 0, count - 2)
    share = (at - below.astype(at.dtype))[..., None]
    between = samples[below] + share * (samples[below + 1] - samples[below])
    before = samples[:1, None] + at[..., None] * reference.start_increment[None, None]
    copies = jnp.where(at[..., None] < 0, before, between)
    return jnp.einsum("kim,i->km", copies, shaper.amplitudes)


class Compensated(Wrapper):
    """A controller with a compensation that sees the same measurement.

    Args:
        controller: gives u'.
        compensation: f, traceable; if it is a pytree with numbers, they are tuned with those of
            the controller.
    """

    controller: Controller
    compensation: Callable[[Any, Array], Array]

    def step(
        self, memory: Memory, plan: Plan, measurement: Any
    ) -> tuple[Memory, Float[Array, " p"]]:
        """Next memory and u' + f(measurement, u').

        Raises:
            ValueError: the compensation is not of the control's shape.
        """
        memory, control = self.controller.step(memory, plan, measurement)
        added = self.compensation(measurement, control)
        if added.shape != control.shape:
            raise ValueError(
                f"compensation: needs the control's shape {control.shape}, received {added.shape}"
            )
        return memory, control + added
