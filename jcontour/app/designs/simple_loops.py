"""Loops of drives on linear machines: cascades and position loops, with feedforward and notch.

A loop begins as the fastest of a series that keeps a margin on the whole family. Velocity loops of
a cascade cross over at w, position loops at a quarter of it:

    k_pv = 1 / (|1 + 1/(j c)| |G_v(w)|),   T_iv = c / w,   k_pp = w / 4

G_v is the response of an axis from control to speed. The series goes through w and c. A
proportional loop suits a drive that takes a speed or a position, P-PI one that takes a speed or a
force. A notch stands at the lowest resonance of the machine, the same on all axes: axes that are
filtered alike stay together.
"""

import abc
from itertools import product
from typing import Any

import equinox as eqx
import numpy as np

from jcontour.app.designs.design import Gains, LinearDesign, picked
from jcontour.app.designs.first_loop import fastest
from jcontour.app.machines.linear import LinearMachine
from jcontour.app.machines.machine_behaviour import steady_response
from jcontour.controller import Controller
from jcontour.controllers.feedback.cascade import Cascade, CascadeGains, PositionLoop
from jcontour.controllers.wrappers.adapters import SpeedByDifference
from jcontour.controllers.wrappers.filters import Filtered, notch
from jcontour.linear.plant import LinearPlant, decoupled_axes
from jcontour.linear.transfer_functions import TransferFunction, transfer_function
from jcontour.sensors import Sensors, motors
from tuning.parameters import Fixed, Interval, Weight

CROSSOVERS = np.geomspace(0.5, 3e-3, 16)  # w [rad per sample] from fast to slow
CORNERS = (0.2, 1.0, 3.0)  # c: the first for drives that take a speed, the last for currents
PROPORTIONAL, CASCADE = "position-loop", "linear-cascade-feedforward"  # without a notch
NOTCHED = {PROPORTIONAL: "position-loop-notch", CASCADE: "linear-cascade-notch"}
ORDERS = ("level", "viscous", "inertia")  # control per position, speed, acceleration
POSITION_CROSSOVERS = np.geomspace(0.5, 3e-4, 32)  # [rad per sample] from fast to slow
RINGS = 0.3  # damping below which a pair of poles is a resonance
USUAL = 0.1  # of the sampling rate: where a notch begins on a machine without one
DEPTH, DAMPING = 0.2, 0.2  # of a notch that bears a resonance 5 % off: it allows 3 times the gain


class Drives(eqx.Module):
    """Drives of a linear machine, a pytree: loops of the same shapes share programs.

    Args:
        dt: sample period [s].
        limit: of the controls; infinite where none is stated.
        holding: control per m that holds each axis at rest.
    """

    limit: Any
    holding: np.ndarray
    dt: float = eqx.field(static=True)

    def cascade(self, gains: Gains) -> Controller:
        """P-PI on the encoders, speeds by difference; of the gains those that it knows."""
        known = {name: gains[name] for name in CascadeGains.__dataclass_fields__ if name in gains}
        axes, dt = len(self.holding), self.dt
        loops = Cascade(CascadeGains(**known), motors(axes), dt, self.limit, self.holding)
        return SpeedByDifference(loops, Sensors(range(axes)), dt)


class LinearCascade(LinearDesign):
    """P-PI cascade on encoders, speeds by difference.

    It is the fastest of the series that keeps the margin on the family.
    """

    weights = (
        Weight("position", "1/s"),
        Weight("velocity", "{control} per m/s"),
        Weight("integral_time", "s"),
    )

    def starts(self) -> Gains:
        machine, series = self.machine, cascades(self.machine)
        return series[fastest(machine, series, drives_of(machine).cascade)]

    def build(self, weights: Gains) -> Controller:
        return drives_of(self.machine).cascade(weights)


def drives_of(machine: LinearMachine) -> Drives:
    """Drives of a machine."""
    limit = machine.limits.control
    return Drives(np.inf if limit is None else limit, machine.holding, machine.model.dt)


