"""Where the motor slides, and the smooth windows under which its forces are balanced.

Accelerations are second differences of positions, which encoder counts make useless one by one: a
count of 1 um is 1 m/s^2 at 1 kHz. Under a smooth window of 60 ms it is 1 mm/s^2. A longer window
hides vibrations, a shorter one lets the noise of the accelerations bias the masses.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from numpy.lib.stride_tricks import sliding_window_view

from tuning.identification.flexible_axis.records import Record

SLOWEST = 5e-3  # [m/s] of what counts as sliding: below it stick cannot be told from slip
WINDOW = 0.06  # [s] passes vibrations up to 15 Hz
STEPS = 4  # rows in the length of a window: more say the same again


class Slide(NamedTuple):
    """One uninterrupted slide in one direction, in R windows of n samples.

    Attributes:
        record: name of the test.
        time: of the middle of every window since the record began (R,) [s].
        direction: -1 or 1.
        position: x_m in every window (R, n) [m].
        speed: smoothed (R, n) [m/s].
        weights: of the samples of a window (n,).
        inertia: weighted mean of a_m (R,) [m/s^2].
        whip: of a_e - a_m (R,), or None without an end effector.
        drag: of v (R,) [m/s].
        current: of i_q (R,) [A].
    """

    record: str
    time: Float[np.ndarray, " R"]
    direction: float
    position: Float[np.ndarray, "R n"]
    speed: Float[np.ndarray, "R n"]
    weights: Float[np.ndarray, " n"]
    inertia: Float[np.ndarray, " R"]
    whip: Float[np.ndarray, " R"] | None
    drag: Float[np.ndarray, " R"]
    current: Float[np.ndarray, " R"]


def slides(record: Record, window: float = WINDOW) -> Iterator[Slide]:
    """All of a record that are longer than two windows [s]."""
    size = max(round(window / record.dt), 2) | 1  # odd: a window has a middle
    if record.rows < 3 * size:
        return
    weights = np.hanning(size + 2)[1:-1] ** 2
    weights /= weights.sum()
    drag = (record.motor[2:] - record.motor[:-2]) / (2 * record.dt)
    speed = np.convolve(drag, weights, "same")
    acceleration = _second_difference(record.motor, record.dt)
    whip = (
        None if record.tool is None else _second_difference(record.tool, record.dt) - acceleration
    )
    current = (
        record.current[:-2] + record.current[1:-1]
    ) / 2  # held from row to row: its mean under the triangle of a second difference

    def windows(samples: Float[np.ndarray, " T"]) -> Float[np.ndarray, "R n"]:
        return sliding_window_view(samples, size)[:: max(size // STEPS, 1)]

    for direction, part in _runs(np.sign(speed) * (np.abs(speed) > SLOWEST), size // 2):
        if part.stop - part.start < size:
            continue
        position = windows(record.motor[1:-1][part])
        time = record.dt * (
            1 + part.start + (size - 1) / 2 + max(size // STEPS, 1) * np.arange(len(position))
        )
        mean = {
            name: windows(values[part]) @ weights
            for name, values in {"inertia": acceleration, "drag": drag, "current": current}.items()
        }
        whipped = None if whip is None else windows(whip[part]) @ weights
        yield Slide(
            record.name,
            time,
            direction,
            position,
            windows(speed[part]),
            weights,
            whip=whipped,
            **mean,
        )


def _runs(direction: Float[np.ndarray, " T"], margin: int) -> Iterator[tuple[float, slice]]:
    """Runs of one sign without `margin` samples at either end.

    There the smoothed speed sees beyond the run.
    """
    ends = np.concatenate([[0], np.flatnonzero(np.diff(direction)) + 1, [len(direction)]])
    for a, b in zip(ends[:-1], ends[1:], strict=True):
        if direction[a] != 0 and b - a > 2 * margin:
            yield float(direction[a]), slice(a + margin, b - margin)


def _second_difference(position: Float[np.ndarray, " T"], dt: float) -> Float[np.ndarray, " T-2"]:
    """(x(k-1) - 2 x(k) + x(k+1)) / dt^2.

    This is exactly the mean of the acceleration under a triangle from k-1 to k+1.
    """
    return (position[2:] - 2 * position[1:-1] + position[:-2]) / dt**2
