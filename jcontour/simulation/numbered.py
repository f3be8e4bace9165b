"""Equal plants without arrays of their own, told apart by a number."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from jcontour.plant import Plant, State


class Numbered(Plant):
    """A plant and a number that nothing reads.

    All fields of a plant may be static. Then a family of equal ones has no array whose axis 0
    counts them: their numbers do.

    >>> from jcontour.linear.plant import LinearPlant
    >>> drive = LinearPlant([[1.0]], [[1e-3]], [[1.0]], dt=1e-3)
    >>> Numbered(drive, 2).step(jnp.ones(1), jnp.ones(1)).tolist()
    [1.001]

    Args:
        plant: the machine.
        number: of the member, or (members,) of a family.
    """

    plant: Plant
    number: Int[Array, ""] | Int[Array, " members"] = eqx.field(converter=jnp.asarray)

    @property
    def dt(self) -> float:  # pyright: ignore[reportIncompatibleVariableOverride]
        """Sample period of the plant [s]."""
        return self.plant.dt

    @property
    def side_by_side(self) -> bool:
        """That of the plant."""
        return self.plant.side_by_side

    def initial_state(self, position, increment) -> State:
        """State of the plant in steady motion."""
        return self.plant.initial_state(position, increment)

    def holding_control(self, position) -> Float[Array, " p"] | Float[Array, ""]:
        """That of the plant."""
        return self.plant.holding_control(position)

    def step(self, state, control) -> State:
        """State of the plant one sample later."""
        return self.plant.step(state, control)

    def output(self, state) -> Float[Array, " m"]:
        """Tool point of the plant [m]."""
        return self.plant.output(state)

    def measure(self, state) -> Any:
        """Measurement of the plant."""
        return self.plant.measure(state)
