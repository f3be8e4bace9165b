"""Controllers in plain Python: what the loop on the host calls, and what wrappers of them share.

    w(k+1), u(k), report = step(w(k), plan(k), y(k))
is the step of `jcontour.controller.Controller` with a third value, the report. A host controller
is a value as well: no method changes it, so one object serves any number of runs at once.
"""

import abc
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from jcontour.motion.references import Reference


class StepReport(NamedTuple):
    """Account of one step."""

    active: int = 0  # how many limits were active
    residual: float = 0.0  # the largest scaled KKT residual of the QP
    iterations: int = 0  # of the solver
    slack: float = 0.0  # the largest violation of a soft limit, in that limit's unit
    # how many of the active limits are on what the control of the step alone decides: the control
    # itself, its change, the speed and the acceleration that come next
    acting: int = 0


Stepped = tuple[Any, Float[np.ndarray, " p"], StepReport]  # next memory, control, report


class HostController(abc.ABC):
    """A sampled controller in plain Python.

    Measurements, plans, memories and controls are NumPy arrays, or pytrees of them.
    """

    preview: int

    @abc.abstractmethod
    def prepare(self, reference: Reference) -> Any:
        """Everything that depends on the future only.

        A pytree of NumPy arrays with a leading axis of T steps, or None.
        """

    @abc.abstractmethod
    def initial_memory(self, reference: Reference) -> Any:
        """Memory before the first step: a pytree of NumPy arrays and numbers.

        Its shapes never change; each step makes a new one.
        """

    @abc.abstractmethod
    def step(self, memory: Any, plan: Any, measurement: Any) -> Stepped:
        """Next memory, control and report, from one row of the plan and the sensors.

        Raises:
            Unsolved: the QP of this step has no answer.
        """

    def soft_step(self, memory: Any, plan: Any, measurement: Any) -> Stepped | None:
        """The step with softened limits, for the fallback "soft"; None where there is none."""
        return None

    def held(self, memory: Any, measurement: Any, control: Float[np.ndarray, " p"]) -> Any:
        """Memory after a step in which the fallback repeated the last control."""
        return memory

    def finished(self, memory: Any) -> bool:
        """Whether the run is over: for controllers that choose their own speed."""
        return False


class HostWrapper(HostController):
    """A host controller around another: a subclass states what goes in and what comes out.

    Every kind of step passes through both. The memory has a field `inner`, the memory of the
    wrapped controller.

    Args:
        controller: the wrapped one.
    """

    def __init__(self, controller: HostController):
        self.controller = controller
        self.preview = controller.preview

    @abc.abstractmethod
    def enter(self, memory: Any, measurement: Any) -> Any:
        """Measurement that the wrapped controller is fed."""

    @abc.abstractmethod
    def leave(
        self, memory: Any, fed: Any, inner: Any, control: Float[np.ndarray, " p"]
    ) -> tuple[Any, Float[np.ndarray, " p"]]:
        """Next memory and the control that acts, from those of the wrapped controller."""

    def prepare(self, reference: Reference) -> Any:
        return self.controller.prepare(reference)

    def step(self, memory: Any, plan: Any, measurement: Any) -> Stepped:
        fed = self.enter(memory, measurement)
        return self._left(memory, fed, self.controller.step(memory.inner, plan, fed))

    def soft_step(self, memory: Any, plan: Any, measurement: Any) -> Stepped | None:
        fed = self.enter(memory, measurement)
        answer = self.controller.soft_step(memory.inner, plan, fed)
        return None if answer is None else self._left(memory, fed, answer)

    def held(self, memory: Any, measurement: Any, control: Float[np.ndarray, " p"]) -> Any:
        fed = self.enter(memory, measurement)
        inner = self.controller.held(memory.inner, fed, control)
        return self.leave(memory, fed, inner, control)[0]

    def finished(self, memory: Any) -> bool:
        return self.controller.finished(memory.inner)

    def _left(self, memory: Any, fed: Any, answer: Stepped) -> Stepped:
        inner, command, report = answer
        following, control = self.leave(memory, fed, inner, command)
        return following, control, report
