"""Programs whose record shows what a tuner needs to know of a machine's axes.

As CSV: random-phase multisines, periodic in `PERIOD`, on a slow move that keeps friction and
backlash on one side, for two realisations at each of three levels: a gap stays closed in small
ones, noise hides them. Each section runs one period for the transient and `KEPT` more. From these
the best linear approximation and its total variance follow
(Pintelon & Schoukens, System Identification, 2nd ed., section 4.3). No two axes share a frequency:
coupling is then distinct from an axis's own answer. All lines have the same speed up to a corner,
and the same acceleration above it. Then moves at steady speeds, each half of the one before, for
friction that depends on the speed, and strokes to and fro, as a part has them, for dry friction and
backlash. As G-code: moves to and fro that get shorter, each axis by itself and then all together.
The speed stays within half of its limit, positions within 35 % of the travel either side of the
start; the acceleration of the CSV within half of its limit, that of the G-code is the control's.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from jaxtyping import Float, Int
from pydantic import Field

from jcontour.app.files.checks import METRES, MachineError
from jcontour.app.files.schema import (
    OneOrEach,
    Positive,
    Schema,
    Text,
    Unit,
    axis_names,
    per_axis,
    read,
)

SHARE = 0.5  # of the limits
PART = 0.35  # of the travel, either side of the start
PERIOD = 2.0  # [s] of the multisines
KEPT = 3  # periods of a section beside that of its transient
LEVELS = (1.0, 0.3, 0.1)  # of the multisines
REALISATIONS = 2
DRAWN = 50  # phases of which those with the lowest peak are taken
CORNERS = 30  # between the lowest line and the highest
APART = 0.02  # of its frequency: between a line and the next at least
ONE_SIDED = 0.8  # of the slow move: speed of a multisine at most
HIGHEST, OF_RATE = 150.0, 0.2  # [Hz], or of the sampling rate: highest line
EASE = 0.5  # [s] in which the slow move turns, at least
TURNS = 0.5  # of the acceleration: at most for that
FASTER = 4.0  # times its speed: on the way to where it begins, if that is allowed
CREEPS, LEG = 6, 1.5  # slow speeds, each half of the one before; [s] of a move to or fro
STROKES = (1.0, 0.5, 0.2)  # of the travel that is used
SEED = 1  # of the phases
DIGITS = 12  # of a position [m]: sums of a move there and back leave less
SLOWEST = 0.05  # sample period [s] that leaves each axis a few lines
SHORTEST = 0.05e-3  # move [m]
RATIO = 0.7  # of a move over the one before
REPEATS = 3
LETTERS = "XYZABCUVW"  # that move an axis


@dataclass(frozen=True)
class Excited:
    """What the limits of a machine allow."""

    axes: tuple[str, ...]  # names
    dt: float  # sample period of the CSV [s]
    travel: Float[np.ndarray, " axes"]  # by axis [m], [m/s], [m/s^2]
    speed: Float[np.ndarray, " axes"]
    acceleration: Float[np.ndarray, " axes"]


class LimitsFile(Schema):
    """Limits of the machine, as a user writes them."""

    travel: OneOrEach[Positive]
    """[length]"""
    speed: OneOrEach[Positive]
    """[length/s]"""
    acceleration: OneOrEach[Positive]
    """[length/s^2]"""
    axes: Annotated[list[Text], Field(min_length=2, max_length=3)] = ["X", "Y"]
    """names of two or three axes"""
    length_unit: Unit = "mm"
    """of the limits"""
    dt: Annotated[Positive, Field(le=SLOWEST)] = 1e-3
    """sample period of the CSV [s]; the multisines need one below the limit"""


def read_limits(path: Path | str, fields: Any) -> Excited:
    """Limits of a JSON object: travel, speed, acceleration, each one number or one per axis.

    Raises:
        MachineError: a field is missing, unknown or impossible.
    """
    try:
        file = read(LimitsFile, fields)
        metre, names = METRES[file.length_unit], axis_names(file.axes, len(file.axes))
        each = [
            per_axis(name, getattr(file, name), len(names)) * metre
            for name in ("travel", "speed", "acceleration")
        ]
    except MachineError as error:
        raise MachineError(f"{path}: {error}") from None
    return Excited(names, file.dt, *each)


def program(limits: Excited) -> Float[np.ndarray, "T axes"]:
    """Positions of the CSV [m]: from rest at zero and back to it."""
    columns = []
    for k in range(len(limits.axes)):
        most = (
            PART * limits.travel[k],
            SHARE * limits.speed[k],
            SHARE * limits.acceleration[k],
        )
        columns.append(np.concatenate([_sections(limits, k, most), _strokes(limits.dt, most)]))
    longest = max(map(len, columns))
    padded = [np.pad(one, (1, longest - len(one))) for one in columns]
    return np.round(np.stack(padded, axis=1), DIGITS)


def _sections(
    limits: Excited, axis: int, most: tuple[float, float, float]
) -> Float[np.ndarray, " T"]:
    """Multisines of an axis on its slow move, from one end to the other and back; then creeping."""
    rows = round(PERIOD / limits.dt)
    time = limits.dt * np.arange((1 + KEPT) * rows)
    length = (1 + KEPT) * PERIOD
    slow = min(2 * most[0] / length, most[1] / 2, TURNS * most[2] * PERIOD / 4 / (1 + FASTER))
    faster = min(FASTER * slow, most[1])
    ease = max(EASE, 2 * (slow + faster) / (TURNS * most[2]))  # a bell is twice its mean
    w = 2 * np.pi * _lines(limits)[axis] / PERIOD
    random = np.random.default_rng([SEED, axis])
    phases = random.uniform(0, 2 * np.pi, (DRAWN, len(w)))
    allowed = _allowed(time[:rows], w, phases, (ONE_SIDED * slow, most[2]))
    levels = np.repeat(LEVELS, REALISATIONS)
    realisations = sorted(allowed, key=lambda one: -float(np.var(one)))  # none twice: no period
    shaken = [
        level * np.tile(one, 1 + KEPT) for level, one in zip(levels, realisations, strict=False)
    ]
    speeds = [way * np.full(len(time), slow) for way in np.resize([1.0, -1.0], len(shaken))]
    # to one end, and from it back
    there = np.full(round(len(time) * slow / 2 / faster), faster)
    back = there * (-1) ** len(shaken)
    slower = np.minimum(most[1] * 0.5 ** np.arange(1, CREEPS + 1), most[0] / LEG)
    creeps = np.repeat(np.outer(slower, [1.0, -1.0]).ravel(), round(LEG / limits.dt))
    window = np.hanning(round(ease / limits.dt) + 2)[1:-1]
    speed = np.convolve(np.concatenate([-there, *speeds, back, creeps]), window / window.sum())
    part = np.clip(time / ease, 0.0, 1.0)
    grown = part**3 * (10 - 15 * part + 6 * part**2)  # without a jump of the acceleration
    before = [np.zeros(len(time)), *shaken]
    turned = [one + grown * (two - one) for one, two in pairwise(before)]
    turned[-1] = turned[-1] * grown[::-1]
    waves = np.concatenate(turned)
    waves = np.pad(waves, (len(there), len(speed) - len(there) - len(waves)))
    used, shaking = np.abs(np.diff(speed)) / limits.dt, np.abs(np.diff(waves, 2)) / limits.dt**2
    room = (most[2] - used[1:]) / np.maximum(shaking, 1e-9 * most[2])  # beside the turns
    return limits.dt * np.cumsum(speed) + min(float(room.min()), 1.0) * waves


def _allowed(
    time: Float[np.ndarray, " N"],
    w: Float[np.ndarray, " L"],
    phases: Float[np.ndarray, "D L"],
    most: tuple[float, float],
) -> Float[np.ndarray, "D N"]:
    """Multisines of as much speed and acceleration as is allowed.

    All lines have one speed up to a corner and one acceleration above it; it is where both limits
    are reached.
    """
    angles = np.outer(time, w) + phases[:, None]
    sines, dt = np.sin(angles), time[1] - time[0]
    found = []
    for corner in np.geomspace(w[0], w[-1], CORNERS):
        waves = sines @ (1 / (w * np.hypot(1, w / corner)))
        around = np.concatenate([waves, waves[:, :2]], axis=1)
        fastest, hardest = (np.abs(np.diff(around, k)).max(axis=1) / dt**k for k in (1, 2))
        speed, acceleration = fastest / most[0], hardest / most[1]
        apart = abs(np.log(np.median(speed) / np.median(acceleration)))
        found.append((apart, waves / np.maximum(speed, acceleration)[:, None]))
    return min(found, key=lambda one: one[0])[1]


def _lines(limits: Excited) -> list[Int[np.ndarray, " L"]]:
    """Periods of each axis's lines in that of the multisine: each, or `APART` for every axis.

    Neighbouring lines go to the axes in random order: in any other, parts of the period repeat.
    """
    count = len(limits.axes)
    lines, highest = [1], min(HIGHEST, OF_RATE / limits.dt) * PERIOD
    while lines[-1] < highest:
        lines.append(lines[-1] + max(1, round(APART * lines[-1] / count)))
    groups = np.tile(np.arange(count), (len(lines) // count + 1, 1))
    owner = np.random.default_rng(SEED).permuted(groups, axis=1).ravel()[: len(lines)]
    return [np.array(lines)[owner == k] for k in range(count)]


def _strokes(dt: float, most: tuple[float, float, float]) -> Float[np.ndarray, " T"]:
    """Moves to and fro, twice each length, at the speed and the acceleration of the limits [m]."""
    speeds = []
    for share in STROKES:
        length = share * most[0]
        top = min(most[1], np.sqrt(length * most[2]))
        ramp = int(np.ceil(top / most[2] / dt)) + 1
        flat = max(round((length / top - top / most[2]) / dt), 0)
        up = np.concatenate([np.linspace(0, 1, ramp + 1), np.ones(flat)])
        once = np.concatenate([up, up[::-1]])
        once *= length / (dt * once.sum())
        speeds += 2 * [once, -once, -once, once]
    return dt * np.cumsum(np.concatenate(speeds))


def strokes(limits: Excited, axis: int) -> list[float]:
    """Lengths of the moves to and fro of an axis [m], the longest first."""
    longest = PART * float(limits.travel[axis])
    count = max(int(np.log(SHORTEST / longest) / np.log(RATIO)), 0) + 1
    return [longest * RATIO**k for k in range(count)]


def letters(limits: Excited) -> tuple[str, ...]:
    """Letters that move the axes in G-code: their names, or X, Y, Z in their order.

    Names are taken where each is a letter that moves an axis: X2 or Table would be another word.
    """
    names = tuple(name.upper() for name in limits.axes)
    if len(set(names)) == len(names) and all(len(one) == 1 and one in LETTERS for one in names):
        return names
    return tuple(LETTERS[: len(names)])


def gcode(limits: Excited) -> str:
    """The moves as a program: relative, in millimetres, at half of each axis's speed."""
    moved = letters(limits)
    lines = [
        "; moves to and fro that show what the axes do: record commands and positions meanwhile",
        "; start in the middle of the travel, with nothing in the way",
        "G21 G91",
    ]
    for k, (name, letter) in enumerate(zip(limits.axes, moved, strict=True)):
        lines.append(f"; {name} alone")
        lines += _moves([letter], strokes(limits, k), SHARE * float(limits.speed[k]))
    slowest = SHARE * float(limits.speed.min())
    shared = min((strokes(limits, k) for k in range(len(limits.axes))), key=len)
    lines.append("; all axes")
    lines += _moves(moved, shared, slowest)
    return "\n".join([*lines, "G90", "M2", ""])


def _moves(axes: Sequence[str], lengths: Sequence[float], speed: float) -> list[str]:
    lines = []
    for length in lengths:
        for _ in range(REPEATS):
            for way in (1, -1, -1, 1):
                words = " ".join(f"{letter}{1e3 * way * length:.4f}" for letter in axes)
                lines.append(f"G1 {words} F{6e4 * speed:.1f}")
    return lines
