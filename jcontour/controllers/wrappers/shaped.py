"""An input shaper on the reference of any controller: every axis is told to go where the weighted, delayed copies of its reference are.

What is scored stays the reference itself, so that the shaper's delay counts as an error. The
reference is known at its samples only; in
between, copies are interpolated linearly: a mode w keeps up to (w dt)^2 / 8 of its vibration in
spite of the shaper. Where the reference comes from a law of time, `input_shaping.shaped_law` has
every impulse exactly, and keeps the tool on a contour, which this does not.
"""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from jcontour.controller import Controller, Plan, Wrapper
from jcontour.motion.input_shaping import Shaper
from jcontour.motion.references import Reference


class Shaped(Wrapper):
    """A controller behind a shaper.

    Args:
        controller: the one inside.
        shaper: of `input_shaping`.
    """

    controller: Controller
    shaper: Shaper

    def prepare(self, reference: Reference) -> Plan:
        """That of the controller inside, for the shaped positions; tangents and arc lengths stay those of the reference."""
        return self.controller.prepare(
            eqx.tree_at(lambda r: r.position, reference, shaped_positions(reference, self.shaper))
        )

    def initial_memory(self, reference: Reference) -> Any:
        """That of the controller inside: the machine starts where the reference does."""
        return self.controller.initial_memory(reference)

    def step(self, memory: Any, plan: Any, measurement: Any) -> tuple[Any, Float[Array, " p"]]:
        """That of the controller inside."""
        return self.controller.step(memory, plan, measurement)


def shaped_positions(reference: Reference, shaper: Shaper) -> Float[Array, "S m"]:
    """The weighted sum of delayed copies [m]; before its first sample the reference moved as it says."""
    samples = reference.position
    at = jnp.arange(samples.shape[0])[:, None] - shaper.times / reference.dt
    below = jnp.clip(jnp.floor(at).astype(int), 0, samples.shape[0] - 2)
    between = samples[below] + (at - below)[..., None] * (samples[below + 1] - samples[below])
    before = samples[0] + at[..., None] * reference.start_increment
    return jnp.einsum("kim,i->km", jnp.where(at[..., None] < 0, before, between), shaper.amplitudes)
