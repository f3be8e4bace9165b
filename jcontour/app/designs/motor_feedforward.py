"""Inverse feedforward of machines whose motors are measured: flexible axes and gantries.

The cascade reads the motors, the inverse is that of a linear machine from each motor's control to
the tool. It is the nominal machine without dry friction and without cogging; a gantry's is that
with its head at the beam's centre and the coupling of head and twist left out
(`control_oriented`), both drives of Y alike. Dry friction has a term of its own. What is left,
the beam's twist included, is the feedback's.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jcontour.app.designs import flexible_axis, gantry
from jcontour.app.designs.feedforward import CONSTRAINT, SMOOTHING, WEIGHT, first_numbers
from jcontour.app.designs.gains import Gain, GainDesign, Gains
from jcontour.app.flags.shared import Controlled
from jcontour.app.machines.flexible_axis import FlexibleMachine
from jcontour.app.machines.gantry import GantryMachine
from jcontour.controller import Controller
from jcontour.controllers.feedforward.friction_feedforward import FrictionFeedforward
from jcontour.controllers.feedforward.inverse_feedforward import InverseFeedforward
from jcontour.controllers.feedforward.model_following import ModelFollowing
from jcontour.controllers.feedforward.preview_filter import PreviewFilter
from jcontour.controllers.feedforward.tuned_inverse import (
    OptimalInverse,
    optimal_filter,
    zero_phase_inverse,
)
from jcontour.controllers.feedforward.zpetc import RINGING
from jcontour.controllers.wrappers.motor_kinematics import OfMotors
from jcontour.linear.plant import LinearPlant, SteadyMotion
from jcontour.linear.transfer_functions import TransferFunction, transfer_function
from jcontour.linear.transformations import with_input_delay
from jcontour.plant import Plant
from jcontour.plants.gantry.linear_models import control_oriented
from jcontour.plants.gantry.motor_coordinates import motor_model
from jcontour.plants.wrappers.encoders import FineEncoders
from jcontour.sensors import Sensors, motors

ORDER = 16  # of the model: at 1 ms it is down 3 dB at 50 Hz for q = 1/4, links ring at 10 to 40 Hz
MODEL = SMOOTHING._replace(start=0.2)  # the inverse of a link takes the fourth difference


class Inverted(NamedTuple):
    """What an inverse knows of a machine.

    Attributes:
        transfers: from the control of each motor to the tool along its axis.
        nominal: the machine of the nominal motion, measured as the cascade reads it.
    """

    transfers: list[TransferFunction]
    nominal: Plant


# free numbers of an inverse, and the inverse made of them
Ahead = tuple[dict[str, Gain], Callable[[Gains], PreviewFilter]]
MakeAhead = Callable[[list[TransferFunction], Controlled], Ahead]


def zero_phase(transfers: list[TransferFunction], flags: Controlled) -> Ahead:
    """Zero phase error tracking; it takes the preview that it needs."""

    def ahead(gains: Gains) -> PreviewFilter:
        return zero_phase_inverse(transfers, gains["smoothing"], RINGING, ORDER)

    return {"smoothing": MODEL}, ahead


def optimal(transfers: list[TransferFunction], flags: Controlled) -> Ahead:
    """l1-optimal feedforward; the preview of the flags is beyond that of the model."""
    following = ModelFollowing(ORDER, ORDER + flags.preview, CONSTRAINT)
    free = {"smoothing": MODEL, "weight": WEIGHT}
    first = first_numbers(free, flags)
    inverses = [OptimalInverse(one, following, **first, ringing=RINGING) for one in transfers]

    def ahead(gains: Gains) -> PreviewFilter:
        return optimal_filter(inverses, gains["smoothing"], gains["weight"])

    return free, ahead


def of_axes(machine: FlexibleMachine, late: int) -> Inverted:
    """Axes with their links, `late` samples late."""
    with jax.ensure_compile_time_eval():
        model = with_input_delay(machine.model, late)
    count = len(machine.axes)
    transfers = [transfer_function(model, axis, axis) for axis in range(count)]
    return Inverted(transfers, FineEncoders(model, Sensors(range(count))))


def of_drives(machine: GantryMachine) -> Inverted:
    """Head and both drives with the head at the beam's centre; the drives of Y share its mass."""
    dt = machine.model.dt
    with jax.ensure_compile_time_eval():
        model = motor_model(machine.parameters, 0.0, dt, control_oriented)
        together = np.asarray(gantry.MOTORS)
        read = np.linalg.pinv(together) @ np.eye(3, 6)  # x_h and the middle of both drives
        of_tool = LinearPlant(model.A, model.B @ together, read, dt)
        x, y = (transfer_function(of_tool, axis, axis) for axis in range(2))
        motion = SteadyMotion(jnp.eye(6)[:, :3], jnp.eye(6)[:, 3:] / dt)
        of_motors = LinearPlant(model.A, model.B, np.eye(3, 6), dt, motion=motion)
    return Inverted([x, y, y], FineEncoders(of_motors, motors(3)))


