"""A controller on a part as laps learn from it, and the noise of every lap."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
from jaxtyping import Array, Float

from jcontour.app.designs.design import Design
from jcontour.app.jobs.job import Task
from jcontour.app.machines.machine import Machine
from jcontour.controller import Controller
from jcontour.controllers.learning.laps import RunLap, laps_of
from jcontour.motion.references import Reference
from jcontour.plant import Plant


class Setting(NamedTuple):
    """A controller on a part, and how the machine is learned from.

    Attributes:
        machine: what is run.
        controller: with the weights of the start.
        fed: what the controller is fed.
        reference: of one lap.
    """

    machine: Machine
    controller: Controller
    fed: Any
    reference: Reference

    @property
    def shape(self) -> tuple[int, int]:
        """(T, m) of a correction."""
        return self.reference.steps, self.reference.position.shape[-1]

    @property
    def path(self) -> Float[Array, "T m"]:
        """Positions of the reference [m]."""
        return self.reference.position[: self.reference.steps]

    def laps(self, plant: Callable[[Any], Plant]) -> RunLap:
        """Laps on the plant that each number gives."""
        positions = self.machine.positions(self.fed)
        return laps_of(plant, self.controller, self.reference, positions)


def setting(design: Design, job: Task) -> Setting:
    """The design's start on a part.

    Raises:
        ValueError: there is no learning on this kind of machine.
    """
    machine = design.machine
    machine.positions(design.fed)  # raises where laps have nothing to read
    reference = job.reference(machine.model.dt, design.preview)
    return Setting(machine, design.build(design.start), design.fed, reference)


def linear_nominal(one: Setting) -> Plant:
    """Linear nominal machine along the part."""
    return one.machine.linear_nominal(one.fed, one.path)


def noisy(one: Setting, seed: int) -> Callable[[Any], Plant]:
    """Linear model behind encoders with noise in place of counts, anew in every lap."""

    def of_lap(lap) -> Plant:
        key = jax.random.fold_in(jax.random.key(seed), lap)
        return one.machine.noisy_nominal(key, one.fed, one.path)

    return of_lap


def read_anew(one: Setting, seed: int) -> Callable[[Plant, Any], Plant]:
    """A plant of the true family in each lap: its encoders' noise is another in every one."""

    def of_lap(plant: Plant, lap) -> Plant:
        key = jax.random.fold_in(jax.random.key(seed), lap)
        return one.machine.with_noise(plant, key, one.shape[0], one.fed)

    return of_lap
