"""A plant around another plant: a sensor, a delay, a limit or a disturbance."""

from typing import Any

from jaxtyping import Array, Float

from jcontour.plant import Plant, State


class Wrapper(Plant):
    """A plant that does what the wrapped plant does, but for the methods that a subclass replaces.

    It implements all of `Plant`, so that each wrapper states its one difference and nothing else.
    This is the only place of the library where subclasses replace implemented methods.
    """

    plant: Plant

    @property
    def dt(self) -> float:  # pyright: ignore[reportIncompatibleVariableOverride]
        """Sample period of the wrapped plant [s]."""
        return self.plant.dt

    @property
    def side_by_side(self) -> bool:
        """True if `vmap` over the wrapped plant is faster than a loop on a CPU as well."""
        return self.plant.side_by_side

    @property
    def alike_everywhere(self) -> bool | tuple[bool, ...]:
        """Axes along which the wrapped plant is the same at any place."""
        return self.plant.alike_everywhere

    def initial_state(self, position, increment) -> State:
        """State of the wrapped plant in steady motion."""
        return self.plant.initial_state(position, increment)

    def holding_control(self, position) -> Float[Array, " p"] | Float[Array, ""]:
        """That of the wrapped plant."""
        return self.plant.holding_control(position)

    def step(self, state, control) -> State:
        """State of the wrapped plant one sample later."""
        return self.plant.step(state, control)

    def inner(self, state) -> State:
        """State of the wrapped plant."""
        return state

    def output(self, state) -> Float[Array, " m"]:
        """Tool point of the wrapped plant [m]."""
        return self.plant.output(self.inner(state))

    def measure(self, state) -> Any:
        """Measurement of the wrapped plant."""
        return self.plant.measure(self.inner(state))


class Remembering(Wrapper):
    """A wrapper with its own state beside the plant's: (state of the wrapped plant, own state).

    Subclasses replace `initial_state` and `step`; output and measurement work through `inner`.
    """

    def inner(self, state) -> State:
        """First entry of the pair."""
        return state[0]
