"""Limits of the actuators."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jcontour._tracing import is_concrete
from jcontour.plant import State
from jcontour.wrapper import Wrapper


class Saturated(Wrapper):
    """A plant whose control is limited to +-limit (p,) before it acts.

    >>> from jcontour.plants.bridgeport import bridgeport
    >>> table = Saturated(bridgeport(), jnp.array([10.0, 10.0]))
    >>> rest = table.initial_state(jnp.zeros(2), jnp.zeros(2))
    >>> pushed, limit = (table.step(rest, jnp.array([u, 0.0])) for u in (50.0, 10.0))
    >>> bool((pushed == limit).all())
    True

    Raises:
        ValueError: a limit is negative or not a number.
    """

    limit: Float[Array, " p"] = eqx.field(converter=jnp.asarray)

    def __check_init__(self):
        if is_concrete(self.limit) and not np.all(np.asarray(self.limit) >= 0):
            raise ValueError(f"limit: needs to be at least zero, received {self.limit}")

    def step(self, state, control) -> State:
        """Step of the wrapped plant under clip(u, -limit, limit)."""
        return self.plant.step(state, jnp.clip(control, -self.limit, self.limit))
