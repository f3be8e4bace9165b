"""Cross-coupled pre-compensation (CCPM): the contour error corrects the velocity commands.

    eps = c'(r - y),   da/dt = k eps
    command: r + a n,   its velocity: (1 - kappa a) dr/dt + k eps n
After Chin & Lin 1997 (Yuan, section 2.3.3). The correction acts before the velocity commands are
integrated to positions. The offset a stays on the normal as the path turns, so that the feed of the
command changes by 1 - kappa a: slower on the inside of a curve, faster on its outside. Where a
comes to rest no error is left, eps = 0: on lines for any axes, on circles at constant feed for
equal axes.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from jcontour.controller import checked_gain
from jcontour.controllers.contouring.path_frame import OnPath, PathPlan
from jcontour.controllers.feedback.cascade import Cascade, CascadePlan
from jcontour.motion.references import Reference


class PrecompensationMemory(NamedTuple):
    """Integrators of the cascade, and the offset of the command."""

    cascade: Float[Array, " 2"]
    offset: Float[Array, ""]  # a [m], positive to the left of the path


class Precompensated(OnPath):
    """A cascade behind CCPM.

    Args:
        cascade: the axes.
        gain: k [1/s]; zero leaves the plain cascade. Stable while it is well below the bandwidth of
            the position loops.

    Raises:
        ValueError: the gain is negative or not finite.
    """

    cascade: Cascade
    gain: Float[Array, ""]

    def __init__(self, cascade: Cascade, gain):
        self.cascade, self.gain = cascade, checked_gain("gain", gain)

    def initial_memory(self, reference: Reference) -> PrecompensationMemory:
        """Integrators and offset at zero."""
        zero = jnp.zeros((), reference.position.dtype)
        return PrecompensationMemory(self.cascade.initial_memory(reference), zero)

    def step(
        self, memory: PrecompensationMemory, plan: PathPlan, measurement
    ) -> tuple[PrecompensationMemory, Float[Array, " 2"]]:
        """Next memory and the control; the offset is updated before it is used."""
        command, frame = plan.command, plan.frame
        position, _ = self.cascade.sensors.read(measurement)
        rate = self.gain * frame.contour_error(command.position - position)
        offset = memory.offset + self.cascade.dt * rate
        shifted = CascadePlan(
            command.position + offset * frame.normal,
            (1 - frame.curvature * offset) * command.velocity + rate * frame.normal,
            command.control,
        )
        axes, control = self.cascade.step(memory.cascade, shifted, measurement)
        return PrecompensationMemory(axes, offset), control
