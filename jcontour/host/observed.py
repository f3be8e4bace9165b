"""The Kalman filter of `FilterObserver` in front of a host controller."""

from typing import Any

import numpy as np
from jaxtyping import Float

from jcontour.controllers.observers.kalman import ObserverMemory, corrected
from jcontour.host.controller import HostController, HostWrapper
from jcontour.linear.plant import LinearPlant
from jcontour.motion.references import Reference


class ObservedHost(HostWrapper):
    """The controller acts on the estimate that includes the current measurement.

    Args:
        controller: fed the state.
        model: of the machine.
        gain: the filter gain L (n, m), as `kalman_gain` gives it.

    Raises:
        ValueError: the gain has the wrong shape.
    """

    def __init__(self, controller: HostController, model: LinearPlant, gain):
        super().__init__(controller)
        self.model = model
        self._gain = np.asarray(gain, float)
        self._A, self._B, self._C = (np.asarray(matrix) for matrix in (model.A, model.B, model.C))
        if self._gain.shape != (model.states, model.axes):
            raise ValueError(
                f"gain: needs shape ({model.states}, {model.axes}), received {self._gain.shape}"
            )

    def initial_memory(self, reference: Reference) -> ObserverMemory:
        """The estimate starts where the reference says the run begins."""
        known = self.model.initial_state(reference.position[0], reference.start_increment)
        return ObserverMemory(np.asarray(known), self.controller.initial_memory(reference))

    def enter(self, memory: ObserverMemory, measurement: Any) -> Float[np.ndarray, " n"]:
        """The corrected estimate xf."""
        return corrected(memory.estimate, measurement, self._gain, self._C)

    def leave(self, memory: ObserverMemory, fed: Any, inner: Any, control: Any):
        """The predicted estimate A xf + B u, and the control as it is."""
        return ObserverMemory(self._A @ fed + self._B @ control, inner), control
