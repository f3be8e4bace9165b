"""A controller and, added to what it asks for, what the machine's nonlinear terms need: u = u' + f(measurement, u').

Feedback linearisation (Yuan, eq. 5.44): the controller inside is designed for the linear machine
that f leaves.
"""

from collections.abc import Callable
from typing import Any

from jaxtyping import Array, Float

from jcontour.controller import Controller, Memory, Plan, Wrapper
from jcontour.motion.references import Reference


class Compensated(Wrapper):
    """The controller inside sees the same measurement as the compensation.

    Args:
        controller: gives u'.
        compensation: f, traceable; its numbers are tuned with the controller's where it is a pytree
            that has some.
    """

    controller: Controller
    compensation: Callable[[Any, Array], Array]

    def initial_memory(self, reference: Reference) -> Memory:
        """That of the controller inside."""
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
