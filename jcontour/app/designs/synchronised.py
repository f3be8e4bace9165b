"""Adaptive synchronisation as the commands see it: of two flexible axes, of a gantry's Y drives.

Every axis is taken for a mass with viscous friction: its link, its twist and its dry friction are
left to the adaptation.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from jcontour._arrays import is_concrete
from jcontour.app.designs.contouring_schemes import ContouringScheme
from jcontour.app.designs.design import Design, Gains
from jcontour.app.designs.gantry import GANTRY, MOTORS, GantryCascade
from jcontour.app.machines.flexible_axis import FlexibleMachine
from jcontour.app.machines.gantry import GantryMachine
from jcontour.app.machines.machine import Machine
from jcontour.controller import Controller
from jcontour.controllers.synchronisation.adaptive import (
    AdaptiveSynchronisation,
    MasterSlave,
    SynchronisedGains,
)
from jcontour.controllers.synchronisation.speed_axes import (
    SpeedAxes,
    check_coupling,
    sampled_loop,
    speed_axes,
)
from jcontour.controllers.wrappers.adapters import OfMotors
from jcontour.sensors import motors
from tuning.parameters import Interval, Weight


class Loops(NamedTuple):
    """How fast the loops are that the gains start from."""

    speed: float  # bandwidth of the speed loop [rad/s]
    position: float  # k_p [1/s]
    coupling: float  # beta
    # time in which the adaptation to a load does what the proportional part does [s]
    integral_time: float


AXES_LOOPS = Loops(100.0, 30.0, 0.5, 0.05)  # as fast as the gantry's cascade
DRIVES_LOOPS = Loops(60.0, 20.0, 0.2, 0.1)  # faster ones ring where the gantry is a sample late
BIAS = 0.1  # [m/s] that a load is estimated by: a usual speed


WEIGHTS = (
    Weight("position", "1/s"),
    Weight("proportional", "A s/m"),
    Weight("adaptation", "A s^3/m^3 per sample"),
    Weight("coupling"),
)


def _starts(axes: SpeedAxes, loops: Loops, dt: float) -> Gains:
    """Gains from the model of the axes.

    The adaptation to a load gathers gamma v_c^2 e a sample, as a PI loop gathers k_c T / T_i e.
    """
    proportional = loops.speed / axes.gain
    return {
        "position": jnp.full(len(axes.gain), loops.position),
        "proportional": jnp.asarray(proportional),
        "adaptation": jnp.asarray(proportional * dt / loops.integral_time / BIAS**2),
        "coupling": loops.coupling,
    }


class SynchronisedAxes(Design[FlexibleMachine]):
    """Adaptive feedforward of two axes kept together (Tomizuka).

    A coupling above its bound is warned of, for the largest speed that is usual.
    """

    needs, weights, learns = ContouringScheme.needs, WEIGHTS, True

    def starts(self) -> Gains:
        return _starts(axes_of(self.machine), AXES_LOOPS, self.machine.model.dt)

    def build(self, weights: Gains) -> Controller:
        return _synchronised(self.machine, axes_of(self.machine), weights, (0, 1))


class SynchronisedDrives(Design[GantryMachine]):
    """Adaptive feedforward of each motor, both Y drives kept together (Tomizuka).

    Its gains are those of X and Y, the same for both drives of Y.
    """

    needs, weights, learns = GANTRY, WEIGHTS, True

    def starts(self) -> Gains:
        two = SpeedAxes(*(values[:2] for values in drives_of(self.machine)))
        return _starts(two, DRIVES_LOOPS, self.machine.model.dt)

    def build(self, weights: Gains) -> Controller:
        each = {
            name: MOTORS @ value if jnp.ndim(value) else value for name, value in weights.items()
        }
        drives = drives_of(self.machine)
        return OfMotors(_synchronised(self.machine, drives, each, (1, 2)), MOTORS)


class MasterSlaveDrives(GantryCascade):
    """P-PI cascades of a gantry whose second Y drive follows the first one."""

    weights = (*GantryCascade.weights, Weight("following", range=Interval(0.01, 1.5), start=1.0))

    def build(self, weights: Gains) -> Controller:
        loops = {name: value for name, value in weights.items() if name != "following"}
        law = MasterSlave(self.cascade(loops), (1, 2), weights["following"])
        return OfMotors(law, MOTORS)


def axes_of(machine: FlexibleMachine) -> SpeedAxes:
    """Each axis as one mass."""
    p = machine.parameters
    mass = np.asarray(p.motor_mass) + np.asarray(p.tool_mass)
    return speed_axes(np.asarray(p.friction.viscous) / mass, np.asarray(p.force_constant) / mass)


def drives_of(machine: GantryMachine) -> SpeedAxes:
    """Head and both drives, each drive with half of what moves along y."""
    p = machine.parameters
    head = float(p.head_mass)
    half = (head + float(p.beam_mass) + float(p.drive_mass_1) + float(p.drive_mass_2)) / 2
    mass = np.array([head, half, half])
    viscous = np.array([p.head_viscous, p.drive_viscous, p.drive_viscous])
    constant = np.array([p.head_constant, p.drive_constant, p.drive_constant])
    return speed_axes(viscous / mass, constant / mass)


def _synchronised(
    machine: Machine, axes: SpeedAxes, gains: Gains, pair: tuple[int, int]
) -> AdaptiveSynchronisation:
    dt = machine.model.dt
    _check(axes, gains, pair, dt)
    law = SynchronisedGains(
        gains["proportional"], gains["adaptation"], gains["coupling"], gains["position"], BIAS
    )
    return AdaptiveSynchronisation(law, motors(len(axes.pole)), dt, axes.feedforward(dt), pair=pair)


def _check(axes: SpeedAxes, gains: Gains, pair: tuple[int, int], dt: float) -> None:
    """Warn of a coupling above its bound, at the usual speed; the pair has the larger adaptation.

    The bound knows neither links nor delays, which lower it.
    """
    if not is_concrete(*gains.values()):
        return
    two = np.array(pair)
    axes_of_pair = SpeedAxes(axes.pole[two], axes.gain[two])
    proportional, adaptation = (
        np.broadcast_to(np.asarray(gains[name]), axes.pole.shape)[two]
        for name in ("proportional", "adaptation")
    )
    loop = sampled_loop(axes_of_pair, proportional, float(adaptation.max()), BIAS, dt, BIAS)
    check_coupling(loop, float(gains["coupling"]))