def axes_feedforward(
    make: MakeAhead,
) -> Callable[[str, str, FlexibleMachine, Controlled], GainDesign]:
    """Maker of a design: the cascade of flexible axes behind an inverse, and their friction."""

    def design(name: str, line: str, machine: FlexibleMachine, flags: Controlled) -> GainDesign:
        inverted = of_axes(machine, _late(machine, flags))
        free, ahead = make(inverted.transfers, flags)
        dry = flexible_axis.feedforward(machine)["coulomb"]
        gains = {**flexible_axis.loops(machine), "coulomb": dry, **free}

        def build(machine: FlexibleMachine, values: Gains) -> Controller:
            loops = {key: value for key, value in values.items() if key != "coulomb"}
            cascade = flexible_axis.cascade(machine, {**loops, "feedforward": 1.0})
            behind = InverseFeedforward(cascade, ahead(values), inverted.nominal)
            return FrictionFeedforward(behind, values["coulomb"], cascade.limit)

        return _design(name, line, machine, gains, build)

    return design


def drives_feedforward(
    make: MakeAhead,
) -> Callable[[str, str, GantryMachine, Controlled], GainDesign]:
    """Maker of a design: the cascade of a gantry's motors behind an inverse, and their friction."""

    def design(name: str, line: str, machine: GantryMachine, flags: Controlled) -> GainDesign:
        if flags.model_delay:
            raise ValueError(
                f"model-delay: the inverse of {machine.name} knows no delay, "
                f"received {flags.model_delay}"
            )
        inverted = of_drives(machine)
        free, ahead = make(inverted.transfers, flags)
        known = gantry.loops(machine)
        if machine.friction is not None:
            known = gantry.loops_and_dry_friction(machine)
        kept = ("position", "velocity", "integral_time", "coulomb")
        gains = {**{key: known[key] for key in kept if key in known}, **free}

        def build(machine: GantryMachine, values: Gains) -> Controller:
            loops = {key: values[key] for key in kept[:3]}
            of_motors = gantry.cascade(machine, {**loops, "feedforward": jnp.ones(2)}, 0)
            cascade = of_motors.controller
            behind = InverseFeedforward(cascade, ahead(values), inverted.nominal)
            dry = gantry.MOTORS @ values.get("coulomb", jnp.zeros(2))
            limit = jnp.asarray(machine.limits.control)
            return OfMotors(FrictionFeedforward(behind, dry, limit), gantry.MOTORS)

        return _design(name, line, machine, gains, build)

    return design


def _design(name, line, machine, gains: dict[str, Gain], build) -> GainDesign:
    start = {key: gain.start for key, gain in gains.items()}
    space = {key: gain.parameter for key, gain in gains.items()}
    preview = build(machine, start).preview
    return GainDesign(name, machine, start, space, preview, "outputs", build, line, gains)


def _late(machine: FlexibleMachine, flags: Controlled) -> int:
    """Samples of the unknown delay in the nominal machine.

    Raises:
        ValueError: the flag is not within what the machine may have.
    """
    most = machine.unknown_delay
    if flags.model_delay is None:
        return most // 2
    if not 0 <= flags.model_delay <= most:
        raise ValueError(
            f"model-delay: {machine.name} may be 0 to {most} samples late beyond what is known, "
            f"received {flags.model_delay}"
        )
    return flags.model_delay
