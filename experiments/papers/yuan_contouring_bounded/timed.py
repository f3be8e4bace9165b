"""A host controller whose steps are timed: the memory takes the times along."""

import gc
from time import thread_time
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from jcontour.host.controller import HostWrapper, Stepped
from jcontour.motion.references import Reference
from jcontour.simulation.closed_loop import Rollout


class TimedMemory(NamedTuple):
    """Memory of a timed controller.

    Attributes:
        inner: of the controller itself.
        seconds: processor time of the step that made it [s]; NaN where none has been solved.
    """

    inner: Any
    seconds: float


class Timed(HostWrapper):
    """The controller itself, and the processor time of each of its steps.

    A step without an answer has no time.

    Args:
        controller: any.
    """

    def initial_memory(self, reference: Reference) -> TimedMemory:
        """Nothing has been timed yet."""
        return TimedMemory(self.controller.initial_memory(reference), np.nan)

    def step(self, memory: TimedMemory, plan: Any, measurement: Any) -> Stepped:
        """The controller's step, timed; garbage of what ran before is not collected in it."""
        collecting = gc.isenabled()
        gc.disable()
        try:
            began = thread_time()
            inner, control, report = self.controller.step(memory.inner, plan, measurement)
            spent = thread_time() - began
        finally:
            if collecting:
                gc.enable()
        return TimedMemory(inner, spent), control, report

    def enter(self, memory: TimedMemory, measurement: Any) -> Any:
        """The measurement as it is."""
        return measurement

    def leave(
        self, memory: TimedMemory, fed: Any, inner: Any, control: Float[np.ndarray, " p"]
    ) -> tuple[TimedMemory, Float[np.ndarray, " p"]]:
        """The control as it is; steps of a fallback are not timed."""
        return TimedMemory(inner, np.nan), control


def seconds(rollout: Rollout) -> Float[np.ndarray, " S"]:
    """Processor times [s] of all steps that were solved.

    Args:
        rollout: of a timed controller.

    Raises:
        ValueError: no step was solved.
    """
    after = np.append(np.asarray(rollout.memory.seconds)[1:], rollout.final_memory.seconds)
    if np.isnan(after).all():
        raise ValueError("times: no step of the run was solved")
    return after[~np.isnan(after)]
