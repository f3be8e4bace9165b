"""Gains of a simple loop as products name them: parameter, unit, and its value from SI gains.

A cascade is u = k_v (k_p e + f v_r - v) + k_v / T_n times the integral of the bracket, plus k_0 r +
k_1 v_r + k_2 a_r; a loop without a velocity gain is u = k_1 (k_p e + v_r) + k_0 r + k_2 a_r. A PID
controller on the position error that does the same has these terms sorted by e, v_r and a_r.
"""

import inspect
from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

from jcontour.app.files.results.stored import Weight
from jcontour.app.flags.others import Drive

FULL = 1.0  # velocity feedforward of a loop that does not name it


class Parameter(NamedTuple):
    """A parameter of a product; where the gains of its value are missing the next of its name."""

    name: str
    unit: str  # {control}: unit of the machine's commands; {turn}: see `TURN`
    value: Callable[..., np.ndarray]  # of SI gains by their names


GENERAL = (
    Parameter("position gain", "1/s", lambda position: position),
    Parameter("velocity gain", "{control} per m/s", lambda velocity: velocity),
    Parameter("integral time", "ms", lambda integral_time: 1e3 * integral_time),
    Parameter("velocity feedforward", "%", lambda feedforward: 100.0 * feedforward),
    Parameter("acceleration feedforward", "{control} per m/s^2", lambda inertia: inertia),
    Parameter("speed feedforward", "{control} per m/s", lambda viscous: viscous),
    Parameter("position feedforward", "{control} per m", lambda level: level),
    Parameter("notch", "Hz", lambda notch: 0.5 / np.pi * notch),
    Parameter("notch depth", "", lambda depth: depth),
    Parameter("notch damping", "", lambda notch_damping: notch_damping),
)
LINUXCNC = (  # pins of the HAL component `pid`, machine units of 1 mm
    # the error of the present command: by default it is that of the command before
    Parameter("error-previous-target", "", lambda position: 0 * position),
    Parameter(
        "Pgain",
        "{control} per mm",
        lambda velocity, position, integral_time: 1e-3 * velocity * (position + 1 / integral_time),
    ),
    Parameter("Pgain", "{control} per mm", lambda viscous, position: 1e-3 * viscous * position),
    Parameter(
        "Igain",
        "{control} per mm s",
        lambda velocity, position, integral_time: 1e-3 * velocity * position / integral_time,
    ),
    Parameter("Dgain", "{control} per mm/s", lambda velocity: 1e-3 * velocity),
    Parameter(
        "FF0",
        "{control} per mm",
        lambda velocity, integral_time, feedforward: (
            1e-3 * (feedforward - 1) * velocity / integral_time
        ),
    ),
    Parameter("FF0", "{control} per mm", lambda level: 1e-3 * level),
    Parameter(
        "FF1",
        "{control} per mm/s",
        lambda viscous, velocity, feedforward: 1e-3 * (viscous + (feedforward - 1) * velocity),
    ),
    Parameter("FF1", "{control} per mm/s", lambda viscous: 1e-3 * viscous),
    Parameter("FF2", "{control} per mm/s^2", lambda inertia: 1e-3 * inertia),
)
SIEMENS = (  # SINUMERIK machine data, SINAMICS parameters
    Parameter("MD32200 POSCTRL_GAIN", "1000/min", lambda position: 0.06 * position),
    Parameter("MD32610 VELO_FFW_WEIGHT", "", lambda feedforward=FULL: feedforward),
    Parameter(
        "p1460 speed controller P gain",
        "{control} per m/s; times {turn}/(2 pi): Nms/rad",
        lambda velocity: velocity,
    ),
    Parameter("p1462 integral time", "ms", lambda integral_time: 1e3 * integral_time),
    Parameter("p1658, p1660 filter frequency", "Hz", lambda notch: 0.5 / np.pi * notch),
    Parameter("p1659 denominator damping", "", lambda notch_damping: notch_damping),
    Parameter("p1661 numerator damping", "", lambda notch_damping, depth: depth * notch_damping),
)
BECKHOFF = (  # AX5000
    Parameter("S-0-0104 position loop Kv", "1000/min", lambda position: 0.06 * position),
    Parameter("S-0-0296 velocity feedforward", "%", lambda feedforward=FULL: 100 * feedforward),
    Parameter(
        "S-0-0100 velocity loop gain",
        "{control} per m/s; times {turn}/(2 pi): Nm/(rad/s), with bit 15 of P-0-0010",
        lambda velocity: velocity,
    ),
    Parameter("S-0-0101 integral time", "ms", lambda integral_time: 1e3 * integral_time),
)
ODRIVE = (  # axis.controller.config
    Parameter("pos_gain", "(turn/s)/turn", lambda position: position),
    Parameter(
        "vel_gain", "{control} per m/s; times {turn}: Nm/(turn/s)", lambda velocity: velocity
    ),
    Parameter(
        "vel_integrator_gain",
        "{control} per m; times {turn}: Nm/turn",
        lambda velocity, integral_time: velocity / integral_time,
    ),
    Parameter(
        "inertia", "{control} per m/s^2; times {turn}: Nm/(turn/s^2)", lambda inertia: inertia
    ),
)
PRODUCTS: dict[Drive, tuple[Parameter, ...]] = {
    "general": GENERAL,
    "linuxcnc-pid": LINUXCNC,
    "siemens": SIEMENS,
    "beckhoff": BECKHOFF,
    "odrive": ODRIVE,
}
# {turn}, by the unit of the commands: torque per (turn/s) that is one command unit per (m/s)
TURN = {"N": "lead^2/(2 pi)", "Nm": "lead"}
LEAD = "lead: travel of the axis in one turn of the motor [m]"
PER_MINUTE = 60.0  # (mm/min)/mm in 1/s
TERMS = frozenset(name for one in GENERAL for name in inspect.signature(one.value).parameters)


