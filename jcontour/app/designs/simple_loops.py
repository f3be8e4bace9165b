"""Simple loops of a drive: proportional or P-PI, fed what the motion needs, a notch or none.

A proportional loop suits a drive that takes a speed or a position, P-PI one that takes a speed or a
force. A notch stands at the lowest resonance of the machine, the same on all axes: axes that are
filtered alike stay together.
"""

import abc

import numpy as np

from jcontour.app.designs.design import Gains, LinearDesign, picked
from jcontour.app.designs.feedforward import (
    LinearCascade,
    axes_of,
    cascade,
    cascades,
    level_gains,
    motion_gains,
)
from jcontour.app.designs.lq.first_loop import fastest
from jcontour.app.machines.linear import LinearMachine
from jcontour.app.machines.steady_response import steady_response
from jcontour.controller import Controller
from jcontour.controllers.feedback.cascade import PositionLoop
from jcontour.controllers.wrappers.filters import Filtered, notch
from jcontour.linear.plant import LinearPlant
from jcontour.sensors import Sensors
from tuning.parameters import Fixed, Interval, Weight

PROPORTIONAL, CASCADE = "position-loop", "linear-cascade-feedforward"  # without a notch
NOTCHED = {PROPORTIONAL: "position-loop-notch", CASCADE: "linear-cascade-notch"}
ORDERS = ("level", "viscous", "inertia")  # control per position, speed, acceleration
POSITION_CROSSOVERS = np.geomspace(0.5, 3e-4, 32)  # [rad per sample] from fast to slow
RINGS = 0.3  # damping below which a pair of poles is a resonance
USUAL = 0.1  # of the sampling rate: where a notch begins on a machine without one
DEPTH, DAMPING = 0.2, 0.2  # of a notch that bears a resonance 5 % off: it allows 3 times the gain

MOTION = (  # what the motion needs
    Weight("inertia", "{control} s^2/m"),
    Weight("viscous", "{control} s/m"),
)


class SimpleLoop(LinearDesign):
    """The fastest loop of a series that keeps the margin with its feedforward."""

    @abc.abstractmethod
    def series(self) -> list[Gains]:
        """Gains of the loop, from fast to slow."""

    def fixed(self) -> Gains:
        """Gains that all loops of the series have in common."""
        return motion_gains(self.machine)

    def starts(self) -> Gains:
        fixed, series = self.fixed(), self.series()
        found = fastest(self.machine, series, lambda gains: self.build({**fixed, **gains}))
        return {**series[found], **fixed}


class ProportionalLoop(SimpleLoop):
    """Proportional position loop, fed speed and acceleration.

    It is as fast on all axes at first. A machine that takes positions is fed the position, too.
    """

    weights = (
        Weight("position", "1/s"),
        *MOTION,
        Weight("level", "{control}/m", Fixed()),
    )

    def series(self) -> list[Gains]:
        model = self.machine.model
        return [{"position": np.full(model.axes, w / model.dt)} for w in POSITION_CROSSOVERS]

    def fixed(self) -> Gains:
        levels = level_gains(self.machine)
        return super().fixed() | ({"level": levels} if levels.any() else {})

    def build(self, weights: Gains) -> Controller:
        names = ("position", "viscous", "inertia", "level")
        known = {name: weights[name] for name in names if name in weights}
        model = self.machine.model
        return PositionLoop(**known, sensors=Sensors(range(model.axes)), dt=model.dt)


class ProportionalIntegralLoop(SimpleLoop):
    """P-PI cascade fed speed, acceleration and viscous friction."""

    weights = (*LinearCascade.weights, Weight("feedforward"), *MOTION)

    def series(self) -> list[Gains]:
        return cascades(self.machine)

    def fixed(self) -> Gains:
        return {"feedforward": 1.0, **super().fixed()}

    def build(self, weights: Gains) -> Controller:
        return cascade(self.machine, weights)


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

    def build(self, weights: Gains) -> Controller:
        shape, machine = picked("notch depth notch_damping", weights), self.machine
        return Filtered(
            controller=super().build(weights),
            filter=notch(*shape, machine.model.dt, prewarp=True),
            inputs=machine.model.inputs,
            holding=machine.holding,
        )


class NotchedProportionalLoop(Notched, ProportionalLoop):
    """Proportional position loop through a notch at the lowest resonance."""

    weights = (*ProportionalLoop.weights, *NOTCH)


class NotchedProportionalIntegralLoop(Notched, ProportionalIntegralLoop):
    """P-PI cascade with feedforward through a notch at the lowest resonance."""

    weights = (*ProportionalIntegralLoop.weights, *NOTCH)


def simple_names(machine: LinearMachine) -> list[str]:
    """Names of the simple loops that suit a machine, the simplest first.

    None where a positive control moves an axis backwards: their gains are not negative.

    Raises:
        ValueError: the axes are coupled, or axis i is not driven by control i.
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
