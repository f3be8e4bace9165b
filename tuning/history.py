"""Points that were evaluated, and the most promising start of the next descent."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from tuning.outcome import Outcome

FEASIBLE = 1e-6  # a limit may be exceeded by this relative amount
# ln(objective) that an excess of one costs, where no multiplier is known yet
PRICE = 5.0
# distance in ln(error, error, increment) from every descent so far that makes a start worth while
NEW_BEHAVIOUR = 0.5


class Evaluated(NamedTuple):
    """One row of the history: a point that was tried, and its outcome."""

    start: int  # number of the descent; -1 for a scattered point
    z: np.ndarray
    objective: float
    violation: float  # largest limit, ln(value / limit); -inf without limits
    outcome: Outcome
    diverged: bool


def sound(history: Sequence[Evaluated]) -> list[Evaluated]:
    """Points that did not diverge."""
    return [row for row in history if not row.diverged]


def rank(row: Evaluated) -> tuple[float, float]:
    """Order of points: the least violation first, and of the feasible ones the least objective."""
    return max(row.violation, FEASIBLE), row.objective


def next_start(
    history: Sequence[Evaluated], prices: Float[np.ndarray, " n"]
) -> Float[np.ndarray, " d"] | None:
    """The most promising scattered point whose loop behaves unlike all descents so far, or None.

    Its promise is ln(objective) + price * violation. Where nothing is feasible yet, the least
    violation comes first; where everything diverged, the least departure from the contours.

    Args:
        history: every point so far.
        prices: sum of the multipliers at the end of every descent; the largest counts.
    """
    tried = {row.z.tobytes() for row in history if row.start >= 0}
    left = [row for row in history if row.start < 0 and row.z.tobytes() not in tried]
    rows = sound(history)
    if not rows:
        return min(left, key=_departure).z if left else None
    seen = np.array([_behaviour(row) for row in rows if row.start >= 0])
    new = [row for row in sound(left) if _apart(_behaviour(row), seen)]
    if not new:
        return None
    if all(row.violation > FEASIBLE for row in rows):
        return min(new, key=rank).z
    price = float(np.max(prices, initial=PRICE))
    return min(new, key=lambda row: _promise(row, price)).z


def _behaviour(row: Evaluated) -> np.ndarray:
    """Logarithms of the mean errors and increment of the loop.

    Weights that look different may behave alike, as all tiny betas do.
    """
    metrics = row.outcome.metrics
    measures = (metrics.rms_contour_error, metrics.rms_tracking_error, metrics.rms_increment)
    return np.log([max(float(np.mean(measure)), 1e-300) for measure in measures])


def _apart(behaviour: np.ndarray, seen: np.ndarray) -> bool:
    return len(seen) == 0 or bool(np.min(np.linalg.norm(seen - behaviour, axis=1)) > NEW_BEHAVIOUR)


def _promise(row: Evaluated, price: float) -> float:
    return np.log(max(row.objective, 1e-300)) + price * max(row.violation, 0.0)


def _departure(row: Evaluated) -> float:
    largest = float(np.max(row.outcome.metrics.peak_tracking_error))
    return largest if np.isfinite(largest) else np.inf
