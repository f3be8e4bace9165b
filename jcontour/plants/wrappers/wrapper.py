"""What stands between a controller and an ideal machine: sensors, delays, saturation, disturbances. Each wraps any plant."""

import abc
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float, Int

from jcontour.linear.plant import is_concrete
from jcontour.plant import Plant, State
from jcontour.sensors import Sensors


class _Wrapper(Plant):
    """A plant that is the one inside until a method says otherwise."""

    plant: Plant

    @property
    def dt(self) -> float:
        """Sample period of the plant inside [s]."""
        return self.plant.dt

    @property
    def side_by_side(self) -> bool:
        """As the plant inside."""
        return self.plant.side_by_side

    def initial_state(self, position, increment) -> State:
        """That of the plant inside."""
        return self.plant.initial_state(position, increment)

    def step(self, state, control) -> State:
        """That of the plant inside."""
        return self.plant.step(state, control)

    def inner(self, state) -> State:
        """State of the plant inside."""
        return state

    def output(self, state) -> Float[Array, " m"]:
        """That of the plant inside."""
        return self.plant.output(self.inner(state))

    def measure(self, state) -> Any:
        """That of the plant inside."""
        return self.plant.measure(self.inner(state))


class _Remembering(_Wrapper):
    """A wrapper with a state of its own: (that of the plant inside, its own)."""

    def inner(self, state) -> State:
        """The first of the two."""
        return state[0]


def unwrapped(plant: Plant, state: State) -> tuple[Plant, State]:
    """The machine itself, without its wrappers, and its state."""
    while isinstance(plant, _Wrapper):
        plant, state = plant.plant, plant.inner(state)
    return plant, state


class Encoders(_Wrapper):
    """Only the outputs are measured, without quantisation: the smooth twin of `Quantised`."""

    def measure(self, state) -> Float[Array, " m"]:
        """y [m]."""
        return self.plant.output(state)


class Sensed(_Wrapper):
    """What `sensors` make of the measurement: a traceable function, such as the motor encoders of a machine whose state is measured."""

    sensors: Callable[[Any], Array]

    def measure(self, state) -> Array:
        """sensors(measurement)."""
        return self.sensors(self.plant.measure(state))


class Quantised(_Wrapper):
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


class _SpeedsByDifference(_Remembering):
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
        return self.plant.initial_state(position, increment), self._read(self.plant.initial_state(position - increment, increment))

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


class LateSensors(_Remembering):
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
        before = [self.plant.initial_state(position - k * increment, increment) for k in range(1, self.depth + 1)]
        return self.plant.initial_state(position, increment), jax.tree.map(lambda *m: jnp.stack(m), *map(self.plant.measure, before))

    def step(self, state, control) -> State:
        """The plant inside; the line moves on."""
        return self.plant.step(state[0], control), jax.tree.map(lambda line: line[:-1], self._line(state))

    def measure(self, state) -> Any:
        """That of the plant inside, `samples` ago."""
        return jax.tree.map(lambda line: line[self.samples], self._line(state))

    def _line(self, state: State) -> Any:
        inner, line = state
        return jax.tree.map(lambda now, before: jnp.concatenate([now[None], before]), self.plant.measure(inner), line)


class Saturated(_Wrapper):
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


class Delayed(_Remembering):
    """The control acts `samples` late, unknown to the controller, which is fed the state of the undelayed part.

    The delay is a line of fixed `depth` with a traced tap, so that plants of delay 0..depth batch. The line starts at zero.

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
        return self.plant.initial_state(position, increment), jnp.zeros((self.depth, self.inputs), position.dtype)

    def step(self, state, control) -> State:
        """The plant inside under u(k - samples)."""
        inner, line = state
        line = jnp.concatenate([control[None], line])
        return self.plant.step(inner, line[self.samples]), line[:-1]


class Disturbed(_Remembering):
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
        return self.plant.step(inner, control if self.force is None else control + _row(self.force, k)), k + 1

    def measure(self, state) -> Any:
        """The measurement of the plant inside, plus noise."""
        measurement = self.plant.measure(state[0])
        if self.noise is None:
            return measurement
        flat, shaped = ravel_pytree(measurement)
        return shaped(flat + _row(self.noise, state[1]))


def _counted(values: Array, resolution: float) -> Array:
    return resolution * jnp.round(values / resolution)


def _check_resolution(resolution: float) -> None:
    if not resolution > 0:
        raise ValueError(f"resolution: needs to be positive, received {resolution}")


def _check_line(samples: Int[Array, ""], depth: int) -> None:
    if depth < 1:
        raise ValueError(f"depth: the delay line needs at least one place, received {depth}")
    if is_concrete(samples) and not np.all((0 <= np.asarray(samples)) & (np.asarray(samples) <= depth)):
        raise ValueError(f"samples: needs a delay from 0 to the depth {depth}, received {samples}")


def _row(sequence: Float[Array, "T d"], k: Int[Array, ""]) -> Float[Array, " d"]:
    return sequence[jnp.minimum(k, sequence.shape[0] - 1)]
