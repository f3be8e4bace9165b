"""What a machine is to the rest of the library: a sampled state with an input, a tool point and sensors."""

import abc
from typing import Any

import equinox as eqx
from jaxtyping import Array, Float

State = Any  # any pytree of arrays


class Plant(eqx.Module):
    """A sampled machine in SI units; `dt` [s] is the sample period and a control is held over one sample."""

    dt: eqx.AbstractVar[float]

    @property
    def side_by_side(self) -> bool:
        """Whether a family of it is fastest vectorised on a CPU too: of few numbers in many substeps, not of large matrices."""
        return False

    @abc.abstractmethod
    def initial_state(self, position: Float[Array, " m"], increment: Float[Array, " m"]) -> State:
        """State whose tool passes through `position` [m] at a steady `increment` [m per sample]; a zero increment is rest."""

    @abc.abstractmethod
    def step(self, state: State, control: Float[Array, " p"]) -> State:
        """State one sample later, with `control` held in between."""

    @abc.abstractmethod
    def output(self, state: State) -> Float[Array, " m"]:
        """The tool point [m]: what the part feels."""

    def measure(self, state: State) -> Any:
        """What the sensors give the controller; the whole state unless the plant says otherwise."""
        return state
