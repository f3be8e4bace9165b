"""Backlash compensated: the motor leads the tool by half the gap, in the direction of motion."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jcontour.controller import Controller, Plan, Wrapper
from jcontour.motion.references import Reference

RISE = 8  # samples in which the gap is crossed: a jump would shake the loop
STILL = 1e-9  # [m] in a sample: no direction below it


class BacklashCompensation(Wrapper):
    """A controller whose reference leads by half a gap: r + gap / 2 sign(r').

    At rest the last direction holds. The lead turns within `RISE` samples before a reversal, so
    that the gap is closed when the tool turns; the score is taken against the reference itself.

    Args:
        controller: the wrapped controller, fed by encoders at the motor.
        gap: of every axis [m].
    """

    controller: Controller
    gap: Float[Array, " m"]

    def prepare(self, reference: Reference) -> Plan:
        """Plan of the wrapped controller for the leading positions."""
        ahead = reference.position + self.gap[None] / 2 * directions(reference)
        return self.controller.prepare(eqx.tree_at(lambda one: one.position, reference, ahead))

    def initial_memory(self, reference: Reference) -> Any:
        """Memory of the wrapped controller."""
        return self.controller.initial_memory(reference)

    def step(self, memory: Any, plan: Any, measurement: Any) -> tuple[Any, Float[Array, " p"]]:
        """Step of the wrapped controller."""
        return self.controller.step(memory, plan, measurement)


@jax.jit
def directions(reference: Reference) -> Float[Array, "S m"]:
    """Direction of every axis, in [-1, 1], turning before it reverses; 0 until it first moves."""
    moved = jnp.diff(reference.position, axis=0)
    moved = jnp.concatenate([moved, moved[-1:]])
    index = jnp.arange(len(moved))[:, None]
    last = jax.lax.cummax(jnp.where(jnp.abs(moved) > STILL, index, -1), axis=0)
    way = jnp.sign(jnp.take_along_axis(moved, jnp.maximum(last, 0), axis=0))
    way = jnp.where(last >= 0, way, 0.0)
    ahead = jnp.concatenate([way, jnp.repeat(way[-1:], RISE - 1, axis=0)])
    return jnp.mean(jnp.stack([ahead[k : k + len(way)] for k in range(RISE)]), axis=0)
