"""Limits of the actuators."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jcontour.plant import State
from jcontour.plants.wrappers.wrapper import Wrapper
from jcontour.tracing import is_concrete


class Saturated(Wrapper):
    """The control is limited to +-limit (p,) before it acts.

    Raises:
        ValueError: a limit is negative or not a number.
    """

    limit: Float[Array, " p"]

    def __check_init__(self):
        if is_concrete(self.limit) and not np.all(np.asarray(self.limit) >= 0):
            raise ValueError(f"limit: needs to be at least zero, received {self.limit}")

    def step(self, state, control) -> State:
        """The plant inside under clip(u, -limit, limit)."""
        return self.plant.step(state, jnp.clip(control, -self.limit, self.limit))
