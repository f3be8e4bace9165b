"""Contouring schemes around the cascade of two flexible axes, built from gains."""

from collections.abc import Callable

import numpy as np

from jcontour.app.designs.flexible_axis import Gain, Gains, MakeController, cascade
from jcontour.app.machines.flexible_axis import FlexibleMachine
from jcontour.controller import Controller
from jcontour.controllers.contouring.command_shaping import CommandShaped
from jcontour.controllers.contouring.cross_coupled import Coupling, CrossCoupled, CrossGains
from jcontour.controllers.contouring.precompensation import Precompensated
from jcontour.controllers.contouring.task_frame import TaskFrame


def coupled(machine: FlexibleMachine) -> dict[str, Gain]:
    """A compensator that is weak beside the position loops."""
    return {
        "cross": Gain(3.0, "1/s"),
        "cross_integral": Gain(3.0, "1/s^2"),
        "cross_derivative": Gain(0.01, ""),
    }


def along_and_across(machine: FlexibleMachine) -> dict[str, Gain]:
    """Position gains along the path and across it, in place of one for both axes."""
    return {"position": Gain(np.array([30.0, 30.0]), "1/s")}


def precompensated(machine: FlexibleMachine) -> dict[str, Gain]:
    """Far below the bandwidth of the position loops."""
    return {"precompensation": Gain(1.0, "1/s")}


def shaped(machine: FlexibleMachine) -> dict[str, Gain]:
    """A tenth of the contour error."""
    return {"shaping": Gain(0.1, "")}


def cross_coupled(coupling: Callable[[], Coupling]) -> MakeController:
    """The cascade with a compensator on the contour error."""

    def build(machine: FlexibleMachine, gains: Gains) -> Controller:
        compensator = CrossGains(gains["cross"], gains["cross_integral"], gains["cross_derivative"])
        return CrossCoupled(cascade(machine, gains), compensator, coupling())

    return build


def in_task_frame(machine: FlexibleMachine, gains: Gains) -> Controller:
    """The cascade with its position loops along the path and across it."""
    return TaskFrame(cascade(machine, gains))


def behind_precompensation(machine: FlexibleMachine, gains: Gains) -> Controller:
    """The cascade behind CCPM."""
    return Precompensated(cascade(machine, gains), gains["precompensation"])


def behind_shaping(machine: FlexibleMachine, gains: Gains) -> Controller:
    """The cascade behind CPSCS."""
    return CommandShaped(cascade(machine, gains), gains["shaping"])
