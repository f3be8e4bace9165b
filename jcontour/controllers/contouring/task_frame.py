"""Tangential-contouring control: a cascade whose position loop works in the frame of the path.

    v_ref = k_along t (t'e) + k_across n (n'e) + k_ff dr/dt,   e = r - y
Lo & Chung 1999, for biaxial machines with t and n of the reference point; Chiu & Tomizuka 2001 call
it the task coordinate frame (Yuan, section 2.3.2). Errors along and across the path are decoupled
as far as the axes are alike. The velocity loops stay with the axes, and make them alike.
"""

import jax.numpy as jnp
from jaxtyping import Array, Float

from jcontour.controllers.contouring.path_frame import OnPath, PathPlan
from jcontour.controllers.feedback.cascade import Cascade
from jcontour.motion.references import Reference


class TaskFrame(OnPath):
    """A cascade whose position gains hold along and across the path.

    With equal gains it is the plain cascade.

    Args:
        cascade: the axes; the two entries of its position gain are k_along and k_across [1/s].
    """

    cascade: Cascade

    def initial_memory(self, reference: Reference) -> Float[Array, " 2"]:
        """Integrators of the cascade at zero."""
        return self.cascade.initial_memory(reference)

    def step(
        self, memory, plan: PathPlan, measurement
    ) -> tuple[Float[Array, " 2"], Float[Array, " 2"]]:
        """Next integrators and the control, both within the limit."""
        position, velocity = self.cascade.sensors.read(measurement)
        gains, frame = self.cascade.gains, jnp.stack([plan.frame.tangent, plan.frame.normal])
        error = frame @ (plan.command.position - position)
        wanted = (gains.position * error) @ frame + gains.feedforward * plan.command.velocity
        return self.cascade.drive(memory, wanted - velocity, plan.command.control)
