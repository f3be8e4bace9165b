"""A streaming law as a component of LinuxCNC, and its machine as another: no hardware is needed.

The motion module gives a command for every joint and servo period. The law follows it as many
periods late as it sees ahead, one more for its queue.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.optimize import root_scalar

from jcontour.export.rendering import Code
from jcontour.export.streaming_law import Vector
from jcontour.linear.plant import LinearPlant, spectral_radius
from jcontour.plant import Plant, Wrapper

LETTERS = "XYZABCUVW"
TOOLS = 99  # without length or diameter: programs that change tools run
CALM = 1.0 + 1e-9  # spectral radius of a loop that does not grow
STEADY = 20_000  # samples after which a constant control gives a constant speed
SHORTEST = 5e-5  # [s] of a servo period: 20 kHz
DRIVE = "./drive.py"  # in place of a display: it runs a program and keeps the samples


@dataclass(frozen=True)
class Joint:
    """Limits of a joint in the units of LinuxCNC: mm, s."""

    axis: str
    speed: float
    acceleration: float
    following: float


@dataclass(frozen=True)
class StockPid:
    """Gains of LinuxCNC's `pid`: control per mm, mm s and mm/s; per mm and mm/s of the command."""

    limit: float
    P: float = 0.0
    I: float = 0.0  # noqa: E741  the field's letter
    D: float = 0.0
    FF0: float = 0.0
    FF1: float = 0.0


def stock_pids(model: LinearPlant, limit: Vector) -> list[StockPid]:
    """Loops of LinuxCNC's `pid` on the model, axis by axis.

    P is raised until the loop oscillates; the rest is by Ziegler and Nichols, P = 0.6 K_u,
    I = 1.2 K_u / T_u, D = 0.075 K_u T_u. FF1 is the control of a steady speed. A drive that takes a
    position gets the command alone: FF0 is the control of a place.

    Raises:
        ValueError: an axis has no control of its own, or does not oscillate at any gain.
    """
    A, B, C = (np.asarray(one, float) for one in (model.A, model.B, model.C))
    if B.shape[1] != len(C):
        raise ValueError("linuxcnc: a PID needs one control for each axis")
    pids = []
    for b, c, most in zip(B.T, C, map(float, limit), strict=True):
        pushed = np.block([[A, b[:, None]], [np.zeros((1, len(A))), np.ones((1, 1))]])
        x = np.linalg.matrix_power(pushed, STEADY)[:-1, -1]  # by a control of one
        place, speed = 1e3 * float(c @ x), 1e3 * float(c @ (A @ x + b - x)) / model.dt
        if STEADY * model.dt * abs(speed) < abs(place) / 2:
            pids.append(StockPid(most, FF0=1.0 / place))
            continue
        fed, gains = np.outer(b, c), np.geomspace(1.0, 1e12, 240)
        lost = np.flatnonzero(spectral_radius(A - gains[:, None, None] * fed) > CALM)
        if not lost[:1].any():
            raise ValueError("linuxcnc: a loop of P alone never oscillates, it cannot be tuned so")
        around = gains[lost[0] - 1], gains[lost[0]]
        edge = root_scalar(lambda g, k=fed: spectral_radius(A - g * k) - CALM, bracket=around).root
        values = np.linalg.eigvals(A - edge * fed)
        ultimate, turned = 1e-3 * edge, np.abs(np.angle(values[np.abs(values).argmax()]))
        period = 2.0 * np.pi * model.dt / turned
        gains = 0.6 * ultimate, 1.2 * ultimate / period, 0.075 * ultimate * period
        pids.append(StockPid(most, *map(float, gains), FF1=1.0 / speed))
    return pids


def linuxcnc_files(
    code: Code,
    machine: Plant,
    count: Vector,
    axes: Sequence[str],
    acceleration: Vector,
    title: str,
    display: str = "axis",
    pids: Sequence["StockPid"] = (),
) -> Mapping[str, str]:
    """Name and text of every file.

    Args:
        code: law and limits.
        machine: linear model, with friction where it has some; its state is measured.
        count: of every encoder [m].
        axes: letters of the axes, each a joint.
        acceleration: of every axis [m/s^2].
        title: for people.
        display: what LinuxCNC shows; `DRIVE` runs program.ngc and keeps its samples.
        pids: LinuxCNC's own loops in place of the law, to compare with.

    Raises:
        ValueError: LinuxCNC cannot run it; the message says why.
    """
    code = replace(code, precision="double")  # HAL's own
    law, nanoseconds = code.law, round(1e9 * code.law.dt)
    if law.dt < SHORTEST:
        raise ValueError(
            f"linuxcnc: the sample of {1e6 * law.dt:g} us is shorter than a servo period can be, "
            f"{1e6 * SHORTEST:g} us; describe the machine at a longer one"
        )
    if [one for one in axes if one not in LETTERS] or len(set(axes)) < len(axes):
        raise ValueError(
            f"linuxcnc: joints have to be axes of the letters {LETTERS}, one encoder each; "
            f"received {', '.join(axes)}"
        )
    if law.measured != law.axes or not np.array_equal(law.places, np.eye(law.axes)):
        raise ValueError(
            f"linuxcnc: needs an encoder for each of the {law.axes} axes, the law measures "
            f"{law.measured} numbers; run a controller that measures positions"
        )
    safe = code.limits
    joints = [
        Joint(axis, *(float(f"{1e3 * one:.6g}") for one in numbers))
        for axis, *numbers in zip(axes, safe.speed, acceleration, safe.following, strict=True)
    ]
    if "Z" not in axes:  # programs lift the tool
        joints.append(replace(joints[0], axis="Z"))
    more: dict[str, Any] = {
        "title": title,
        "axes": list(axes),
        "joints": joints,
        "nanoseconds": nanoseconds,
        "display": display,
        "pids": pids,
        "sampled": display == DRIVE,
        **_model(machine, count),
    }
    names = {
        "jcontour_law.comp": "law.comp.j2",
        "jcontour_machine.comp": "machine.comp.j2",
        "loop.hal": "loop.hal.j2",
        "machine.ini": "machine.ini.j2",
        "README.md": "README.md.j2",
    }
    if display == DRIVE:
        names["drive.py"] = "drive.py.j2"
    texts = {name: code.text(f"linuxcnc/{one}", **more) for name, one in names.items()}
    texts["tool.tbl"] = "".join(f"T{k} P{k}\n" for k in range(1, TOOLS + 1))
    return texts | {name: code.text(f"{name}.j2") for name in ("law.h", "law.c")}


def _model(machine: Plant, count: Vector) -> dict[str, Any]:
    """Matrices of the machine; friction of zero where it has none."""
    terms: dict[str, Any] = {}
    while isinstance(machine, Wrapper) and machine.force_terms:
        terms, machine = machine.force_terms | terms, machine.plant
    if not isinstance(machine, LinearPlant):
        raise ValueError(f"linuxcnc: needs a linear machine, received {type(machine).__name__}")
    m, n = machine.C.shape
    shapes = {"ENTRY": (n, m), "SPEED": (m, n), "TRAVEL": (m, n)}
    held, slides = ("STICKING", "STIFFNESS", "KEPT"), ("SHARPNESS", "FRICTION", "STRIBECK")
    shapes |= dict.fromkeys((*held, *slides, "SOFTENING"), (m,))
    model = {"A": machine.A, "B": machine.B, "C": machine.C}
    none = {name: np.zeros(shape) for name, shape in shapes.items()}
    matrices = {k: np.asarray(one, float) for k, one in (model | none | terms).items()}
    return matrices | {"matrices": [*matrices.items(), ("COUNT", count)]}
