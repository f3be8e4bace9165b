"""Friction of a guide way: largest at rest, falling with speed, with sticking and viscous drag.

    F_f = s (f_c + f_s / (1 + (v / v_s)^2)) + b_v v        (Yuan, eq. 3.8, Lorentzian)
s is the direction of slip. The printed eq. 3.8 decides between stick and slip by a speed threshold
and compares with a force that omits spring and damper. Here a slider has an explicit mode s in
{-1, 0, 1}, as Karnopp had it, and the whole force decides.
"""

from collections.abc import Callable
from typing import TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from jcontour._arrays import check_above_zero, check_signs, ranked, whole_number
from jcontour.plant import Plant

Axes = Float[Array, "*m"]
PerAxis = Float[Array, "#m"]  # one value, or one for each axis


def by_axis(value) -> PerAxis:
    """Converter of a field: one value, or one for each axis."""
    return ranked(value, 1)


class Friction(eqx.Module):
    """Lorentzian friction of every axis.

    Args:
        coulomb: f_c [N].
        stribeck: f_s [N], the additional force at rest.
        stribeck_speed: v_s [m/s].
        viscous: b_v [N s/m].

    Raises:
        ValueError: a value is negative or not finite, or the Stribeck speed is zero.
    """

    coulomb: PerAxis = eqx.field(converter=by_axis)
    stribeck: PerAxis = eqx.field(converter=by_axis)
    stribeck_speed: PerAxis = eqx.field(converter=by_axis)
    viscous: PerAxis = eqx.field(converter=by_axis)

    def __check_init__(self):
        check_signs(self, ("stribeck_speed",), ("coulomb", "stribeck", "viscous"))

    def slipping(self, mode: Int[Array, "*m"], speed: Axes) -> Axes:
        """Force against the motion [N] while the mode is -1 or 1."""
        return mode.astype(speed.dtype) * self.dry(speed) + self.viscous * speed

    def smooth(self, speed: Axes, sharpness: Float[Array, ""]) -> Axes:
        """Force of the differentiable twin [N]: tanh(sharpness v) replaces the mode.

        It creeps where the true friction sticks.
        """
        return jnp.tanh(sharpness * speed) * self.dry(speed) + self.viscous * speed

    def dry(self, speed: Axes) -> Axes:
        """Size of the force without drag [N]."""
        return self.coulomb + self.stribeck / (1 + (speed / self.stribeck_speed) ** 2)

    def viscous_alone(self) -> "Friction":
        """The same without dry friction."""
        nothing = [jnp.zeros_like(force) for force in (self.coulomb, self.stribeck)]
        return eqx.tree_at(lambda one: (one.coulomb, one.stribeck), self, nothing)

    def released(self, mode: Int[Array, "*m"], force: Axes) -> Int[Array, "*m"]:
        """Mode before a substep: a slider at rest breaks loose when the force exceeds f_c + f_s.

        It then slips in the direction of the force.
        """
        loose = jnp.abs(force) > self.coulomb + self.stribeck
        return jnp.where((mode == 0) & loose, jnp.sign(force).astype(mode.dtype), mode)


def caught(mode: Int[Array, "*m"], speed: Axes) -> Int[Array, "*m"]:
    """Mode after a substep: a slider whose speed has turned against its mode sticks."""
    return jnp.where(mode.astype(speed.dtype) * speed <= 0, 0, mode)


def without_dry_friction(plant: Plant) -> Plant:
    """The plant, or a stack of plants, with viscous friction alone.

    Loops at a steady speed are looked at like this: the slope of the dry friction is a large
    damping at rest and a negative one where it falls with speed. A run passes both in no time.
    """

    def rest(part):
        return part.viscous_alone() if isinstance(part, Friction) else part

    return jax.tree.map(rest, plant, is_leaf=lambda part: isinstance(part, Friction))


def with_dry_friction_times(plant: Plant, factor: Axes) -> Plant:
    """The plant with its dry friction so many times as large, by axis."""

    def scaled(part):
        if not isinstance(part, Friction):
            return part
        forces = [force * factor for force in (part.coulomb, part.stribeck)]
        return eqx.tree_at(lambda one: (one.coulomb, one.stribeck), part, forces)

    return jax.tree.map(scaled, plant, is_leaf=lambda part: isinstance(part, Friction))


State = TypeVar("State")  # any pytree of arrays


def substeps_of(dt: float, substeps: int | float | None, longest: float) -> int:
    """Substeps in a sample; as many as `longest` [s] fits into it where none are given.

    Raises:
        ValueError: `dt` is not above zero or no whole number of them, or `substeps` not a whole
            number of at least one.
    """
    check_above_zero(dt=dt)
    count = round(dt / longest) if substeps is None else substeps
    if substeps is None and (count < 1 or abs(count * longest - dt) > 1e-9 * dt):
        raise ValueError(
            f"substeps: {longest} s does not divide the sample period {dt} s; give their number"
        )
    return whole_number("substeps", count, 1)


def runge_kutta(rates: Callable[[State], State], x: State, h: float | Float[Array, ""]) -> State:
    """State after one classical Runge-Kutta step of fourth order over h seconds.

    Args:
        rates: any function from a state to its time derivative.
        x: the state, any pytree.
        h: step [s].
    """

    def ahead(slope: State, share: float) -> State:
        return jax.tree.map(lambda a, b: a + share * h * b, x, slope)

    k1 = rates(x)
    k2 = rates(ahead(k1, 0.5))
    k3 = rates(ahead(k2, 0.5))
    k4 = rates(ahead(k3, 1.0))
    return jax.tree.map(
        lambda a, p, q, r, s: a + h / 6 * (p + 2 * q + 2 * r + s), x, k1, k2, k3, k4
    )
