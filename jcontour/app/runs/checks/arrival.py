"""Whether the tool follows its motion, and has settled when a run is over.

Errors from the path alone do not tell: a tool that rests on it has none.
"""

import numpy as np

from jcontour.app.jobs.replays import Replay, Scenarios, desired, scored

RESTS = 0.05  # of the largest step of a motion: the last one, where it ends at rest
FAR = 2.0  # largest contour errors that the tool may be from the end
FOLLOWED = 0.5  # of the length of a motion, that the tool needs to move


def motions_not_followed(replay: Replay, scenarios: Scenarios) -> list[str]:
    """A line for every contour along which the tool of a plant moves less than `FOLLOWED` of it."""
    lines = []
    for c, points in enumerate(desired(scenarios)):
        count = scenarios.jobs[c].samples
        asked = _length(points[:count])
        moved = _length(replay.output[c, :, :count])
        worst = int(np.nanargmin(np.append(moved, np.inf)))
        if worst < moved.size and moved[worst] < FOLLOWED * asked:
            lines.append(
                f"the tool moves {round(1e3 * moved[worst], 6):.4g} of {1e3 * asked:.4g} mm "
                f"({scenarios.jobs[c].name}, {scenarios.plants[worst]}): it does not follow"
            )
    return lines


def _length(points: np.ndarray) -> np.ndarray:
    """Length of motions, (..., time, axis), from sample to sample [m]."""
    with np.errstate(over="ignore", invalid="ignore"):  # of runs that diverge
        return np.linalg.norm(np.diff(points, axis=-2), axis=-1).sum(axis=-1)


def arrival_warnings(replay: Replay, scenarios: Scenarios) -> list[str]:
    """A line for the contour at whose last sample the tool is farthest from its end.

    There is one where that is more than `FAR` of the largest contour errors that were scored, of a
    motion that ends at rest in a cut: the tool has not settled then.
    """
    lost = np.asarray(replay.metrics.diverged)
    peaks = np.asarray(replay.metrics.peak_contour_error)
    told = []
    for c, (job, points, counted) in enumerate(
        zip(scenarios.jobs, desired(scenarios), scored(scenarios), strict=True)
    ):
        steps = np.linalg.norm(np.diff(points[: job.samples], axis=0), axis=1)
        last = job.steps - 1
        if not counted[last] or steps[-1:].sum() > RESTS * steps.max(initial=0.0):
            continue
        apart = np.linalg.norm(replay.output[c, :, last] - points[last], axis=1)
        apart = np.where(lost[c], 0.0, apart)
        worst = int(np.argmax(apart))
        if apart[worst] > FAR * np.where(lost[c], 0.0, peaks[c]).max():
            told.append((float(apart[worst]), job.name, scenarios.plants[worst]))
    if not told:
        return []
    distance, name, plant = max(told)
    return [
        f"when the run is over the tool is still {1e6 * distance:.4g} um from its end ({name}, "
        f"{plant}): the loop is slow, or swings; what follows is not scored"
    ]
