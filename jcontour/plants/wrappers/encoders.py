"""Sensors of positions: encoders that read, count and difference."""

import abc
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from jcontour.plant import State
from jcontour.plants.wrappers.wrapper import Remembering, Wrapper
from jcontour.sensors import Sensors


class Encoders(Wrapper):
    """Only the outputs are measured, without quantisation: the smooth twin of `Quantised`."""

    def measure(self, state) -> Float[Array, " m"]:
        """y [m]."""
        return self.plant.output(state)


class Sensed(Wrapper):
    """What `sensors` make of the measurement: a traceable function, such as the motor encoders of a machine whose state is measured."""

    sensors: Callable[[Any], Array]

    def measure(self, state) -> Array:
        """sensors(measurement)."""
        return self.sensors(self.plant.measure(state))


class Quantised(Wrapper):
    """Measurements are rounded to whole counts of `resolution`. Not smooth: tune on the plant inside.

    Raises:
        ValueError: the resolution is not positive.
    """

    resolution: float = eqx.field(static=True)

    def __check_init__(self):
        _check_resolution(self.resolution)

    def measure(self, state) -> Array:
        """resolution * round(measurement / resolution)."""
        return _counted(self.plant.measure(state), self.resolution)


class _SpeedsByDifference(Remembering):
    """Positions as they are read, and as speeds the difference of two readings: (q, v), v(k) = (q(k) - q(k-1)) / dt.

    Args:
        plant: whose positions are measured.
        sensors: where they stand in its measurement.
    """

    sensors: Sensors

    @abc.abstractmethod
    def _read(self, inner: State) -> Float[Array, " m"]:
        """q."""

    def initial_state(self, position, increment) -> State:
        """The plant inside, and the reading one sample before."""
        return self.plant.initial_state(position, increment), self._read(
            self.plant.initial_state(position - increment, increment)
        )

    def step(self, state, control) -> State:
        """The plant inside; the reading of now becomes that before."""
        return self.plant.step(state[0], control), self._read(state[0])

    def measure(self, state) -> tuple[Array, Array]:
        """(q, v)."""
        inner, before = state
        now = self._read(inner)
        return now, (now - before) / self.dt


class FineEncoders(_SpeedsByDifference):
    """Encoders of a resolution too fine to matter: the smooth twin of `CountingEncoders`, as late as they are."""

    def _read(self, inner: State) -> Float[Array, " m"]:
        return self.sensors.positions(self.plant.measure(inner))


class CountingEncoders(_SpeedsByDifference):
    """Positions in whole counts of `resolution`, and as speeds the difference of two readings, as a drive has them. Not smooth.

        q(k) = resolution * round(x(k) / resolution)
    Noise of the plant inside is there before the rounding.

    Args:
        resolution: [m] per count.

    Raises:
        ValueError: the resolution is not positive.
    """

    resolution: float = eqx.field(static=True)

    def __check_init__(self):
        _check_resolution(self.resolution)

    def _read(self, inner: State) -> Float[Array, " m"]:
        return _counted(self.sensors.positions(self.plant.measure(inner)), self.resolution)


def _counted(values: Array, resolution: float) -> Array:
    return resolution * jnp.round(values / resolution)


def _check_resolution(resolution: float) -> None:
    if not resolution > 0:
        raise ValueError(f"resolution: needs to be positive, received {resolution}")
