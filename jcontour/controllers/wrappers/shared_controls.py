"""A controller of fewer controls than the machine has: drives that share one, u = D v."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from jcontour.controller import Controller, Memory, Plan, Wrapper
from jcontour.motion.references import Reference


class SharedControls(Wrapper):
    """A controller whose q controls are shared out to the p drives of a machine.

    Args:
        controller: of q controls.
        shares: D (p, q).
    """

    controller: Controller
    shares: Float[Array, "p q"] = eqx.field(converter=jnp.asarray)

    def initial_memory(self, reference: Reference) -> Memory:
        """Memory of the wrapped controller."""
        return self.controller.initial_memory(reference)

    def step(self, memory: Memory, plan: Plan, measurement) -> tuple[Memory, Float[Array, " p"]]:
        """Step of the wrapped controller, shared out."""
        memory, control = self.controller.step(memory, plan, measurement)
        return memory, self.shares @ control
