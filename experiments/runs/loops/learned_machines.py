"""Machines as laps learn from them: what is read, their linear models, and noise in every lap.

A gantry's linear models are those at the middle of the part along its beam, without the limits of
its currents. Where its head is on the beam, and what it reads, follows from its motors exactly.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.tree_util import Partial
from jaxtyping import Array, Float

from experiments.designs.design import Design
from experiments.jobs.job import Task
from experiments.machines.count_noise import FARTHEST
from experiments.machines.families import LATE, Member
from experiments.machines.flexible_axis import FlexibleMachine, scaled
from experiments.machines.gantry import GantryMachine, scaled_gantry
from experiments.machines.linear import LinearMachine
from experiments.machines.machine import Machine
from jcontour.controller import Controller
from jcontour.controllers.learning.laps import RunLap, laps_of
from jcontour.motion.references import Reference
from jcontour.plant import Plant
from jcontour.plants.flexible_axis.models import zoh_model
from jcontour.plants.gantry.motor_coordinates import MotorEncoders, motor_model
from jcontour.plants.wrappers.delays import Delayed
from jcontour.plants.wrappers.disturbances import Disturbed
from jcontour.plants.wrappers.encoders import Encoders, FineEncoders, Sensed
from jcontour.sensors import Sensors, motors, row

MotorMeasured = FlexibleMachine | GantryMachine


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

    def laps(self, plant: Callable[[Any], Plant]) -> RunLap:
        """Laps on the plant that each number gives."""
        positions = positions_of(self.machine, self.fed)
        return laps_of(plant, self.controller, self.reference, positions)


def setting(design: Design, job: Task) -> Setting:
    """The design's start on a part.

    Raises:
        ValueError: there is no learning on this kind of machine.
    """
    machine = design.machine
    if not isinstance(machine, LinearMachine | MotorMeasured):
        raise ValueError(
            "plant: learning needs a machine given by A, B, C, flexible axes or a gantry, "
            f"{machine.name} is none of them"
        )
    reference = job.reference(machine.model.dt, design.preview)
    return Setting(machine, design.build(design.start), design.fed, reference)


def positions_of(machine: Machine, fed: Any) -> Callable[[Any], Float[Array, " m"]]:
    """Positions of the axes in a measurement: of the tool, or of the motors where only they are.

    A gantry's motors say where its tool is: nothing bends but its joints.
    """
    if isinstance(machine, FlexibleMachine):
        return motors(len(machine.axes)).positions
    if isinstance(machine, GantryMachine):
        encoders = MotorEncoders(machine.parameters)
        return lambda measurement: machine.parameters.tool(encoders.state(row(measurement))[:3])
    if fed == "state":
        return machine.model.output
    return lambda measurement: measurement


def linear_nominal(one: Setting) -> Plant:
    """Nominal machine: all but a gantry are linear as they are."""
    machine = one.machine
    if isinstance(machine, GantryMachine):
        return _read(machine, _linear(one, machine.members[0]))
    return machine.nominal(one.fed)


def linear_family(one: Setting) -> list[Plant]:
    """Every plant of the family, linear: without dry friction and limits."""
    machine = one.machine
    if isinstance(machine, LinearMachine):
        machine = machine.frictionless
    if not isinstance(machine, MotorMeasured):
        return list(machine.smooth_family(one.fed))
    return [_read(machine, _linear(one, member)) for member in machine.members]


def noisy(one: Setting, seed: int) -> Callable[[Any], Plant]:
    """Linear model behind encoders with noise in place of counts, anew in every lap."""
    machine, steps = one.machine, one.shape[0]
    assert isinstance(machine, LinearMachine | MotorMeasured)
    read = machine.model.axes if isinstance(machine, LinearMachine) else machine.model.inputs
    count = machine.noisy_count
    assert count is not None
    half = count / 2

    def of_lap(lap) -> Plant:
        key = jax.random.fold_in(jax.random.key(seed), lap)
        noise = jax.random.uniform(key, (steps, read), minval=-half, maxval=half)
        if isinstance(machine, MotorMeasured):
            others = jnp.zeros((steps, machine.model.states - read))
            plant = _linear(one, machine.members[0])
            counted = Disturbed(plant, noise=jnp.concatenate([noise, others], axis=1))
            return _read(machine, counted)
        if one.fed == "state":
            return machine.model
        return Disturbed(Encoders(machine.model), noise=noise)

    return of_lap


def read_anew(one: Setting, seed: int) -> Callable[[Plant, Any], Plant]:
    """A plant of the true family in each lap: its encoders' noise is another in every one.

    All plants have the same noise in a lap. Counts are no noise: they stay.
    """
    machine, steps = one.machine, one.shape[0]
    if not isinstance(machine, LinearMachine) or not machine.noisy or one.fed == "state":
        return lambda plant, lap: plant
    deviation = jnp.broadcast_to(jnp.asarray(machine.encoder_noise), (1, machine.model.axes))

    def of_lap(plant: Plant, lap) -> Plant:
        key = jax.random.fold_in(jax.random.key(seed), lap)
        drawn = jax.random.normal(key, (steps, machine.model.axes))
        noise = deviation * jnp.clip(drawn, -FARTHEST, FARTHEST)
        return eqx.tree_at(lambda counted: counted.plant.noise, plant, noise)

    return of_lap


def _linear(one: Setting, member: Member) -> Plant:
    """Linear model of a member, late as it is."""
    machine = one.machine
    dt = machine.model.dt
    if isinstance(machine, GantryMachine):
        parameters = scaled_gantry(machine.parameters, member.stiffness, member.mass)
        x = one.reference.position[: one.reference.steps, 0]
        model = motor_model(parameters, (jnp.min(x) + jnp.max(x)) / 2, dt)
    else:
        assert isinstance(machine, FlexibleMachine)
        model = zoh_model(scaled(machine.parameters, member.stiffness, member.mass), dt)
    return Delayed(model, jnp.asarray(member.late), LATE, model.inputs)


def _read(machine: MotorMeasured, plant: Plant) -> Plant:
    """The plant behind its motors' encoders."""
    fine = FineEncoders(plant, Sensors(range(machine.model.inputs)))
    return Sensed(fine, Partial(row)) if isinstance(machine, GantryMachine) else fine
