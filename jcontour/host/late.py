"""A controller that needs its whole period to answer: what it finds acts one sample later."""

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from jcontour.host.controller import HostController, HostWrapper
from jcontour.linear.plant import LinearPlant
from jcontour.motion.references import Reference


class LateMemory(NamedTuple):
    """Memory of the wrapped controller, and the control on its way to the machine."""

    inner: Any
    waiting: Float[np.ndarray, " p"]


class OneSampleLate(HostWrapper):
    """A controller whose u(k) acts from sample k+1 on.

    Args:
        controller: fed [x, u(k-1)], the state of a model with one sample of input delay.
        model: that model.
    """

    def __init__(self, controller: HostController, model: LinearPlant):
        super().__init__(controller)
        self.model = model

    def initial_memory(self, reference: Reference) -> LateMemory:
        """The control that holds the machine at the start on its way, as in `Delayed`.

        Raises:
            ValueError: as `LinearPlant.holding_control`, or what the wrapped controller raises.
        """
        held = np.asarray(self.model.holding_control(reference.position[0]))
        return LateMemory(self.controller.initial_memory(reference), held)

    def enter(self, memory: LateMemory, measurement: Any) -> np.ndarray:
        """The state, and the control that acts now."""
        return np.concatenate([measurement, memory.waiting])

    def leave(self, memory: LateMemory, fed: Any, inner: Any, control: Any):
        """The control found one sample ago acts, the one found now waits."""
        return LateMemory(inner, control), memory.waiting
