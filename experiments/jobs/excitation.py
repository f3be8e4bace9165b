"""Programs whose record shows what a tuner needs to know of a machine's axes.

As CSV: a sum of sines over each axis, of frequencies that no other axis has (coupling is then told
from an axis's own answer) and of phases at which they seldom meet (Schroeder, IEEE Trans.
Information Theory 16, 1970). As G-code: moves to and fro that get shorter, each axis by itself and
then all together; their corners shake the axis up to frequencies that no smooth contour reaches.
The speed stays within half of its limit, positions within a tenth of the travel either side of the
start; the acceleration of the CSV within half of its limit, that of the G-code is the control's.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from experiments.files import checks

FIELDS = {"axes", "travel", "speed", "acceleration", "length_unit", "dt"}
SHARE = 0.5  # of the limits
PART = 0.1  # of the travel, either side of the start
SECONDS = 30.0  # of the sines
EASE = 1.0  # [s] at the start and at the end in which they grow and fade
LOWEST, HIGHEST = 0.3, 120.0  # frequencies [Hz]; the acceleration decides how much of them is seen
LINES = 40  # frequencies of each axis
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


def read_limits(path: Path | str, fields: Any) -> Excited:
    """Limits of a JSON object: travel, speed, acceleration, each one number or one per axis.

    Raises:
        MachineError: a field is missing, unknown or impossible.
    """
    given = checks.mapping(str(path), fields, FIELDS)
    for name in ("travel", "speed", "acceleration"):
        if name not in given:
            raise checks.MachineError(
                f"{path}: {name} is missing; needs travel, speed, "
                "acceleration, and may have axes, length_unit, dt"
            )
    unit = given.get("length_unit", "mm")
    if not isinstance(unit, str) or unit not in checks.METRES:
        raise checks.MachineError(f"length_unit: needs one of {', '.join(checks.METRES)}")
    asked = given.get("axes", ["X", "Y"])
    if not isinstance(asked, list) or len(asked) not in (2, 3):
        raise checks.MachineError("axes: needs a list of two or three names")
    metre, count = checks.METRES[unit], len(asked)

    def each(name: str) -> np.ndarray:
        return checks.per_axis(name, given[name], count) * metre

    dt = checks.number("dt", given.get("dt", 1e-3), above=0.0)
    names = tuple(checks.axis_names(asked, count))
    return Excited(names, dt, each("travel"), each("speed"), each("acceleration"))


def sines(limits: Excited) -> Float[np.ndarray, "T axes"]:
    """Positions of the CSV [m]: from rest at zero and back to it.

    Every sine is as large as its share of travel, speed and acceleration allows; the sum is then
    scaled until the sum's own largest speed and acceleration are within theirs.
    """
    time = limits.dt * np.arange(int(round(SECONDS / limits.dt)) + 1)
    ease = np.clip(np.minimum(time, SECONDS - time) / EASE, 0.0, 1.0)
    ease = ease**3 * (10 - 15 * ease + 6 * ease**2)
    count = len(limits.axes)
    highest = min(HIGHEST, 0.2 / limits.dt)
    raw = np.geomspace(LOWEST, highest, LINES * count)
    lines = np.unique(np.round(raw * SECONDS)) / SECONDS  # whole periods
    columns = []
    for k in range(count):
        w = 2 * np.pi * lines[k::count]
        reach, v, a = (
            share * one[k]
            for share, one in (
                (PART, limits.travel),
                (SHARE, limits.speed),
                (SHARE, limits.acceleration),
            )
        )
        size = np.minimum(np.minimum(reach, v / w), a / w**2)
        number = np.arange(len(w))
        phase = -np.pi * number * (number - 1) / len(w)
        signal = ease * np.sum(size * np.sin(w * time[:, None] + phase), axis=1)
        speed = np.diff(signal) / limits.dt
        most = (
            np.abs(signal).max() / reach,
            np.abs(speed).max() / v,
            np.abs(np.diff(speed)).max() / limits.dt / a,
        )
        columns.append(signal / max(most))
    return np.stack(columns, axis=1)


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
