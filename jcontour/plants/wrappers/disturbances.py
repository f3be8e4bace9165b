"""Sequences that act on a plant from outside: forces and measurement noise."""

from typing import Any

import jax.numpy as jnp
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float, Int

from jcontour.plant import State
from jcontour.wrapper import Remembering


class Disturbed(Remembering):
    """A plant with sequences from outside: `force` adds to the control, `noise` to the measurement.

    The noise has one column for each number of the measurement, all its leaves in one row. The
    state carries a counter; beyond the end of a sequence its last row holds.

    >>> from jcontour.plants.bridgeport import bridgeport
    >>> noisy = Disturbed(bridgeport(), noise=1e-6 * jnp.ones((1, 8)))
    >>> noisy.measure(noisy.initial_state(jnp.zeros(2), jnp.zeros(2))).tolist()[:2]
    [1e-06, 1e-06]
    """

    force: Float[Array, "T p"] | None = None
    noise: Float[Array, "S q"] | None = None

    def initial_state(self, position, increment) -> State:
        """State of the wrapped plant, and the counter at zero."""
        return self.plant.initial_state(position, increment), jnp.zeros((), int)

    def step(self, state, control) -> State:
        """Step of the wrapped plant under u + force; the counter goes on."""
        inner, k = state
        if self.force is not None:
            control = control + _row(self.force, k)
        return self.plant.step(inner, control), k + 1

    def measure(self, state) -> Any:
        """Measurement of the wrapped plant, plus noise."""
        measurement = self.plant.measure(state[0])
        if self.noise is None:
            return measurement
        flat, shaped = ravel_pytree(measurement)
        return shaped(flat + _row(self.noise, state[1]))


def _row(sequence: Float[Array, "T d"], k: Int[Array, ""]) -> Float[Array, " d"]:
    return sequence[jnp.minimum(k, sequence.shape[0] - 1)]
