"""A controller plus a compensation of the machine's nonlinear terms: u = u' + f(measurement, u').

Feedback linearisation (Yuan, eq. 5.44): the wrapped controller is designed for the linear machine
that f leaves.
"""

from collections.abc import Callable
from typing import Any

from jaxtyping import Array, Float

from jcontour.controller import Controller, Memory, Plan, Wrapper
from jcontour.motion.references import Reference


class Compensated(Wrapper):
    """A controller with a compensation that sees the same measurement.

    Args:
        controller: gives u'.
        compensation: f, traceable; if it is a pytree with numbers, they are tuned with those of
            the controller.
    """

    controller: Controller
    compensation: Callable[[Any, Array], Array]

    def initial_memory(self, reference: Reference) -> Memory:
        """Memory of the wrapped controller."""
        return self.controller.initial_memory(reference)

    def step(
        self, memory: Memory, plan: Plan, measurement: Any
    ) -> tuple[Memory, Float[Array, " p"]]:
        """Next memory and u' + f(measurement, u').

        Raises:
            ValueError: the compensation is not of the control's shape.
        """
        memory, control = self.controller.step(memory, plan, measurement)
        added = self.compensation(measurement, control)
        if added.shape != control.shape:
            raise ValueError(
                f"compensation: needs the control's shape {control.shape}, received {added.shape}"
            )
        return memory, control + added
