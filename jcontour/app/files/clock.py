"""Times of samples: their unit, one period, and where it is kept."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
USUAL = 1e-3  # [s] between samples of a drive's record
SLOWEST = 0.1  # [s] likewise, at most
JITTER = 0.01  # of a period, by which a sample may be early or late
MOST_JITTER = 0.5  # likewise, of stamps that are interpolated to even ones
# part without gap or restart that is worth going on with: of a record, or samples
LEAST_PART, LEAST_ROWS = 0.25, 5000


@dataclass(frozen=True)
class EvenPart:
    """The longest part of a record without a gap."""

    dt: float  # mean sample period [s]
    rows: slice  # that belong to it
    words: str  # about the rest and about jitter; empty where there is neither


def likely_unit(time: Float[np.ndarray, " T"]) -> str:
    """Unit of times whose column does not say it: seconds unless the samples are too far apart.

    >>> likely_unit(np.arange(3) * 400.0)
    'us'
    """
    step = float(np.median(np.diff(time))) if len(time) > 1 else 0.0
    if step <= SLOWEST * (1 + JITTER):
        return "s"
    return min(("ms", "us", "ns"), key=lambda unit: abs(np.log(step * SECONDS[unit] / USUAL)))


def longest_even_part(time: Float[np.ndarray, " T"]) -> EvenPart:
    """Longest part of times [s] without a gap and without a restart of the clock.

    Its steps may jitter by `MOST_JITTER` of a period: it is for `resampled`.
    """
    usual, odd = _odd_steps(time)
    edges = np.concatenate([[0], odd + 1, [len(time)]])
    longest = int(np.argmax(np.diff(edges)))
    start, end = int(edges[longest]), int(edges[longest + 1])
    if end - start < max(min(LEAST_PART * len(time), LEAST_ROWS), 3):
        before, after = time[odd[0]], time[odd[0] + 1]
        raise ValueError(
            f"samples are not evenly spaced: after {before:g} s comes {after:g} s, the others are "
            f"{usual:g} s apart; there are {odd.size} such places, and the "
            f"longest part without, {time[start]:g} s to {time[end - 1]:g} s, has {end - start} of "
            f"{len(time)} samples: keep that part alone, or let the drive record by its own clock"
        )
    part = time[start:end]
    dt, words = float((part[-1] - part[0]) / (len(part) - 1)), []
    if odd.size:
        restarts = int((np.diff(time)[odd] <= 0).sum())
        words.append(
            f"{odd.size - restarts} gaps and {restarts} restarts of the clock, the first after "
            f"{time[odd[0]]:g} s; used is the longest part without, {part[0]:g} s to {part[-1]:g} s"
        )
    jitter = float(np.abs(np.diff(part) / dt - 1).max())
    if jitter > JITTER:
        words.append(
            f"steps between stamps differ from {1e3 * dt:.4g} ms by up to {100 * jitter:.2g} %; "
            "the signals are interpolated to even times"
        )
    return EvenPart(dt, slice(start, end), f"time: {'; '.join(words)}" if words else "")


def resampled(
    time: Float[np.ndarray, " T"], dt: float, signals: Float[np.ndarray, "T s"]
) -> Float[np.ndarray, "T s"]:
    """Signals at even times, by lines between their samples where the stamps jitter."""
    if np.abs(np.diff(time) / dt - 1).max() <= JITTER:
        return signals
    even = time[0] + dt * np.arange(len(time))
    return np.stack([np.interp(even, time, one) for one in signals.T], axis=1)


def _odd_steps(time: Float[np.ndarray, " T"]) -> tuple[float, Int[np.ndarray, " k"]]:
    """Usual step [s], and the samples after which another one comes."""
    if len(time) < 3:
        raise ValueError(f"needs at least three samples, has {len(time)}")
    steps = np.diff(time)
    usual = float(np.median(steps))
    if not usual > 0:
        raise ValueError("the column time has to grow, as seconds do")
    return usual, np.flatnonzero(~(np.abs(steps - usual) <= MOST_JITTER * usual))
