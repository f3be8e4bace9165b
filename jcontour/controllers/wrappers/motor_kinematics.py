"""A controller of motors on a machine whose motors are not its axes.

The path of every motor follows from that of the tool, r_motor = K r with K (q, m). A gantry's two Y
drives both follow y: its beam is taken as straight.
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from jcontour.controller import Controller, Memory, Plan, Wrapper
from jcontour.motion.references import Reference


class OfMotors(Wrapper):
    """A controller that sees a reference of q motors where the machine has m axes.

    Args:
        controller: a controller of single motors, such as `Cascade`.
        kinematics: K (q, m).
    """

    controller: Controller
    kinematics: Float[Array, "q m"] = eqx.field(converter=jnp.asarray)

    def prepare(self, reference: Reference) -> Plan:
        """Plan of the wrapped controller along the path of the motors."""
        return self.controller.prepare(self._of_motors(reference))

    def initial_memory(self, reference: Reference) -> Memory:
        """Memory of the wrapped controller at the start of the motors' path."""
        return self.controller.initial_memory(self._of_motors(reference))

    def step(self, memory: Memory, plan: Plan, measurement) -> tuple[Memory, Float[Array, " q"]]:
        """Step of the wrapped controller."""
        return self.controller.step(memory, plan, measurement)

    def _of_motors(self, reference: Reference) -> Reference:
        return eqx.tree_at(
            lambda r: (r.position, r.tangent, r.start_increment),
            reference,
            replace_fn=lambda vectors: vectors @ self.kinematics.T,
        )
