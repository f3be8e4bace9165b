"""Times of samples: their unit, one period, and where it is kept."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
USUAL = 1e-3  # [s] between samples of a drive's record
SLOWEST = 0.1  # [s] likewise, at most
JITTER = 0.01  # of a period, by which a sample may be early or late
RARE = 0.1  # of all steps: fewer odd ones are gaps, more are a clock that jitters
LEAST_PART = 0.25  # of a record without gap or restart that is worth going on with


@dataclass(frozen=True)
class EvenPart:
    """The longest evenly sampled part of a record.

    Attributes:
        dt: sample period [s].
        rows: that belong to it.
        words: about the rest; empty where there is none.
    """

    dt: float
    rows: slice
    words: str


def likely_unit(time: Float[np.ndarray, " T"]) -> str:
    """Unit of times whose column does not say it: seconds unless the samples are too far apart.

    >>> likely_unit(np.arange(3) * 400.0)
    'us'
    """
    step = float(np.median(np.diff(time))) if len(time) > 1 else 0.0
    if step <= SLOWEST * (1 + JITTER):
        return "s"
    return min(("ms", "us", "ns"), key=lambda unit: abs(np.log(step * SECONDS[unit] / USUAL)))


def even_period(time: Float[np.ndarray, " T"]) -> float:
    """Sample period of times [s] that are evenly spaced all along.

    Raises:
        ValueError: fewer than three samples, time does not grow, or it jitters or has a gap; the
            first place is named.
    """
    usual, odd = _odd_steps(time)
    if odd.size:
        raise ValueError(_uneven(time, usual, int(odd[0])))
    return _mean_step(time)


def longest_even_part(time: Float[np.ndarray, " T"]) -> EvenPart:
    """Longest part of times [s] without a gap and without a restart of the clock.

    Raises:
        ValueError: as `even_period`, but gaps and restarts are no fault while a quarter of the
            record has none.
    """
    usual, odd = _odd_steps(time)
    if not odd.size:
        return EvenPart(_mean_step(time), slice(0, len(time)), "")
    edges = np.concatenate([[0], odd + 1, [len(time)]])
    longest = int(np.argmax(np.diff(edges)))
    start, end = int(edges[longest]), int(edges[longest + 1])
    if end - start < max(LEAST_PART * len(time), 3):
        words = f"{_uneven(time, usual, int(odd[0]))}; there are {odd.size} such places"
        if odd.size < RARE * len(time):
            words += (
                f", and the longest part without, {time[start]:g} s to {time[end - 1]:g} s, has "
                f"{end - start} of {len(time)} samples: keep that part alone, or"
            )
        else:
            words += ":"
        words += " let the drive record by its own clock"
        if odd.size >= RARE * len(time):
            words += (
                ". If only the stamps jitter, and the drive samples evenly without a gap, leave "
                "out the column of time and give --period-ms"
            )
        raise ValueError(words)
    restarts = int((np.diff(time)[odd] <= 0).sum())
    words = (
        f"time: {odd.size - restarts} gaps and {restarts} restarts of the clock, the first after "
        f"{time[odd[0]]:g} s; used is the longest part without, "
        f"{time[start]:g} s to {time[end - 1]:g} s"
    )
    return EvenPart(_mean_step(time[start:end]), slice(start, end), words)


def _odd_steps(time: Float[np.ndarray, " T"]) -> tuple[float, Int[np.ndarray, " k"]]:
    """Usual step [s], and the samples after which another one comes."""
    if len(time) < 3:
        raise ValueError(f"needs at least three samples, has {len(time)}")
    steps = np.diff(time)
    usual = float(np.median(steps))
    if not usual > 0:
        raise ValueError("the column time has to grow, as seconds do")
    return usual, np.flatnonzero(~(np.abs(steps - usual) <= JITTER * usual))


def _mean_step(time: Float[np.ndarray, " T"]) -> float:
    return float((time[-1] - time[0]) / (len(time) - 1))


def _uneven(time: Float[np.ndarray, " T"], usual: float, first: int) -> str:
    return (
        f"samples are not evenly spaced: after {time[first]:g} s comes {time[first + 1]:g} s, "
        f"the others are {usual:g} s apart"
    )
