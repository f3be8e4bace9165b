"""A controller of motors on a machine whose motors are not its axes: the path is handed to every motor by straight kinematics.

r_motor = K r with K (q, m): a gantry's two Y drives both follow y, its beam is taken as straight.
"""

import equinox as eqx
from jaxtyping import Array, Float

from jcontour.controller import Controller, Memory, Plan, Wrapper
from jcontour.motion.references import Reference


class OfMotors(Wrapper):
    """The controller inside sees a reference of q motors where the machine has m axes.

    Args:
        controller: of motors by themselves, such as `Cascade`.
        kinematics: K (q, m).
    """

    controller: Controller
    kinematics: Float[Array, "q m"]

    def prepare(self, reference: Reference) -> Plan:
        """That of the controller inside, along the path of the motors."""
        return self.controller.prepare(self._of_motors(reference))

    def initial_memory(self, reference: Reference) -> Memory:
        """That of the controller inside."""
        return self.controller.initial_memory(self._of_motors(reference))

    def step(self, memory: Memory, plan: Plan, measurement) -> tuple[Memory, Float[Array, " q"]]:
        """That of the controller inside."""
        return self.controller.step(memory, plan, measurement)

    def _of_motors(self, reference: Reference) -> Reference:
        return eqx.tree_at(
            lambda r: (r.position, r.tangent, r.start_increment),
            reference,
            replace_fn=lambda vectors: vectors @ self.kinematics.T,
        )
