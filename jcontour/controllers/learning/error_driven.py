"""A controller with something around it that learns from the position error while it runs."""

import abc
from typing import Any, NamedTuple

import equinox as eqx
from jaxtyping import Array, Float

from jcontour.controller import Wrapper, check_axes
from jcontour.motion.references import Reference
from jcontour.sensors import Sensors


class ErrorDrivenPlan(NamedTuple):
    """Plan of the wrapped controller, and the positions of the reference [m]."""

    inner: Any
    wanted: Float[Array, "*T m"]


class ErrorDrivenMemory(NamedTuple):
    """What has been learned, and the memory of the wrapped controller."""

    learned: Any
    inner: Any


class ErrorDriven(Wrapper):
    """What repetitive control and cancellation of run-out share: both read e = r - y."""

    sensors: eqx.AbstractVar[Sensors]

    @abc.abstractmethod
    def untaught(self, axes: int) -> Any:
        """What is known before the first sample."""

    def prepare(self, reference: Reference) -> ErrorDrivenPlan:
        """Plan of the wrapped controller, and the positions of the reference.

        Raises:
            ValueError: the reference has another number of axes.
        """
        check_axes(self.sensors.axes, reference)
        wanted = reference.position[: reference.steps]
        return ErrorDrivenPlan(self.controller.prepare(reference), wanted)

    def initial_memory(self, reference: Reference) -> ErrorDrivenMemory:
        """Nothing learned yet."""
        inner = self.controller.initial_memory(reference)
        return ErrorDrivenMemory(self.untaught(self.sensors.axes), inner)

    def error(self, plan: ErrorDrivenPlan, measurement: Any) -> Float[Array, " m"]:
        """Position error e of this sample [m]."""
        return plan.wanted - self.sensors.positions(measurement)
