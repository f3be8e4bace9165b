"""Backlash between a motor that is measured and the tool that it moves."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from jcontour.wrapper import Remembering


class Backlash(Remembering):
    """A plant whose tool rests inside a gap until the motor pushes it.

        tool(k+1) = clip(tool(k), q(k+1) - gap / 2, q(k+1) + gap / 2)
    with the outputs q of the wrapped plant: the play operator, of a tool that friction holds. The
    measurement is that of the wrapped plant, at the motor. The tool starts behind the motion.

    >>> from jcontour.plants.bridgeport import bridgeport
    >>> loose = Backlash(bridgeport(), jnp.array([4e-6, 0.0]))
    >>> start = loose.initial_state(jnp.zeros(2), jnp.zeros(2))
    >>> loose.output(start).tolist()
    [0.0, 0.0]

    Args:
        plant: the machine with its encoders.
        gap: of every axis [m].
    """

    gap: Float[Array, " m"]

    def initial_state(self, position, increment) -> tuple:
        """The plant half a gap ahead of the tool, where it moves."""
        ahead = position + self.gap / 2 * jnp.sign(increment)
        return self.plant.initial_state(ahead, increment), jnp.asarray(position, float)

    def step(self, state, control) -> tuple:
        """Step of the plant, and of the tool that it pushes."""
        inner = self.plant.step(state[0], control)
        motor = self.plant.output(inner)
        return inner, jnp.clip(state[1], motor - self.gap / 2, motor + self.gap / 2)

    def output(self, state) -> Float[Array, " m"]:
        """The tool [m]."""
        return state[1]
