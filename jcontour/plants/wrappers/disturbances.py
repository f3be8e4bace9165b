"""Sequences that act on a plant from outside: forces and measurement noise."""

from typing import Any

import jax.numpy as jnp
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float, Int

from jcontour.plant import State
from jcontour.plants.wrappers.wrapper import Remembering


class Disturbed(Remembering):
    """Sequences that act from outside: `force` (T, p) adds to the control, `noise` (T, q) to the measurement, all its leaves in a row.

    The state carries a counter; beyond the end of a sequence its last row holds.
    """

    force: Float[Array, "T p"] | None = None
    noise: Float[Array, "T q"] | None = None

    def initial_state(self, position, increment) -> State:
        """The plant inside, and the counter at zero."""
        return self.plant.initial_state(position, increment), jnp.zeros((), int)

    def step(self, state, control) -> State:
        """The plant inside under u + force."""
        inner, k = state
        return self.plant.step(
            inner, control if self.force is None else control + _row(self.force, k)
        ), k + 1

    def measure(self, state) -> Any:
        """The measurement of the plant inside, plus noise."""
        measurement = self.plant.measure(state[0])
        if self.noise is None:
            return measurement
        flat, shaped = ravel_pytree(measurement)
        return shaped(flat + _row(self.noise, state[1]))


def _row(sequence: Float[Array, "T d"], k: Int[Array, ""]) -> Float[Array, " d"]:
    return sequence[jnp.minimum(k, sequence.shape[0] - 1)]
