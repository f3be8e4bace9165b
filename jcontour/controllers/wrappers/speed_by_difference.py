"""Speeds for a controller on a machine that measures positions only.

v(k) = (q(k) - q(k-1)) / dt
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from jcontour.controller import Controller, Wrapper
from jcontour.motion.references import Reference
from jcontour.sensors import Sensors


class DifferenceMemory(NamedTuple):
    """Last positions [m], and the memory of the wrapped controller."""

    position: Float[Array, " m"]
    inner: Any


class SpeedByDifference(Wrapper):
    """A controller that reads positions and speeds, (q, v), such as a cascade on `motors(m)`.

    >>> from jcontour.controllers.feedback.cascade import Cascade, CascadeGains
    >>> from jcontour.sensors import motors
    >>> cascade = Cascade(CascadeGains(30.0, 20.0, 0.02), motors(2), dt=1e-3)
    >>> differenced = SpeedByDifference(cascade, Sensors([0, 1]), dt=1e-3)

    Args:
        controller: the wrapped controller.
        sensors: where the positions stand in the measurement.
        dt: sample period [s].
    """

    controller: Controller
    sensors: Sensors
    dt: float = eqx.field(static=True)

    def initial_memory(self, reference: Reference) -> DifferenceMemory:
        """The machine entered its first sample as the reference says."""
        before = reference.position[0] - reference.start_increment
        return DifferenceMemory(before, self.controller.initial_memory(reference))

    def step(
        self, memory: DifferenceMemory, plan: Any, measurement: Any
    ) -> tuple[DifferenceMemory, Float[Array, " p"]]:
        """Step of the wrapped controller on positions and speeds."""
        position = self.sensors.positions(measurement)
        speed = (position - memory.position) / self.dt
        inner, control = self.controller.step(
            memory.inner, plan, jnp.concatenate([position, speed])
        )
        return DifferenceMemory(position, inner), control
