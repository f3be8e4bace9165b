"""Sensors of positions: encoders that read, count and difference."""

import abc
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float, PyTree

from jcontour.plant import Remembering, State, Wrapper
from jcontour.sensors import Sensors


def fixed(resolution: ArrayLike | tuple[float, ...]) -> float | tuple[float, ...]:
    """As the field of a plant that is compiled once for each."""
    found = np.asarray(resolution, float)
    return float(found) if found.ndim == 0 else tuple(found.tolist())


class Encoders(Wrapper):
    """A plant measured by its outputs, without counts: the smooth twin of `Quantised`."""

    def measure(self, state) -> Float[Array, " m"]:
        return self.plant.output(state)


class Sensed(Wrapper):
    """A plant measured through `sensors`, a traceable function of its measurement.

    An example are the motor encoders of a machine whose whole state is measured.
    """

    sensors: Callable[[Any], PyTree[Array]]

    def measure(self, state) -> PyTree[Array]:
        return self.sensors(self.plant.measure(state))


class Quantised(Wrapper):
    """A plant whose measurements are whole counts of `resolution`.

    It is not smooth: tune on the wrapped plant.

    Args:
        plant: what is measured.
        resolution: length of a count, one number or one for each number of the measurement.

    Raises:
        ValueError: a resolution is not positive.
    """

    resolution: float | tuple[float, ...] = eqx.field(static=True, converter=fixed)

    def __check_init__(self):
        _check_resolution(self.resolution)

    def measure(self, state) -> Array:
        """resolution * round(measurement / resolution)."""
        return _counted(self.plant.measure(state), self.resolution)


class _SpeedsByDifference(Remembering):
    """A plant measured by its positions and their differences.

        (q, v),   v(k) = (q(k) - q(k-1)) / dt

    Args:
        plant: the machine whose positions are measured.
        sensors: where the positions stand in its measurement.
    """

    sensors: Sensors

    @abc.abstractmethod
    def _read(self, inner: State) -> Float[Array, " m"]:
        """Positions q [m] as the encoders show them."""

    def initial_state(self, position, increment) -> State:
        """State of the wrapped plant, and the reading one sample before."""
        before = self.plant.initial_state(position - increment, increment)
        return self.plant.initial_state(position, increment), self._read(before)

    def step(self, state, control) -> State:
        """Step of the wrapped plant; the present reading is kept for the next difference."""
        return self.plant.step(state[0], control), self._read(state[0])

    def measure(self, state) -> tuple[Float[Array, " m"], Float[Array, " m"]]:
        """Positions [m] and speeds [m/s]: (q, v)."""
        inner, before = state
        now = self._read(inner)
        return now, (now - before) / self.dt


class FineEncoders(_SpeedsByDifference):
    """Encoders without counts: the smooth twin of `CountingEncoders`, with the same lag."""

    def _read(self, inner: State) -> Float[Array, " m"]:
        return self.sensors.positions(self.plant.measure(inner))


class CountingEncoders(_SpeedsByDifference):
    """Encoders that count, with speeds by the difference of two readings, as a drive has them.

        q(k) = resolution * round(x(k) / resolution)
    It is not smooth. Noise of the wrapped plant is added before the rounding.

    >>> from jcontour.plants.linear_machines import bridgeport
    >>> counting = CountingEncoders(bridgeport(), Sensors((2, 7)), resolution=1e-6)
    >>> start = counting.initial_state(jnp.array([2.6e-6, 0.0]), jnp.zeros(2))
    >>> position, speed = counting.measure(start)
    >>> [round(count) for count in (position / 1e-6).tolist()], speed.tolist()
    ([3, 0], [0.0, 0.0])

    Args:
        resolution: [m] per count, one number or one for each position.

    Raises:
        ValueError: a resolution is not positive.
    """

    resolution: float | tuple[float, ...] = eqx.field(static=True, converter=fixed)

    def __check_init__(self):
        _check_resolution(self.resolution)

    def _read(self, inner: State) -> Float[Array, " m"]:
        return _counted(self.sensors.positions(self.plant.measure(inner)), self.resolution)


def _counted(values: Array, resolution: float | tuple[float, ...]) -> Array:
    count = resolution if isinstance(resolution, float) else jnp.asarray(resolution, values.dtype)
    return count * jnp.round(values / count)


def _check_resolution(resolution: float | tuple[float, ...]) -> None:
    if not (np.asarray(resolution) > 0).all():
        raise ValueError(f"resolution: needs to be positive, received {resolution}")
