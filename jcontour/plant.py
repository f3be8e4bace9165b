"""The contract of a machine: a sampled state with an input, a tool point and sensors.

A wrapper is a plant around another plant: a sensor, a delay, a limit or a disturbance.
"""

import abc
from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

State = Any  # any pytree of arrays


class Plant(eqx.Module):
    """A sampled machine in SI units.

    `dt` [s] is the sample period; a control is held over one sample.
    """

    dt: eqx.AbstractVar[float]

    @property
    def side_by_side(self) -> bool:
        """True if `vmap` over a family of plants is faster than a loop on a CPU as well.

        This holds for small states with many substeps, not for large matrices.
        """
        return False

    @property
    def alike_everywhere(self) -> bool | tuple[bool, ...]:
        """Axes along which the machine is the same at any place, one answer for all or for each.

        A shift of a run along them changes no error. A plant whose physics depends on the place
        says so.
        """
        return True

    @abc.abstractmethod
    def initial_state(self, position: Float[Array, " m"], increment: Float[Array, " m"]) -> State:
        """State whose tool passes `position` [m] at a steady `increment` [m per sample].

        A zero increment is rest: `holding_control` keeps that state for ever.
        """

    def holding_control(
        self, position: Float[Array, " m"]
    ) -> Float[Array, " p"] | Float[Array, ""]:
        """Control that holds the tool at rest at `position` [m].

        Zero unless the plant says otherwise: drives that take a force or a speed need none.
        """
        return jnp.zeros((), position.dtype)

    @abc.abstractmethod
    def step(self, state: State, control: Float[Array, " p"]) -> State:
        """State one sample later, with `control` held in between."""

    @abc.abstractmethod
    def output(self, state: State) -> Float[Array, " m"]:
        """Tool point [m], which the part feels."""

    def measure(self, state: State) -> Any:
        """Measurement for the controller; the whole state unless the plant says otherwise."""
        return state


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

    @property
    def force_terms(self) -> dict[str, Array]:
        """Numbers of a force that the wrapper adds, by their names in exported code."""
        return {}

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