def cascades(machine: LinearMachine) -> list[Gains]:
    """Gains of the series, from fast to slow."""
    axes = axes_of(machine.model)
    return [_loops(axes, w, c) for w, c in product(CROSSOVERS, CORNERS)]


def _loops(axes: list[TransferFunction], crossover: float, corner: float) -> dict[str, Any]:
    """Gains of one cascade of the series."""
    point, dt = np.exp(-1j * crossover), axes[0].dt
    speeds = [abs(axis.response(point) * (1 - point)) / dt for axis in axes]
    share = abs(1 + 1 / (1j * corner))
    return {
        "position": float(crossover / dt / 4),
        "velocity": 1 / (share * np.array(speeds)),
        "integral_time": float(corner * dt / crossover),
    }


def level_gains(machine: LinearMachine) -> np.ndarray:
    """(m,) control that holds a position, per metre; 0 of axes that stay where they are."""
    steady = [steady_response(machine.model, axis) for axis in range(machine.model.axes)]
    return np.array([1 / one.gain if one.kind == "position" else 0.0 for one in steady])


def _steady_control(axis: TransferFunction, level: float) -> tuple[float, float]:
    """Control per speed and per acceleration of a slow motion: P^-1 = k_0 + k_v s + k_a s^2 + ...

    The cascade's speed is that of half a sample later, which is a share of k_a.
    """
    w = np.array([1e-3, 2e-3]) / axis.dt  # [rad/s]
    s = 1j * w
    inverse = (1 / axis.response(np.exp(-s * axis.dt)) - level) / s  # k_v + k_a s
    viscous = float(np.real(inverse[0]))
    inertia = float(np.imag(inverse[1] - inverse[0]) / (w[1] - w[0]))
    return viscous, inertia - viscous * axis.dt / 2


def axes_of(model: LinearPlant) -> list[TransferFunction]:
    """Transfer function of every axis from its own control."""
    for axis in decoupled_axes(model.pattern):
        if axis.inputs != axis.outputs or len(axis.inputs) != 1:
            raise ValueError(
                "feedforward needs axes with one control each: outputs "
                f"{list(axis.outputs)} depend on controls {list(axis.inputs)}"
            )
    return [transfer_function(model, axis, axis) for axis in range(model.axes)]


MOTION = (  # what the motion needs
    Weight("inertia", "{control} per m/s^2"),
    Weight("viscous", "{control} per m/s"),
)


class SimpleLoop(LinearDesign):
    """The fastest loop of a series that keeps the margin with its feedforward."""

    @abc.abstractmethod
    def series(self) -> list[Gains]:
        """Gains of the loop, from fast to slow."""

    def fixed(self) -> Gains:
        """Gains that all loops of the series have in common."""
        # Control that holds a speed, and that of the speed's lag
        axes, levels = axes_of(self.machine.model), level_gains(self.machine)
        viscous, inertia = zip(*map(_steady_control, axes, levels), strict=True)
        return {"inertia": np.maximum(inertia, 1e-9), "viscous": np.maximum(viscous, 1e-9)}

    @staticmethod
    @abc.abstractmethod
    def loop(drives: Drives, gains: Gains) -> Controller:
        """The loop on these drives."""

    def starts(self) -> Gains:
        fixed = self.fixed()
        series = [{**gains, **fixed} for gains in self.series()]
        loop = eqx.Partial(self.loop, drives_of(self.machine))
        return series[fastest(self.machine, series, loop)]

    def build(self, weights: Gains) -> Controller:
        return self.loop(drives_of(self.machine), weights)


class ProportionalLoop(SimpleLoop):
    """Proportional position loop, fed speed and acceleration.

    It is as fast on all axes at first. A machine that takes positions is fed the position, too.
    """

    weights = (
        Weight("position", "1/s"),
        *MOTION,
        Weight("level", "{control} per m", Fixed()),
    )

    def series(self) -> list[Gains]:
        model = self.machine.model
        return [{"position": np.full(model.axes, w / model.dt)} for w in POSITION_CROSSOVERS]

    def fixed(self) -> Gains:
        levels = level_gains(self.machine)
        return super().fixed() | ({"level": levels} if levels.any() else {})

    @staticmethod
    def loop(drives: Drives, gains: Gains) -> Controller:
        names = ("position", "viscous", "inertia", "level")
        known = {name: gains[name] for name in names if name in gains}
        return PositionLoop(**known, sensors=Sensors(range(len(drives.holding))), dt=drives.dt)


