"""Inverse feedforward in front of cascades, of linear machines, flexible axes and gantries.

On a flexible axis or a gantry the cascade reads the motors, the inverse is that of a linear machine
from each motor's control to the tool. It is the nominal machine without dry friction and without
cogging; a gantry's is that with its head at the beam's centre and the coupling of head and twist
left out (`control_oriented`), both drives of Y alike. Dry friction has a term of its own. What is
left, the beam's twist included, is the feedback's.
"""

import abc
from functools import cached_property
from typing import ClassVar, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jcontour.app.designs import gantry
from jcontour.app.designs.design import Design, Gains
from jcontour.app.designs.flexible_axis import DRY_FRICTION, AxisCascade
from jcontour.app.designs.simple_loops import LinearCascade, axes_of, drives_of
from jcontour.app.machines.flexible_axis import FlexibleMachine
from jcontour.app.machines.gantry import GantryMachine
from jcontour.controller import Controller
from jcontour.controllers.feedforward.inverse_feedforward import (
    FrictionFeedforward,
    InverseFeedforward,
)
from jcontour.controllers.feedforward.model_following import ModelFollowing
from jcontour.controllers.feedforward.tuned_inverse import (
    OptimalInverse,
    optimal_filter,
    smoothed_inverse,
    zero_phase_inverse,
)
from jcontour.controllers.feedforward.zpetc import RINGING, PreviewFilter, causal_filter
from jcontour.controllers.wrappers.adapters import OfMotors
from jcontour.linear.plant import LinearPlant, SteadyMotion
from jcontour.linear.transfer_functions import TransferFunction, transfer_function
from jcontour.linear.transformations import with_input_delay
from jcontour.plant import Plant
from jcontour.plants.encoders import Encoders, FineEncoders
from jcontour.plants.gantry.linear_models import control_oriented, motor_model
from jcontour.sensors import Sensors, motors
from tuning.parameters import Interval, Weight

LINKS = 16  # order of the model of links: down 3 dB at 50 Hz for 1 ms, q = 1/4; they ring below 40
CONSTRAINT = 2  # order of the weight: bounded acceleration
# 1/4 is Alter & Tsao's model; their weight is 1: no error on a steady motion
SMOOTHING = Weight("smoothing", range=Interval(1e-3, 0.3), start=0.05)
WEIGHT = Weight("weight", range=Interval(0.8, 1.2), start=1.0)
INVERSE = SMOOTHING._replace(start=0.2)  # the inverse of a link takes the fourth difference


class Inverted(NamedTuple):
    """Nominal machine that is inverted."""

    transfers: list[TransferFunction]  # from the control of each motor to the tool along its axis
    nominal: Plant  # the machine of the nominal motion, measured as the cascade reads it


class ZeroPhase(Design):
    """Zero phase error tracking; it takes the preview it needs."""

    order: ClassVar[int] = LINKS  # of the model that is followed
    # zeros that ring more are left to the optimum, see `sorted_zeros`
    ringing: ClassVar[float] = RINGING

    @cached_property
    @abc.abstractmethod
    def inverted(self) -> Inverted:
        """Nominal machine that is inverted."""

    def inverse(self, gains: Gains) -> PreviewFilter:
        """The inverse."""
        transfers, smoothing = self.inverted.transfers, gains["smoothing"]
        return zero_phase_inverse(transfers, smoothing, RINGING, self.order)


class Causal(ZeroPhase):
    """Causal inversion; the model's smoothing looks ahead."""

    def inverse(self, gains: Gains) -> PreviewFilter:
        filters = [causal_filter(one, RINGING) for one in self.inverted.transfers]
        return smoothed_inverse(filters, gains["smoothing"], self.order)


class Optimal(ZeroPhase):
    """Feedforward optimal in l1; on links the preview of the flags is beyond that of the model."""

    reads = ("preview", "model_delay")

    @cached_property
    def inverses(self) -> list[OptimalInverse]:
        """Inverse of every motor; its taps are those of the first numbers."""
        preview = self.flags.horizon(self.machine.model.dt) + (self.order if self.order > 1 else 0)
        following = ModelFollowing(self.order, preview, CONSTRAINT)
        first = {name: float(self.start[name]) for name in ("smoothing", "weight")}
        return [
            OptimalInverse(one, following, **first, ringing=self.ringing)
            for one in self.inverted.transfers
        ]

    def inverse(self, gains: Gains) -> PreviewFilter:
        return optimal_filter(self.inverses, gains["smoothing"], gains["weight"])


