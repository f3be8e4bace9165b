"""Simple loops of a drive: proportional or P-PI, fed what the motion needs, a notch or none.

A proportional loop suits a drive that takes a speed or a position, P-PI one that takes a speed or a
force. A notch stands at the lowest resonance of the machine, the same on all axes: axes that are
filtered alike stay together.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from jcontour.app.designs.feedforward import (
    axes_of,
    cascade,
    cascade_units,
    cascades,
    fastest,
    gain_design,
    level_gains,
    motion_gains,
)
from jcontour.app.designs.gains import Gain, GainDesign, Gains
from jcontour.app.flags.shared import Controlled
from jcontour.app.machines.linear import LinearMachine
from jcontour.app.machines.steady_response import steady_response
from jcontour.controller import Controller
from jcontour.controllers.feedback.position_loop import PositionLoop
from jcontour.controllers.wrappers.filters import Filtered, notch
from jcontour.linear.plant import LinearPlant
from jcontour.sensors import Sensors
from tuning.parameters import Fixed, Interval

PROPORTIONAL, CASCADE = "position-loop", "linear-cascade-feedforward"  # without a notch
NOTCHED = {PROPORTIONAL: "position-loop-notch", CASCADE: "linear-cascade-notch"}
ORDERS = ("level", "viscous", "inertia")  # control per position, speed, acceleration
POSITION_CROSSOVERS = np.geomspace(0.5, 3e-4, 32)  # [rad per sample] from fast to slow
RINGS = 0.3  # damping below which a pair of poles is a resonance
USUAL = 0.1  # of the sampling rate: where a notch begins on a machine without one
DEPTH, DAMPING = 0.2, 0.2  # of a notch that bears a resonance 5 % off: it allows 3 times the gain


class Loop(NamedTuple):
    """A simple loop on one machine.

    Attributes:
        series: gains of the loops, from fast to slow.
        units: of these.
        fed: gains of the feedforward, and of the notch.
        build: makes the controller of both.
    """

    series: list[Gains]
    units: dict[str, str]
    fed: dict[str, Gain]
    build: Callable[[Gains], Controller]


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


def proportional(machine: LinearMachine) -> Loop:
    """A proportional position loop, as fast on all axes at first."""
    model, sensors = machine.model, Sensors(range(machine.model.axes))
    series = [{"position": np.full(model.axes, w / model.dt)} for w in POSITION_CROSSOVERS]
    fed = motion_gains(machine)
    levels = level_gains(machine)
    if levels.any():
        fed["level"] = Gain(levels, f"{machine.control_unit}/m", Fixed())

    def build(gains: Gains) -> Controller:
        names = ("position", "viscous", "inertia", "level")
        known = {name: gains[name] for name in names if name in gains}
        return PositionLoop(**known, sensors=sensors, dt=model.dt)

    return Loop(series, {"position": "1/s"}, fed, build)


def proportional_integral(machine: LinearMachine) -> Loop:
    """A P-PI cascade."""
    fed = {"feedforward": Gain(1.0, ""), **motion_gains(machine)}
    return Loop(
        cascades(machine), cascade_units(machine), fed, lambda gains: cascade(machine, gains)
    )


def notched(make: Callable[[LinearMachine], Loop]) -> Callable[[LinearMachine], Loop]:
    """The loop through a notch."""

    def loop(machine: LinearMachine) -> Loop:
        inner, dt = make(machine), machine.model.dt
        place = resonance(machine.model) or 2 * np.pi * USUAL / dt
        late = 2 * DAMPING * (1 - DEPTH) / place  # [s] of a slow control in the notch
        section = {
            "notch": Gain(place, "rad/s", Interval(place / 2, min(2 * place, 3.0 / dt))),
            "depth": Gain(DEPTH, "", Interval(0.01, 1.0)),
            "notch_damping": Gain(DAMPING, "", Interval(0.02, 2.0)),
        }

        def build(gains: Gains) -> Controller:
            filter = notch(gains["notch"], gains["depth"], gains["notch_damping"], dt, prewarp=True)
            inputs, holding = machine.model.inputs, machine.holding
            return Filtered(
                controller=inner.build(gains), filter=filter, inputs=inputs, holding=holding
            )

        return inner._replace(fed={**_ahead(inner.fed, late), **section}, build=build)

    return loop


def _ahead(fed: dict[str, Gain], late: float) -> dict[str, Gain]:
    """Feedforward whose control passes what makes it late [s].

    (k_0 + k_v s + k_a s^2) (1 + late s), to the second order.
    """
    k_0, k_v, k_a = (fed[name].start if name in fed else 0.0 for name in ORDERS)
    moved = {"viscous": k_v + late * k_0, "inertia": k_a + late * k_v}
    return fed | {name: fed[name]._replace(start=start) for name, start in moved.items()}


def simple_design(
    make: Callable[[LinearMachine], Loop],
) -> Callable[[str, str, LinearMachine, Controlled], GainDesign]:
    """Maker of a design from a simple loop."""

    def design(name: str, line: str, machine: LinearMachine, flags: Controlled) -> GainDesign:
        loop = make(machine)
        fed = {key: gain.start for key, gain in loop.fed.items()}
        first = fastest(machine, loop.series, lambda gains: loop.build({**fed, **gains}))
        gains = {key: Gain(first[key], unit) for key, unit in loop.units.items()} | loop.fed
        return gain_design(name, line, machine, gains, loop.build)

    return design
