"""A machine around any smooth plant: its linearisation is the model, gains and delay are unsure."""

from collections.abc import Sequence
from dataclasses import dataclass

import jax
import jax.numpy as jnp
from jax.flatten_util import ravel_pytree

from jcontour.app.files.machine_file import NOTHING_STATED, StatedFields
from jcontour.app.machines.families import GainsAndDelayMachine
from jcontour.app.machines.from_file import stated_limits, stated_uncertainty
from jcontour.app.machines.linear import USUAL
from jcontour.app.machines.machine import NO_EFFECTS, Fed, Usual
from jcontour.app.machines.uncertainty import IN_PYTHON
from jcontour.linear.plant import LinearPlant, SteadyMotion
from jcontour.plant import Plant

AXES = 2  # of a plant that does not say how many it has


@dataclass(frozen=True)
class PlantMachine(GainsAndDelayMachine):
    """A machine around a plant, measured as the plant says."""

    plant: Plant  # the nominal one

    @property
    def nonsmooth_effects(self) -> str:
        return NO_EFFECTS

    @property
    def usual(self) -> Usual:
        return USUAL._replace(controller="")

    @property
    def mechanics(self) -> Plant:
        return self.plant

    def counted(self, plant: Plant, fed: Fed = "outputs") -> Plant:
        if fed == "state":
            raise ValueError(f"{self.name} is measured as its plant says, not by its state")
        return plant

    def smooth_family(self, fed: Fed = "outputs") -> Sequence[Plant]:
        """The true family: what has no derivative in it is not known."""
        return self.true_family(fed)

    def nominal(self, fed: Fed = "outputs") -> Plant:
        return self.counted(self.plant, fed)

    def description(self) -> dict[str, str]:
        axes = ", ".join(self.axes)
        return {"Machine": f"{self.name}: axes {axes}, dt {1e3 * self.plant.dt:g} ms"}


def axes_of(plant: Plant) -> int:
    """How many axes a plant says it has; two where it says nothing."""
    return int(getattr(plant, "axes", AXES))


def machine_of(plant: Plant, name: str, stated: StatedFields = NOTHING_STATED) -> PlantMachine:
    """Machine of a plant with two axes, or as many as its `axes` says; one input each.

    Args:
        plant: the nominal one.
        name: of the machine.
        stated: what is stated of it; what a limit of the control does is up to the plant.

    Raises:
        MachineError: limits, or an uncertain response, are not of its axes.
    """
    axes = axes_of(plant)
    names = ("X", "Y", "Z")[:axes]
    model = _linearised(plant, axes)
    limits = stated_limits(stated.limits, 1.0, model)
    unsure = stated_uncertainty(stated.uncertainty, model, IN_PYTHON)
    return PlantMachine(name, model, names, stated.control_unit, limits, unsure, plant)


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
