"""Gantries as the commands see them.

Motor positions are measured; stiffness is known to a fifth, masses to a tenth.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax.tree_util import Partial
from jaxtyping import Array, Float

from jcontour.app.machines.families import Member, MotorMeasuredMachine, late
from jcontour.app.machines.machine import Fed, MachineLimits, Usual
from jcontour.app.machines.uncertainty import LATE
from jcontour.linear.model_schedule import ModelSchedule
from jcontour.linear.plant import LinearPlant
from jcontour.plant import Plant
from jcontour.plants.actuation import Saturated
from jcontour.plants.encoders import FineEncoders, Sensed
from jcontour.plants.friction import Friction
from jcontour.plants.gantry.friction_gantry import SmoothFrictionGantry, StickSlipGantry
from jcontour.plants.gantry.gantry import Gantry, GantryParameters, thesis_gantry
from jcontour.plants.gantry.linear_models import (
    Linearisation,
    MotorEncoders,
    control_oriented,
    motor_model,
    motor_schedule,
    tangent,
)
from jcontour.sensors import motors, row

SAMPLE = 1e-3  # [s] twenty-two to the period of the anti-resonance
CURRENT = 10.0  # [A] of each of the three motors
ENCODER_RESOLUTION = 1e-6  # [m] per count
# of more gain: the late loop is not left at its edge
LATE_AND_LIGHT = Member(f"{LATE} sample late, masses x 0.9", 1.0, 0.9, LATE)
SCHEDULED = 9  # head positions whose models are interpolated
MASSES = ("drive_mass_1", "drive_mass_2", "beam_mass", "head_mass")
MOTORS = np.array([[1.0, 0.0], [0.0, 1.0], [0.0, 1.0]])  # both drives follow y


@dataclass(frozen=True)
class GantryMachine(MotorMeasuredMachine):
    """A dual-drive gantry; contours are in its own coordinates, x = 0 at the centre of the beam."""

    kind: ClassVar[str] = "gantry"
    observed: ClassVar[str] = "jcontour.app.designs.gantry:GantryOffsetFreeLQ"
    cascade: ClassVar[str] = "jcontour.app.designs.gantry:GantryCascade"
    mass_known_to: ClassVar[float] = 0.1

    parameters: GantryParameters  # of the machine
    # of the guide ways of the head and of both drives, beside the viscous one; None without dry
    # friction
    friction: Friction | None = None

    def positions(self, fed: Fed) -> Callable[[Any], Float[Array, " m"]]:
        """Positions of the tool that follow from the motors': nothing bends but the joints."""
        encoders = MotorEncoders(self.parameters)
        return lambda measurement: self.parameters.tool(encoders.state(row(measurement))[:3])

    def linear_nominal(self, fed: Fed, path: Float[Array, "T m"]) -> Plant:
        """The model without the limits of the currents."""
        return self._measured(self._linear(self.members[0], path))

    def _model(self, member: Member, path: Float[Array, "T m"]) -> LinearPlant:
        """Model at the middle of the path along the beam."""
        parameters = scaled_gantry(self.parameters, member.stiffness, member.mass)
        x = path[:, 0]
        return motor_model(parameters, (jnp.min(x) + jnp.max(x)) / 2, self.model.dt)

    def read(self, encoders: Plant) -> Plant:
        """Positions and speeds in one row."""
        return Sensed(encoders, Partial(row))

    @property
    def nonsmooth_effects(self) -> str:
        return "encoder counts" if self.friction is None else "stick, slip and encoder counts"

    @property
    def resolution(self) -> float:
        return ENCODER_RESOLUTION

    @property
    def usual(self) -> Usual:
        return Usual(
            "gantry-offset-free-lq",
            training=("ring-left", "ring-centre", "cushion-right"),
            held_out=("eight-right", "oval-centre", "cushion-left"),
            beside_own=("oval-centre",),
            simulated="ring-left",
            front=("ring-left",),
            swept=("ring-left",),
            effort=1.2,
        )

    @cached_property
    def schedule(self) -> ModelSchedule:
        """Models over the whole beam."""
        return self._scheduled(tangent)

    @cached_property
    def linearised_schedule(self) -> ModelSchedule:
        """Models over the whole beam, the coupling of head and beam cancelled."""
        return self._scheduled(control_oriented)

    @property
    def shares(self) -> np.ndarray:
        """Both Y drives share the control of Y."""
        return MOTORS

    @property
    def members(self) -> Sequence[Member]:
        return [*super().members, LATE_AND_LIGHT]

    def driven(self, member: Member, smooth: bool) -> Plant:
        """Gantry with its currents limited and late, behind its motors' encoders."""
        parameters = scaled_gantry(self.parameters, member.stiffness, member.mass)
        if self.friction is None:
            plant: Plant = Gantry(parameters, self.model.dt)
        else:
            kind = SmoothFrictionGantry if smooth else StickSlipGantry
            plant = kind(parameters, self.friction, self.model.dt)
        return self._limited(plant, member.late)

    def nominal(self, fed: Fed = "outputs") -> Plant:
        """Plant with its limits, without dry friction.

        Where an axis turns, the smooth twin of the friction is so steep that it hides the loop.
        """
        self.check_fed(fed)
        plant = self._limited(Gantry(self.parameters, self.model.dt), 0)
        return self.read(FineEncoders(plant, motors(3)))

    def description(self) -> dict[str, str]:
        p = self.parameters
        masses = ", ".join(f"{float(getattr(p, name)):.4g}" for name in MASSES)
        currents = ", ".join(f"{limit:g}" for limit in np.asarray(self.limits.control))
        time = f"dt {1e3 * self.model.dt:g} ms"
        encoders = f"encoders of {1e6 * ENCODER_RESOLUTION:g} um"
        friction = {} if self.friction is None else {"Friction": _words(self.friction)}
        return {
            "Machine": f"{self.name}: head and two drives, "
            f"masses {masses} kg (drives, beam, head), "
            f"beam of {2 * float(p.half_span):g} m, {currents} A (head, drives), {time}",
            **friction,
            "Measured": f"motors' positions by {encoders}, "
            "speeds by difference; neither tool nor twist",
        }

    def _scheduled(self, linear: Linearisation) -> ModelSchedule:
        span = float(self.parameters.half_span)
        return motor_schedule(
            self.parameters, np.linspace(-span, span, SCHEDULED), self.model.dt, linear
        )

    def _limited(self, plant: Plant, samples: float) -> Plant:
        """Plant with its currents limited and late, behind its motors' encoders."""
        limited = Saturated(plant, jnp.asarray(self.limits.control))
        return Sensed(late(limited, samples, LATE, 3), MotorEncoders(self.parameters))


