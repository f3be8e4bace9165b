"""An input shaper on the reference of any controller: a weighted sum of delayed copies.

The score is still taken against the reference itself, so that the shaper's delay counts as an
error. The reference is known at its samples only; between them copies are interpolated linearly.
So a mode w keeps up to (w dt)^2 / 8 of its vibration in spite of the shaper. Where the reference is
given as a function of time, use `input_shaping`: it has every impulse exactly, and keeps the tool
on a contour, which this does not.
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jcontour.controller import Controller, Plan, Wrapper
from jcontour.motion.input_shaping import Shaper
from jcontour.motion.references import Reference


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

    def initial_memory(self, reference: Reference) -> Any:
        """Memory of the wrapped controller: the machine starts where the reference does."""
        return self.controller.initial_memory(reference)

    def step(self, memory: Any, plan: Any, measurement: Any) -> tuple[Any, Float[Array, " p"]]:
        """Step of the wrapped controller."""
        return self.controller.step(memory, plan, measurement)


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
