"""A machine around any smooth plant: the plant is the whole family, its linearisation the model."""

from collections.abc import Sequence
from dataclasses import dataclass

import jax
import jax.numpy as jnp
from jax.flatten_util import ravel_pytree

from experiments.machines.linear import USUAL
from experiments.machines.machine import NO_EFFECTS, Fed, Machine, MachineLimits, Usual
from jcontour.linear.plant import LinearPlant, SteadyMotion
from jcontour.plant import Plant

AXES = 2  # of a plant that does not say how many it has


@dataclass(frozen=True)
class PlantMachine(Machine):
    """A machine whose family is one plant, measured as the plant says."""

    plant: Plant

    @property
    def nonsmooth_effects(self) -> str:
        """Nothing: the plant is taken as it is."""
        return NO_EFFECTS

    @property
    def usual(self) -> Usual:
        """Contouring on short parts; the controller is always given."""
        return USUAL._replace(controller="")

    @property
    def family_names(self) -> list[str]:
        """The plant alone."""
        return ["nominal"]

    @property
    def unknown_delay(self) -> int:
        """None."""
        return 0

    def smooth_family(self, fed: Fed = "outputs") -> Sequence[Plant]:
        """The plant, for what it measures itself."""
        if fed == "state":
            raise ValueError(f"{self.name} is measured as its plant says, not by its state")
        return [self.plant]

    def true_family(self, fed: Fed = "outputs") -> Sequence[Plant]:
        """The same."""
        return self.smooth_family(fed)

    def nominal(self, fed: Fed = "outputs") -> Plant:
        """The plant."""
        return self.smooth_family(fed)[0]

    def description(self) -> dict[str, str]:
        """Axes and sample period."""
        axes = ", ".join(self.axes)
        return {"Machine": f"{self.name}: axes {axes}, dt {1e3 * self.plant.dt:g} ms"}


def axes_of(plant: Plant) -> int:
    """How many axes a plant says it has; two where it says nothing."""
    return int(getattr(plant, "axes", AXES))


def machine_of(plant: Plant, name: str) -> PlantMachine:
    """Machine of a plant with two axes, or as many as its `axes` says; one input each."""
    axes = axes_of(plant)
    names = ("X", "Y", "Z")[:axes]
    return PlantMachine(
        name, _linearised(plant, axes), names, "control unit", MachineLimits(), plant
    )


def _linearised(plant: Plant, axes: int) -> LinearPlant:
    """Linear model around rest in the origin."""
    origin = jnp.zeros(axes)
    rest, unravelled = ravel_pytree(plant.initial_state(origin, origin))

    def step(state, control):
        return ravel_pytree(plant.step(unravelled(state), control))[0]

    def start(position, increment):
        return ravel_pytree(plant.initial_state(position, increment))[0]

    @jax.jit
    def matrices():
        C = jax.jacfwd(lambda state: plant.output(unravelled(state)))(rest)
        motion = SteadyMotion(*jax.jacfwd(start, (0, 1))(origin, origin))
        return *jax.jacfwd(step, (0, 1))(rest, origin), C, motion

    A, B, C, motion = matrices()
    return LinearPlant(A, B, C, plant.dt, motion=motion)
