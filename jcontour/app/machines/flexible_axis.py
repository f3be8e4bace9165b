"""Flexible axes as the commands see them.

Motor positions and speeds are measured; stiffness and masses are known to a fifth.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jcontour.app.files.machine_file import ENCODER_RESOLUTION, KIND, FlexibleAxisFile
from jcontour.app.files.schema import axis_names, one_or_each, per_axis
from jcontour.app.machines.families import Member, MotorMeasuredMachine, late
from jcontour.app.machines.machine import Fed, MachineLimits, Usual
from jcontour.app.machines.uncertainty import LATE, in_words
from jcontour.linear.plant import LinearPlant
from jcontour.plant import Plant
from jcontour.plants.encoders import FineEncoders
from jcontour.plants.flexible_axis.axis import (
    AxisParameters,
    FlexibleAxis,
    SmoothFlexibleAxis,
    thesis_axis,
    zoh_model,
)
from jcontour.plants.friction import Friction
from jcontour.sensors import Sensors, motors

SAMPLE = 1e-3  # [s] of the thesis's controller
# [s] of the smooth twin: its error on the thesis's tasks stays the same to 1e-5
# it takes a fifth of the time
TWIN_SUBSTEP = 2.5e-4
# of the start's RMS current: a motor warms by its square, and near the limit of stability there is
# no end to it
EFFORT = 1.2
ALONE = Usual(
    "cascade",
    training=("task-a", "task-b"),  # from either alone the other gets worse
    held_out=("s-curve",),
    beside_own=("task-b", "s-curve"),
    simulated="task-a",
    front=("task-a",),
    swept=("task-a",),
    effort=EFFORT,
)
SIDE_BY_SIDE = Usual(
    "cascade",
    training=("ring",),
    held_out=("rounded-square",),
    beside_own=("ring",),
    simulated="ring",
    front=("ring",),
    swept=("ring",),
    effort=EFFORT,
)


@dataclass(frozen=True)
class FlexibleMachine(MotorMeasuredMachine):
    """One flexible axis, or several side by side."""

    kind: ClassVar[str] = "flexible axes"
    observed: ClassVar[str] = "jcontour.app.designs.flexible_axis:AxisOffsetFreeLQG"
    cascade: ClassVar[str] = "jcontour.app.designs.flexible_axis:AxisFeedforward"

    parameters: AxisParameters  # of the axes
    # [m] per count of the motors' encoders, of all axes or of each (m,)
    encoder_resolution: float | np.ndarray

    def positions(self, fed: Fed) -> Callable[[Any], Float[Array, " m"]]:
        return motors(len(self.axes)).positions

    def _model(self, member: Member, path: Float[Array, "T m"]) -> LinearPlant:
        return zoh_model(self._varied(member), self.model.dt)

    @property
    def nonsmooth_effects(self) -> str:
        return "stick, slip and encoder counts"

    @property
    def resolution(self) -> float | np.ndarray:
        return self.encoder_resolution

    @property
    def usual(self) -> Usual:
        return ALONE if len(self.axes) == 1 else SIDE_BY_SIDE

    def driven(self, member: Member, smooth: bool) -> Plant:
        varied, dt = self._varied(member), self.model.dt
        plant: Plant = FlexibleAxis(varied, dt)
        if smooth:
            substeps = math.ceil(dt / TWIN_SUBSTEP - 1e-9)
            plant = SmoothFlexibleAxis(varied, dt, substeps=substeps)
        return late(plant, member.late, LATE, len(self.axes))

    def nominal(self, fed: Fed = "outputs") -> Plant:
        """Linear model of the axis.

        Where the axis rests, the friction of the smooth twin is so steep that it hides the loop.
        """
        self.check_fed(fed)
        return FineEncoders(self.model, Sensors(range(len(self.axes))))

    def description(self) -> dict[str, str]:
        p = self.parameters
        pairs = zip(p.motor_mass, p.tool_mass, strict=True)
        masses = "; ".join(f"{motor:g} + {tool:g} kg" for motor, tool in pairs)
        kind = "flexible axis" if p.axes == 1 else "flexible axes"
        time = f"dt {1e3 * self.model.dt:g} ms"
        encoders = f"encoders of {in_words(self.encoder_resolution)}"
        return {
            "Machine": f"{self.name}: {kind} {', '.join(self.axes)}, "
            f"motor and end effector {masses}, {time}",
            "Measured": f"motors' positions by {encoders}, speeds by difference; no end effector",
        }

    def _varied(self, member: Member) -> AxisParameters:
        return scaled(self.parameters, member.stiffness, member.mass)


def flexible_machine(file: FlexibleAxisFile) -> FlexibleMachine:
    """The machine of an axis file."""
    limit = file.current_limit
    return _machine(
        file.name or KIND,
        file.parameters,
        file.dt,
        axis_names(file.axes, file.count),
        one_or_each("encoder_resolution", file.encoder_resolution, file.count),
        None if limit is None else per_axis("current_limit", limit, file.count),
    )


def _machine(
    name: str,
    parameters: AxisParameters,
    dt: float,
    axes: tuple[str, ...],
    resolution: float | np.ndarray = ENCODER_RESOLUTION,
    current_limit: np.ndarray | None = None,
) -> FlexibleMachine:
    limits = MachineLimits(control=current_limit)
    model = zoh_model(parameters, dt)
    return FlexibleMachine(name, model, axes, "A", limits, parameters, resolution)


def thesis_machine() -> FlexibleMachine:
    """The test bench of Yuan's thesis, chapter 3."""
    return _machine("flexible-axis", thesis_axis(), SAMPLE, ("X",))


def biaxial_axes() -> AxisParameters:
    """Two different axes at right angles.

    X is the thesis's test bench; Y is ours, lighter and with a weaker motor.
    """
    lighter = AxisParameters(
        motor_mass=20.0,
        tool_mass=0.5,
        stiffness=4500.0,
        damping=3.0,
        force_constant=60.0,
        friction=Friction(coulomb=25.0, stribeck=10.0, stribeck_speed=2.0, viscous=150.0),
        cogging_sine=[3.0, -0.5, 0.4],
        cogging_cosine=[-5.0, 0.8, 0.3],
        pole_pitch=0.0875,
    )
    return jax.tree.map(lambda *leaves: jnp.concatenate(leaves), thesis_axis(), lighter)


def biaxial_machine() -> FlexibleMachine:
    """Two flexible axes, as a contour needs them."""
    return _machine("flexible-axes", biaxial_axes(), SAMPLE, ("X", "Y"))


def scaled(parameters: AxisParameters, stiffness: float, mass: float) -> AxisParameters:
    """Parameters with the link's stiffness and all masses times these factors."""
    return eqx.tree_at(
        lambda p: (p.stiffness, p.motor_mass, p.tool_mass),
        parameters,
        (
            stiffness * parameters.stiffness,
            mass * parameters.motor_mass,
            mass * parameters.tool_mass,
        ),
    )