class ZeroPhaseCascade(ZeroPhase, LinearCascade):
    """Zero phase error tracking (Tomizuka) in front of the cascade."""

    weights = (*LinearCascade.weights, SMOOTHING)
    reads = ("model_delay",)
    order, ringing = 1, 1.0

    @cached_property
    def inverted(self) -> Inverted:
        with jax.ensure_compile_time_eval():
            nominal = with_input_delay(self.machine.model, self.late)
        return Inverted(axes_of(nominal), Encoders(nominal))

    def build(self, weights: Gains) -> Controller:
        return InverseFeedforward(
            controller=super().build({**weights, "feedforward": 1.0}),  # fed the speed
            ahead=self.inverse(weights),
            machine=self.inverted.nominal,
            limit=drives_of(self.machine).limit,
        )


class CausalCascade(Causal, ZeroPhaseCascade):
    """Causal inversion of the model in front of the cascade, no preview but its delay."""


class OptimalCascade(Optimal, ZeroPhaseCascade):
    """Feedforward optimal in l1 with preview (Alter & Tsao) in front of the cascade."""

    weights = (*ZeroPhaseCascade.weights, WEIGHT)


class AxisZeroPhase(ZeroPhase, AxisCascade):
    """Zero phase error tracking in front of the cascade, dry friction fed forward.

    The unknown delay of the nominal machine is half of what it may be where none is given.
    """

    weights = (*AxisCascade.weights, DRY_FRICTION, INVERSE)
    reads = ("model_delay",)

    @cached_property
    def inverted(self) -> Inverted:
        most = self.machine.unknown_delay
        return of_axes(self.machine, self.model_delay(most, most // 2))

    def first_preview(self, first: Gains) -> int:
        return self.build(first).preview

    def build(self, weights: Gains) -> Controller:
        loops = {key: value for key, value in weights.items() if key != "coulomb"}
        cascade = self.cascade({**loops, "feedforward": 1.0})
        ahead, machine = self.inverse(weights), self.inverted.nominal
        behind = InverseFeedforward(controller=cascade, ahead=ahead, machine=machine)
        dry = weights["coulomb"]
        return FrictionFeedforward(controller=behind, coulomb=dry, limit=cascade.limit)


class AxisCausal(Causal, AxisZeroPhase):
    """Causal inversion of the axes in front of the cascade, dry friction fed forward."""


class AxisOptimal(Optimal, AxisZeroPhase):
    """Feedforward optimal in l1 with preview in front of the cascade, dry friction fed forward."""

    weights = (*AxisZeroPhase.weights, WEIGHT)


class GantryZeroPhase(ZeroPhase, gantry.GantryCascade):
    """Zero phase error tracking in front of the cascades, model of the beam's centre.

    Dry friction is fed forward where there is some.
    """

    weights = (*gantry.LOOPS, gantry.DRY_FRICTION, INVERSE)
    reads = ("model_delay",)

    @cached_property
    def inverted(self) -> Inverted:
        self.model_delay(0, 0)
        return of_drives(self.machine)

    def build(self, weights: Gains) -> Controller:
        loops = {one.name: weights[one.name] for one in gantry.LOOPS}
        cascade = self.cascade({**loops, "feedforward": jnp.ones(2)})
        ahead, machine = self.inverse(weights), self.inverted.nominal
        behind = InverseFeedforward(controller=cascade, ahead=ahead, machine=machine)
        dry = gantry.MOTORS @ weights.get("coulomb", jnp.zeros(2))
        limit = jnp.asarray(self.machine.limits.control)
        fed = FrictionFeedforward(controller=behind, coulomb=dry, limit=limit)
        return OfMotors(fed, gantry.MOTORS)


class GantryOptimal(Optimal, GantryZeroPhase):
    """Feedforward optimal in l1 with preview in front of the cascades, the same model."""

    weights = (*GantryZeroPhase.weights, WEIGHT)


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
