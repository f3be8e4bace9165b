"""Step responses as CSV: columns time [s], control, position; by name or in this order."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from experiments.files.checks import METRES

NAMES = ("time", "control", "position")
MOST_BYTES = 64 * 2**20
JITTER = 0.01  # of a sample: more is no even sampling


class StepRecord(NamedTuple):
    """A record of one axis.

    Attributes:
        dt: sample period [s].
        control: [control unit].
        position: [m].
    """

    dt: float
    control: Float[np.ndarray, " T"]
    position: Float[np.ndarray, " T"]


def read_step(path: Path, unit: str) -> StepRecord:
    """Record of a CSV file whose positions are in a unit: m, mm or um.

    Raises:
        ValueError: the file cannot be read, a column is missing or no number, or the samples are
            not evenly spaced.
    """
    try:
        if path.stat().st_size > MOST_BYTES:
            raise ValueError(f"{path}: needs at most {MOST_BYTES} bytes")
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise ValueError(f"{path}: cannot be read as text ({error})") from None
    lines = [line.replace(";", ",") for line in text.splitlines() if line.strip()]
    if not lines:
        raise ValueError(f"{path}: is empty")
    named = not _is_number(lines[0].split(",")[0])
    heads = [word.strip().lower() for word in lines[0].split(",")] if named else list(NAMES)
    missing = [name for name in NAMES if name not in heads]
    if missing:
        raise ValueError(
            f"{path}: has no column {missing[0]!r}; needs {', '.join(NAMES)}, "
            f"has {', '.join(heads)}"
        )
    try:
        rows = np.array([[float(x) for x in line.split(",")] for line in lines[named:]])
        time, control, position = (rows[:, heads.index(name)] for name in NAMES)
    except (ValueError, IndexError):
        raise ValueError(f"{path}: a line does not hold {len(heads)} numbers") from None
    return StepRecord(_period(path, time), control, METRES[unit] * position)


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def _period(path: Path, time: np.ndarray) -> float:
    """Sample period [s].

    Raises:
        ValueError: time stands still, runs backwards or jumps; the first place is named.
    """
    if len(time) < 3:
        raise ValueError(f"{path}: needs at least three samples, has {len(time)}")
    steps = np.diff(time)
    period = float(np.median(steps))
    if not period > 0:
        raise ValueError(f"{path}: the column time has to grow, as seconds do")
    off = np.flatnonzero(~(np.abs(steps - period) <= JITTER * period))
    if off.size:
        raise ValueError(
            f"{path}: samples are not evenly spaced: after {time[off[0]]:g} s comes "
            f"{time[off[0] + 1]:g} s, the others are {period:g} s apart"
        )
    return float((time[-1] - time[0]) / (len(time) - 1))
