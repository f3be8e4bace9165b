"""Uncertainty of a machine, member by member.

Stiffness, masses and the delay of the drives are not known exactly.
"""

import abc
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING, ClassVar, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jcontour.app.machines.machine import Fed, Machine
from jcontour.app.machines.uncertainty import (
    LATE,
    GainMember,
    Uncertainty,
    assumed,
    family_members,
    random_members,
    rounding_noise,
    with_corners,
)
from jcontour.linear.plant import LinearPlant
from jcontour.plant import Plant
from jcontour.plants.actuation import Delayed, Disturbed, Gained, PartlyDelayed
from jcontour.plants.encoders import CountingEncoders, FineEncoders
from jcontour.sensors import Sensors, motors

if TYPE_CHECKING:
    from jcontour.analysis.uncertain_loops import ResponseUncertainty


def late(plant: Plant, samples: float, most: int, inputs: int) -> Plant:
    """The plant with its control late by whole samples, or by parts of one as well."""
    line = Delayed if isinstance(samples, int) else PartlyDelayed
    return line(plant, jnp.asarray(samples), most, inputs)


@dataclass(frozen=True)
class GainsAndDelayMachine(Machine):
    """Machine whose input gains and delay are uncertain."""

    uncertainty: Uncertainty  # of both, and of the response

    @property
    @abc.abstractmethod
    def mechanics(self) -> Plant:
        """The nominal plant, with dry friction."""

    @abc.abstractmethod
    def counted(self, plant: Plant, fed: Fed = "outputs") -> Plant:
        """A plant of the family behind its sensors, or its state measured."""

    @property
    def remarks(self) -> list[str]:
        gain, delay, _, statement = self.uncertainty
        return [assumed(self.name, gain, delay, statement)] if statement else []

    @property
    def response_uncertainty(self) -> "ResponseUncertainty | None":
        return self.uncertainty.response

    @property
    def unknown_delay(self) -> int:
        return self.uncertainty.delay

    @property
    def members(self) -> list[GainMember]:
        return family_members(self.model.inputs, self.uncertainty)

    def drawn(self, count: int, seed: int) -> list[GainMember]:
        return random_members(count, seed, self.model.inputs, self.uncertainty)

    def true_plant(self, member: GainMember, fed: Fed = "outputs") -> Plant:
        return self.counted(self.member(member), fed)

    def rubbed(self, gains: np.ndarray) -> Plant:
        """The nominal plant, with the dry friction of a member with these gains."""
        return self.mechanics

    def member(self, one: GainMember) -> Plant:
        """The machine with other gains behind a delay line, its state measured."""
        nominal, longest = self.rubbed(one.gains), max(self.unknown_delay, 1)
        plant = late(nominal, one.late, longest, self.model.inputs)
        return Gained(plant, jnp.asarray(one.gains))


class Member(NamedTuple):
    """Name, factors on stiffness and on masses, samples that the control is late."""

    name: str
    stiffness: float
    mass: float
    late: float


def members(stiffness: float, mass: float) -> list[Member]:
    """Nominal machine, corners of these relative uncertainties, and the late machine."""
    corners = [(1 + a * stiffness, 1 + b * mass) for a, b in product((1, -1), repeat=2)]
    off = [Member(f"stiffness x {k:g}, masses x {m:g}", k, m, 0) for k, m in corners]
    return [Member("nominal", 1.0, 1.0, 0), *off, Member(f"{LATE} sample late", 1.0, 1.0, LATE)]


@dataclass(frozen=True)
class MotorMeasuredMachine(Machine):
    """Machine whose motors are measured; stiffness, masses and delay are uncertain."""

    stiffness_known_to: ClassVar[float] = 0.2
    mass_known_to: ClassVar[float] = 0.2

    @property
    def sensed(self) -> tuple[str, ...]:
        return ("m",) * self.model.inputs + ("m/s",) * self.model.inputs

    @abc.abstractmethod
    def _model(self, member: Member, path: Float[Array, "T m"]) -> LinearPlant:
        """Linear model of a member along a path [m], its delay left out."""

    @abc.abstractmethod
    def driven(self, member: Member, smooth: bool) -> Plant:
        """A member behind its drives: with stick and slip, or a smooth twin of these."""

    def read(self, encoders: Plant) -> Plant:
        """A plant behind encoders as controllers read it."""
        return encoders

    def smooth_family(self, fed: Fed = "outputs") -> Sequence[Plant]:
        """Smooth twins, their encoders read with the noise that counts make.

        Dry friction turns within a millimetre per second. Without noise a loop that rings as soon
        as something excites it would pass for a good one. Speeds are made of the positions.
        """
        self.check_fed(fed)
        assert self.resolution is not None
        sensors = motors(self.model.inputs)
        positions = rounding_noise(self.model.inputs, self.resolution)
        noise = jnp.concatenate([positions, jnp.zeros_like(positions)], axis=1)
        plants = [self.driven(one, smooth=True) for one in self.members]
        return [self.read(FineEncoders(Disturbed(one, noise=noise), sensors)) for one in plants]

    def true_plant(self, member: Member, fed: Fed = "outputs") -> Plant:
        """A member behind encoders that count; the drives take speeds from their difference."""
        self.check_fed(fed)
        assert self.resolution is not None
        plant, sensors = self.driven(member, smooth=False), motors(self.model.inputs)
        return self.read(CountingEncoders(plant, sensors, self.resolution))

    def _measured(self, plant: Plant) -> Plant:
        """A linear plant behind its motors' encoders."""
        return self.read(FineEncoders(plant, Sensors(range(self.model.inputs))))

    def _linear(self, member: Member, path: Float[Array, "T m"]) -> Plant:
        model = self._model(member, path)
        return Delayed(model, jnp.asarray(member.late), LATE, model.inputs)

    def linear_family(self, fed: Fed, path: Float[Array, "T m"]) -> Sequence[Plant]:
        return [self._measured(self._linear(member, path)) for member in self.members]

    def noisy_nominal(self, key: jax.Array, fed: Fed, path: Float[Array, "T m"]) -> Plant:
        """The linear model with noise on the positions of its motors; speeds are made of them."""
        assert self.noisy_count is not None
        half, read = self.noisy_count / 2, self.model.inputs
        noise = jax.random.uniform(key, (len(path), read), minval=-half, maxval=half)
        others = jnp.zeros((len(path), self.model.states - read))
        plant = self._linear(self.members[0], path)
        return self._measured(Disturbed(plant, noise=jnp.concatenate([noise, others], axis=1)))

    @property
    def members(self) -> Sequence[Member]:
        return members(self.stiffness_known_to, self.mass_known_to)

    def drawn(self, count: int, seed: int) -> list[Member]:
        """Stiffness, masses and delay drawn evenly from their intervals, then their corners."""
        random = np.random.default_rng(seed)
        known_to = self.stiffness_known_to, self.mass_known_to
        off = [1 + part * random.uniform(-1, 1, count) for part in known_to]
        factors = np.column_stack([*off, random.uniform(0, LATE, count)])
        low, high = [1 - part for part in known_to], [1 + part for part in known_to]
        return [
            Member(f"stiffness x {k:.3g}, masses x {m:.3g}, {late:.3g} samples late", k, m, late)
            for k, m, late in with_corners(factors, [*low, 0.0], [*high, LATE]).tolist()
        ]

    @property
    def unknown_delay(self) -> int:
        """Delay of a drive's bus."""
        return LATE

    def check_fed(self, fed: Fed) -> None:
        """Raise ValueError where a controller asks for the whole state."""
        if fed == "state":
            raise ValueError(f"controller: {self.name} measures its motors, not its whole state")
