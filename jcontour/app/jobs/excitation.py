"""Programs whose record shows what a tuner needs to know of a machine's axes.

As CSV: two sums of sines over each axis, of frequencies that no other axis has: coupling is then
told from an axis's own answer. A slow one moves the axis to and fro. A quick one of small waves
shakes it up to where resonances are: it has most of the acceleration, as beside a resonance nothing
else tells a delay. The slow one is small too, because what drives leave unexplained grows with the
motion. The phases keep the peaks low (Schroeder, IEEE Trans. Information Theory 16, 1970).
As G-code: moves to and fro that get shorter, each axis by itself and
then all together; their corners shake the axis up to frequencies that no smooth contour reaches.
The speed stays within half of its limit, positions within a tenth of the travel either side of the
start; the acceleration of the CSV within half of its limit, that of the G-code is the control's.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from jaxtyping import Float
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
PART = 0.1  # of the travel, either side of the start
SECONDS = 30.0  # of the sines
EASE = 1.0  # [s] at the start and at the end in which they grow and fade
LOWEST, QUICK, HIGHEST = 0.3, 5.0, 120.0  # [Hz]: slow sines, quick ones, and their end
SLOW_LINES = 12  # frequencies of each axis
SPACING = 1.0  # [Hz] between the quick frequencies of an axis
SLOWEST = 0.05  # sample period [s] that leaves enough samples, and each axis a quick frequency
SLOW_SHARE = 0.1  # of the sines' part of the limits; the quick ones have the rest
SHORTEST = 0.05e-3  # move [m]
RATIO = 0.7  # of a move over the one before
REPEATS = 3
LETTERS = "XYZABCUVW"  # that move an axis


@dataclass(frozen=True)
class Excited:
    """What the limits of a machine allow.

    Attributes:
        axes: names.
        dt: sample period of the CSV [s].
        travel, speed, acceleration: by axis [m], [m/s], [m/s^2].
    """

    axes: tuple[str, ...]
    dt: float
    travel: Float[np.ndarray, " axes"]
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
    """sample period of the CSV [s]; the quick sines need one below the limit"""


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


def sines(limits: Excited) -> Float[np.ndarray, "T axes"]:
    """Positions of the CSV [m]: from rest at zero and back to it.

    Slow sines are as large as their share of travel, speed and acceleration allows each. Quick ones
    have all the same speed: their waves are the smaller the quicker they are. Either sum is then
    scaled until its own largest values are within its part of the limits.
    """
    time = limits.dt * np.arange(int(round(SECONDS / limits.dt)) + 1)
    count = len(limits.axes)
    highest = min(HIGHEST, 0.2 / limits.dt)
    quickest = min(QUICK, highest / 2)
    slow = np.unique(np.round(np.geomspace(LOWEST, quickest, SLOW_LINES * count) * SECONDS))
    slow = slow[slow < quickest * SECONDS]  # there the quick ones begin
    quick = np.arange(quickest, highest, SPACING / count)
    columns = []
    for k in range(count):
        most = (
            PART * limits.travel[k],
            SHARE * limits.speed[k],
            SHARE * limits.acceleration[k],
        )
        w = 2 * np.pi * slow[k::count] / SECONDS  # whole periods
        sizes = np.minimum(np.minimum(most[0], most[1] / w), most[2] / w**2)
        low = _within(most, limits.dt, _summed(time, w, sizes))
        w = 2 * np.pi * quick[k::count]
        high = _within(most, limits.dt, _summed(time, w, 1 / w))
        columns.append(SLOW_SHARE * low + (1 - SLOW_SHARE) * high)
    return np.stack(columns, axis=1)


def _summed(
    time: Float[np.ndarray, " T"], w: Float[np.ndarray, " n"], sizes: Float[np.ndarray, " n"]
) -> Float[np.ndarray, " T"]:
    """Sines of frequencies w [rad/s] that grow at the start and fade at the end.

    The phases are Schroeder's, phi_k = -2 pi sum_{j<k} (k - j) p_j, for the powers p_j of the
    accelerations.
    """
    powers = (sizes * w**2) ** 2
    before = np.cumsum(powers / powers.sum())[:-1]
    phases = -2 * np.pi * np.concatenate([[0.0], np.cumsum(before)])
    ease = np.clip(np.minimum(time, time[-1] - time) / EASE, 0.0, 1.0)
    ease = ease**3 * (10 - 15 * ease + 6 * ease**2)
    waves = (a * np.sin(b * time + c) for a, b, c in zip(sizes, w, phases, strict=True))
    return ease * sum(waves)


def _within(
    most: Sequence[float], dt: float, signal: Float[np.ndarray, " T"]
) -> Float[np.ndarray, " T"]:
    """The signal as large as travel, speed and acceleration allow."""
    used = [np.abs(np.diff(signal, order)).max() / dt**order for order in range(3)]
    return signal / max(one / limit for one, limit in zip(used, most, strict=True))


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
