"""Delay lines in front of a plant and behind it."""

import abc
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from jcontour._arrays import is_concrete
from jcontour.plant import State
from jcontour.wrapper import Remembering


class _LateControl(Remembering):
    """A plant whose control waits in a line of fixed `depth`, so that plants of any delay batch.

    The controller does not know it: it is fed the measurement of the undelayed part. The line
    starts with the control that holds the plant at rest, zero where drives take a speed or a force.
    So a run that starts in motion is pushed for the first samples, as the reference numbers of
    McNab and Tsao's late machines are.

    Raises:
        ValueError: the depth is below one, or the delay is not between zero and the depth.
    """

    samples: eqx.AbstractVar[Any]
    depth: eqx.AbstractVar[int]
    inputs: eqx.AbstractVar[int]

    def __check_init__(self):
        if self.depth < 1:
            raise ValueError(
                f"depth: the delay line needs at least one place, received {self.depth}"
            )
        if is_concrete(self.samples):
            delays = np.asarray(self.samples)
            if not np.all((delays >= 0) & (delays <= self.depth)):
                raise ValueError(
                    f"samples: needs a delay from 0 to the depth {self.depth}, "
                    f"received {self.samples}"
                )

    def initial_state(self, position, increment) -> State:
        """State of the wrapped plant, and the control that holds it at rest in all of the line."""
        held = self.plant.holding_control(position)
        line = jnp.broadcast_to(held, (self.depth, self.inputs))
        return self.plant.initial_state(position, increment), line

    def step(self, state, control) -> State:
        inner, line = state
        after = self.plant.step(inner, self.acting(line, control))
        return after, jnp.concatenate([control[None], line])[:-1]

    @abc.abstractmethod
    def acting(
        self, line: Float[Array, "depth p"], control: Float[Array, " p"]
    ) -> Float[Array, " p"]:
        """Control that acts now (p,)."""


class Delayed(_LateControl):
    """A plant on which the control acts `samples` late, a whole number with a traced tap.

    >>> from jcontour.plants.linear_machines import bridgeport
    >>> late = Delayed(bridgeport(), 1, depth=2, inputs=2)
    >>> rest = late.initial_state(jnp.zeros(2), jnp.zeros(2))
    >>> plant_state, line = late.step(rest, jnp.array([10.0, 0.0]))
    >>> plant_state.tolist() == rest[0].tolist(), line.tolist()
    (True, [[10.0, 0.0], [0.0, 0.0]])

    Raises:
        ValueError: the depth is below one, or the delay is not between zero and the depth.
    """

    samples: Int[Array, ""] = eqx.field(converter=jnp.asarray)
    depth: int = eqx.field(static=True)
    inputs: int = eqx.field(static=True)

    def acting(self, line, control) -> Float[Array, " p"]:
        """u(k - samples)."""
        return jnp.concatenate([control[None], line])[self.samples]


class PartlyDelayed(_LateControl):
    """A plant on which the control acts a part of a sample late, or several samples and a part.

        u_acts(k) = (1 - f) u(k - n) + f u(k - n - 1),   delay = n + f samples
    It is the mean over the sample of a control that is held and changes f of a sample late.

    >>> from jcontour.plants.linear_machines import bridgeport
    >>> late = PartlyDelayed(bridgeport(), 0.25, depth=1, inputs=2)
    >>> rest = late.initial_state(jnp.zeros(2), jnp.zeros(2))
    >>> late.acting(rest[1], jnp.array([1.0, 0.0])).tolist()
    [0.75, 0.0]

    Raises:
        ValueError: the depth is below one, or the delay is not between zero and the depth.
    """

    samples: Float[Array, ""] = eqx.field(converter=jnp.asarray)
    depth: int = eqx.field(static=True)
    inputs: int = eqx.field(static=True)

    def acting(self, line, control) -> Float[Array, " p"]:
        """The mean of the two that act within the sample."""
        line = jnp.concatenate([control[None], line])
        whole = jnp.minimum(jnp.floor(self.samples), self.depth - 1)
        part, index = self.samples - whole, whole.astype(int)
        return (1 - part) * line[index] + part * line[index + 1]