class ProportionalIntegralLoop(SimpleLoop):
    """P-PI cascade fed speed, acceleration and viscous friction."""

    weights = (*LinearCascade.weights, Weight("feedforward"), *MOTION)

    def series(self) -> list[Gains]:
        return cascades(self.machine)

    def fixed(self) -> Gains:
        return {"feedforward": 1.0, **super().fixed()}

    @staticmethod
    def loop(drives: Drives, gains: Gains) -> Controller:
        return drives.cascade(gains)


def _place(machine: LinearMachine) -> float:
    return resonance(machine.model) or 2 * np.pi * USUAL / machine.model.dt


def _around(machine: LinearMachine) -> Interval:
    place = _place(machine)
    return Interval(place / 2, min(2 * place, 3.0 / machine.model.dt))


NOTCH = (
    Weight("notch", "rad/s", _around),
    Weight("depth", range=Interval(0.01, 1.0)),
    Weight("notch_damping", range=Interval(0.02, 2.0)),
)


def notched(drives: Drives, gains: Gains, loop: Controller) -> Controller:
    """The loop through a notch."""
    shape = picked("notch depth notch_damping", gains)
    inputs, holding = len(drives.holding), drives.holding
    return Filtered(loop, notch(*shape, drives.dt, prewarp=True), inputs, holding=holding)


class Notched(SimpleLoop):
    """A loop through a notch, its feedforward ahead of what the notch is late by."""

    def fixed(self) -> Gains:
        place = _place(self.machine)
        late = 2 * DAMPING * (1 - DEPTH) / place  # [s] of a slow control in the notch
        section = {"notch": place, "depth": DEPTH, "notch_damping": DAMPING}
        # Feedforward whose control passes what makes it late [s]
        fed = super().fixed()
        k_0, k_v, k_a = (fed.get(name, 0.0) for name in ORDERS)
        return (fed | {"viscous": k_v + late * k_0, "inertia": k_a + late * k_v}) | section


class NotchedProportionalLoop(Notched, ProportionalLoop):
    """Proportional position loop through a notch at the lowest resonance."""

    weights = (*ProportionalLoop.weights, *NOTCH)

    @staticmethod
    def loop(drives: Drives, gains: Gains) -> Controller:
        return notched(drives, gains, ProportionalLoop.loop(drives, gains))


class NotchedProportionalIntegralLoop(Notched, ProportionalIntegralLoop):
    """P-PI cascade with feedforward through a notch at the lowest resonance."""

    weights = (*ProportionalIntegralLoop.weights, *NOTCH)

    @staticmethod
    def loop(drives: Drives, gains: Gains) -> Controller:
        return notched(drives, gains, drives.cascade(gains))


def simple_names(machine: LinearMachine) -> list[str]:
    """Names of the simple loops that suit a machine, the simplest first.

    None where a positive control moves an axis backwards: their gains are not negative.
    """
    axes_of(machine.model)
    steady = [steady_response(machine.model, axis) for axis in range(machine.model.axes)]
    if any(one.gain < 0 for one in steady):
        return []
    kinds = {one.kind for one in steady}
    suiting = {PROPORTIONAL: {"speed", "position"}, CASCADE: {"speed", "acceleration"}}
    names = [name for name, takes in suiting.items() if kinds <= takes]
    rings = resonance(machine.model) is not None
    return [one for name in names for one in ([name, NOTCHED[name]] if rings else [name])]


def resonance(model: LinearPlant) -> float | None:
    """Frequency of the lowest pair of poles that rings [rad/s]; None without one."""
    poles = np.linalg.eigvals(np.asarray(model.A)).astype(complex)
    rates = np.log(poles[np.imag(poles) > 0]) / model.dt
    rings = rates[-np.real(rates) < RINGS * np.abs(rates)]
    return float(np.abs(rings).min()) if rings.size else None
