"""Cross-coupled position command shaping (CPSCS): the contour error corrects the position commands.

    eps = c'(r - y),   command: r + k eps n        (Yuan, section 2.3.3)
Unlike pre-compensation it has no memory. Unlike cross-coupled control it needs no access to the
drives: it may run beside the numerical control. Inside a cascade it makes the position loop stiffer
across the path, k_pp (1 + k) in place of k_pp. A steady contour error is divided by 1 + k when both
axes have the same k_pp.
"""

from jaxtyping import Array, Float

from jcontour.controller import checked_gain
from jcontour.controllers.contouring.path_frame import OnPath, PathPlan
from jcontour.controllers.feedback.cascade import Cascade, CascadePlan
from jcontour.motion.references import Reference


class CommandShaped(OnPath):
    """A cascade behind CPSCS.

    Args:
        cascade: the axes.
        gain: k [-]; zero leaves the plain cascade.

    Raises:
        ValueError: the gain is negative or not finite.
    """

    cascade: Cascade
    gain: Float[Array, ""]

    def __init__(self, cascade: Cascade, gain):
        self.cascade, self.gain = cascade, checked_gain("gain", gain)

    def initial_memory(self, reference: Reference) -> Float[Array, " 2"]:
        """Integrators of the cascade at zero."""
        return self.cascade.initial_memory(reference)

    def step(
        self, memory, plan: PathPlan, measurement
    ) -> tuple[Float[Array, " 2"], Float[Array, " 2"]]:
        """Next integrators and the control."""
        command, frame = plan.command, plan.frame
        position, _ = self.cascade.sensors.read(measurement)
        error = frame.contour_error(command.position - position)
        shaped = CascadePlan(
            command.position + self.gain * error * frame.normal, command.velocity, command.control
        )
        return self.cascade.step(memory, shaped, measurement)
