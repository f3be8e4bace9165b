"""Stretches that represent a long program while it is tuned; the whole of it is tried afterwards.

A program is looked at in overlapping windows. Each has features: how much the path turns in all and
at most, how fast it goes, how hard it accelerates, and in which directions. The window with the
hardest acceleration comes first, then always the one that differs most from those before. A stretch
is entered in motion, and its entry is not scored.
"""

import numpy as np
from jaxtyping import Float

from jcontour.app.jobs.entry import ENTRY, behind_entry
from jcontour.app.jobs.job import Job, Task
from jcontour.app.jobs.sets.stretches import between
from jcontour.motion.references import along

LONG = 10_000  # samples of a program that is tuned by stretches
WINDOW = 1000  # samples of a stretch
COUNT = 8  # stretches of a program
MARGIN = 20  # samples of path beyond both ends, for preview and errors along the path


def representatives(task: Task, dt: float) -> list[Task]:
    """Stretches of a long program, in its order; the task itself where it is not long.

    Args:
        task: what is run.
        dt: sample period [s].
    """
    if not isinstance(task, Job) or task.samples <= LONG:
        return [task]
    starts = np.arange(0, task.samples - WINDOW - MARGIN, WINDOW // 2)
    scored = np.array([task.scored[a + ENTRY : a + WINDOW].any() for a in starts])
    moving = np.array([task.arc[a + WINDOW] > task.arc[a] for a in starts])
    starts = starts[scored & moving]
    if starts.size == 0:
        return [task]
    # Features of the windows, each divided by its largest
    reference = along(task.contour, task.arc, dt, 0, task.at_rest)
    tangent, arc = np.asarray(reference.tangent), task.arc
    speed = np.diff(arc, append=arc[-1]) / dt
    velocity = speed[:, None] * tangent
    acceleration = np.linalg.norm(np.diff(velocity, axis=0, append=velocity[-1:]), axis=1) / dt
    turned = np.linalg.norm(np.diff(tangent, axis=0, append=tangent[-1:]), axis=1)
    rows = starts[:, None] + np.arange(WINDOW)
    direction = tangent[rows]
    outer = np.mean(direction[..., :, None] * direction[..., None, :], axis=1)
    columns = [
        np.sqrt(np.mean(acceleration[rows] ** 2, axis=1)),
        np.log1p(np.sum(turned[rows], axis=1)),
        np.max(turned[rows], axis=1),
        np.mean(speed[rows], axis=1),
        *outer.reshape(starts.size, -1).T,
    ]
    features = np.stack(columns, axis=1)
    chosen = starts[_spread(features / np.maximum(np.max(np.abs(features), axis=0), 1e-300), COUNT)]
    return [_stretch(task, int(a), k + 1) for k, a in enumerate(np.sort(chosen))]


def _stretch(job: Job, first: int, number: int) -> Job:
    """Samples first ... first + WINDOW - 1 of a job as a job of its own."""
    last = first + WINDOW - 1
    low = float(job.arc[max(first - MARGIN, 0)])
    high = float(job.arc[min(last + MARGIN, job.samples - 1)])
    return job._replace(
        name=f"{job.name} {number}",
        contour=between(job.contour, low, high),
        arc=job.arc[first : last + 1] - low,
        scored=job.scored[first : last + 1] & behind_entry(WINDOW),
        at_rest=False,
        program=None,
        aside=job.aside and job.aside.some(slice(first, last + 1)),
        planned=None,
        settling=0,
    )


def _spread(features: Float[np.ndarray, "w f"], count: int) -> list[int]:
    """Hardest acceleration first, then the rows that are farthest from all before."""
    chosen = [int(np.argmax(features[:, 0]))]
    distance = np.linalg.norm(features - features[chosen[0]], axis=1)
    while len(chosen) < min(count, len(features)) and distance.max() > 0:
        chosen.append(int(np.argmax(distance)))
        away = np.linalg.norm(features - features[chosen[-1]], axis=1)
        distance = np.minimum(distance, away)
    return chosen