def gantry_machine() -> GantryMachine:
    """Yuan's laser cutter, chapter 5."""
    parameters = thesis_gantry()
    limits = MachineLimits(control=np.full(3, CURRENT))
    return GantryMachine(
        "gantry", motor_model(parameters, 0.0, SAMPLE), ("X", "Y"), "A", limits, parameters
    )


def friction_gantry_machine() -> GantryMachine:
    """The same with dry friction in its guide ways, which the thesis does not print."""
    return replace(gantry_machine(), name="gantry-friction", friction=guide_ways())


def guide_ways() -> Friction:
    """Dry friction of linear guides with seals and covers, chosen by us.

    Its size is usual for such guides: 14, 20 and 24 N at rest, unequal for the two drives. The
    viscous part is in the parameters of the machine.
    """
    return Friction(
        coulomb=[10.0, 14.0, 18.0], stribeck=[4.0, 6.0, 6.0], stribeck_speed=0.02, viscous=0.0
    )


def _words(friction: Friction) -> str:
    breaking = ", ".join(f"{float(force):g}" for force in friction.dry(jnp.zeros(3)))
    sliding = ", ".join(f"{float(force):g}" for force in friction.coulomb)
    return (
        f"{breaking} N to break loose, {sliding} N in motion (head, drives), "
        "chosen by us; no other engine confirms it"
    )


def scaled_gantry(parameters: GantryParameters, stiffness: float, mass: float) -> GantryParameters:
    """Parameters with the stiffness of the joints and all masses times these factors."""
    scaled = {"joint_stiffness": stiffness, **dict.fromkeys(MASSES, mass)}
    return eqx.tree_at(
        lambda p: [getattr(p, name) for name in scaled],
        parameters,
        [f * getattr(parameters, name) for name, f in scaled.items()],
    )
