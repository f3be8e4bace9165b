"""Delay lines in front of a plant and behind it."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Int

from jcontour.plant import State
from jcontour.plants.wrappers.wrapper import Remembering
from jcontour.tracing import is_concrete


class LateSensors(Remembering):
    """The measurement is `samples` old: bus and filter times of the sensors. What was before the start is steady motion.

    The line has a fixed `depth` and a traced tap, so that plants of delay 0..depth batch.

    Raises:
        ValueError: the depth is below one, or the delay is not between zero and the depth.
    """

    samples: Int[Array, ""]
    depth: int = eqx.field(static=True)

    def __check_init__(self):
        _check_line(self.samples, self.depth)

    def initial_state(self, position, increment) -> State:
        """The plant inside, and what it measured at the samples before, the last one first."""
        before = [
            self.plant.initial_state(position - k * increment, increment)
            for k in range(1, self.depth + 1)
        ]
        return self.plant.initial_state(position, increment), jax.tree.map(
            lambda *m: jnp.stack(m), *map(self.plant.measure, before)
        )

    def step(self, state, control) -> State:
        """The plant inside; the line moves on."""
        return self.plant.step(state[0], control), jax.tree.map(
            lambda line: line[:-1], self._line(state)
        )

    def measure(self, state) -> Any:
        """That of the plant inside, `samples` ago."""
        return jax.tree.map(lambda line: line[self.samples], self._line(state))

    def _line(self, state: State) -> Any:
        inner, line = state
        return jax.tree.map(
            lambda now, before: jnp.concatenate([now[None], before]),
            self.plant.measure(inner),
            line,
        )


class Delayed(Remembering):
    """The control acts `samples` late, unknown to the controller, which is fed the state of the undelayed part.

    The delay is a line of fixed `depth` with a traced tap, so that plants of delay 0..depth batch.
    The line starts at zero.

    Raises:
        ValueError: the depth is below one, or the delay is not between zero and the depth.
    """

    samples: Int[Array, ""]
    depth: int = eqx.field(static=True)
    inputs: int = eqx.field(static=True)

    def __check_init__(self):
        _check_line(self.samples, self.depth)

    def initial_state(self, position, increment) -> State:
        """The plant inside, and an empty line."""
        return self.plant.initial_state(position, increment), jnp.zeros(
            (self.depth, self.inputs), position.dtype
        )

    def step(self, state, control) -> State:
        """The plant inside under u(k - samples)."""
        inner, line = state
        line = jnp.concatenate([control[None], line])
        return self.plant.step(inner, line[self.samples]), line[:-1]


def _check_line(samples: Int[Array, ""], depth: int) -> None:
    if depth < 1:
        raise ValueError(f"depth: the delay line needs at least one place, received {depth}")
    if is_concrete(samples) and not np.all(
        (0 <= np.asarray(samples)) & (np.asarray(samples) <= depth)
    ):
        raise ValueError(f"samples: needs a delay from 0 to the depth {depth}, received {samples}")