def drive_gains(
    weights: Mapping[str, Weight | np.ndarray], control_unit: str, drive: Drive = "general"
) -> list[str]:
    """Gains of a simple loop in the parameters of a product, a line each.

    Gains that the product has no parameter for are named in a last line.

    Args:
        weights: by name, one number or one for each axis, SI.
        control_unit: of the machine.
        drive: a product; the general terms give the position gain in (mm/min)/mm as well.
    """
    known = {name: np.ravel(v).astype(float) for name, v in weights.items() if v is not None}
    if drive == "general" and np.all(known.get("feedforward", FULL) == FULL):
        known.pop("feedforward", None)  # the usual one
    turn = TURN.get(control_unit, f"lead (Nm per {control_unit})")
    lines, used, named = [], set[str](), set[str]()
    for name, unit, value in PRODUCTS[drive]:
        needed = inspect.signature(value).parameters.values()
        there = {one.name for one in needed} & known.keys()
        missing = [one for one in needed if one.name not in known and one.default is one.empty]
        if missing or name in named:
            continue
        used, named = used | there, named | {name}
        numbers = np.ravel(value(**{one: known[one] for one in there}))
        line = f"{name} {_each(numbers)} {unit.format(control=control_unit, turn=turn)}".rstrip()
        if name == "position gain":
            line += f" ({_each(PER_MINUTE * numbers)} mm/min per mm)"
        lines.append(line)
    if any("lead" in line for line in lines):
        lines.append(LEAD)
    if known.keys() <= used:
        return lines
    left = drive_gains({one: known[one] for one in known if one not in used}, control_unit)
    return [*lines, *([f"without a parameter: {', '.join(left)}"] if left else [])]


def _each(numbers: np.ndarray) -> str:
    numbers = numbers[:1] if np.all(numbers == numbers[0]) else numbers
    return ", ".join(f"{one:.4g}" for one in numbers)
