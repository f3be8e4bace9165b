"""A Kalman filter in front of a host controller: `FilterObserver` on the host."""

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from jcontour.host.loop import HostController, StepReport
from jcontour.linear.plant import LinearPlant
from jcontour.motion.references import Reference


class ObservedMemory(NamedTuple):
    """The predicted state xh, and the memory of the controller inside."""

    estimate: Float[np.ndarray, " n"]
    inner: Any


class ObservedHost(HostController):
    """The controller acts on the estimate that includes the current measurement: xf = xh + L (y - C xh), xh(k+1) = A xf + B u.

    Args:
        controller: fed the state.
        model: of the machine.
        gain: the filter gain L (n, m), as `kalman_gain` gives it.

    Raises:
        ValueError: the gain has the wrong shape.
    """

    def __init__(self, controller: HostController, model: LinearPlant, gain):
        self.controller, self.model, self.preview = controller, model, controller.preview
        self._A, self._B, self._C = (np.asarray(matrix) for matrix in (model.A, model.B, model.C))
        self._gain = np.asarray(gain, float)
        if self._gain.shape != (model.states, model.axes):
            raise ValueError(
                f"gain: needs shape ({model.states}, {model.axes}), received {self._gain.shape}"
            )

    def prepare(self, reference: Reference) -> Any:
        """That of the controller inside."""
        return self.controller.prepare(reference)

    def initial_memory(self, reference: Reference) -> ObservedMemory:
        """The estimate starts where the reference says the run begins."""
        known = np.asarray(
            self.model.initial_state(reference.position[0], reference.start_increment)
        )
        return ObservedMemory(known, self.controller.initial_memory(reference))

    def step(
        self, memory: ObservedMemory, plan, measurement
    ) -> tuple[ObservedMemory, Float[np.ndarray, " p"]]:
        """Correct, control, predict."""
        filtered = self._filtered(memory, measurement)
        inner, control = self.controller.step(memory.inner, plan, filtered)
        return self._predicted(filtered, control, inner), control

    def soft_step(self, memory: ObservedMemory, plan, measurement):
        """The same with the softened step of the controller inside, None where it has none."""
        filtered = self._filtered(memory, measurement)
        answer = self.controller.soft_step(memory.inner, plan, filtered)
        return (
            None if answer is None else (self._predicted(filtered, answer[1], answer[0]), answer[1])
        )

    def held(self, memory: ObservedMemory, measurement, control) -> ObservedMemory:
        """The estimate goes on under the held control."""
        filtered = self._filtered(memory, measurement)
        return self._predicted(
            filtered, control, self.controller.held(memory.inner, filtered, control)
        )

    def finished(self, memory: ObservedMemory) -> bool:
        """That of the controller inside."""
        return self.controller.finished(memory.inner)

    def report(self) -> StepReport:
        """That of the controller inside."""
        return self.controller.report()

    def _filtered(self, memory: ObservedMemory, measurement):
        return memory.estimate + self._gain @ (measurement - self._C @ memory.estimate)

    def _predicted(self, filtered, control, inner) -> ObservedMemory:
        return ObservedMemory(self._A @ filtered + self._B @ control, inner)
