"""What stands between a controller and an ideal machine: sensors, delays, saturation, disturbances. Each wraps any plant."""

from typing import Any

from jaxtyping import Array, Float

from jcontour.plant import Plant, State


class Wrapper(Plant):
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


class Remembering(Wrapper):
    """A wrapper with a state of its own: (that of the plant inside, its own)."""

    def inner(self, state) -> State:
        """The first of the two."""
        return state[0]


def unwrapped(plant: Plant, state: State) -> tuple[Plant, State]:
    """The machine itself, without its wrappers, and its state."""
    while isinstance(plant, Wrapper):
        plant, state = plant.plant, plant.inner(state)
    return plant, state
