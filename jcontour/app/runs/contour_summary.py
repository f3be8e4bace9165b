"""Summary of a contour as it was read, and the place of the largest error of its runs."""

import numpy as np

from jcontour.app.files.results.run_metrics import ContourRead, PeakPlace
from jcontour.app.jobs.job import Job, Task
from jcontour.app.jobs.replays import Replay, Scenarios, desired, scored
from jcontour.geometry.outlines import outline
from jcontour.motion.jerk_limited.joints import unpadded


def contour_read(scenarios: Scenarios, index: int) -> ContourRead:
    """Size of a contour and of the run along it."""
    return read_of(scenarios.jobs[index], scenarios.references.dt)


def read_of(job: Task, dt: float) -> ContourRead:
    """Size of a contour and of the run along it in samples of a period [s].

    The box is that of the contour as programmed: the motion may leave it in blended corners.
    """
    way, entry = _way(job)
    box = outline(job.contour)
    return ContourRead(
        pieces=int(np.sum(job.contour.mask)),
        length=float(job.contour.length),
        duration=_duration(job, dt),
        low=tuple(box.min(axis=0).tolist()),
        high=tuple(box.max(axis=0).tolist()),
        ignored=job.ignored,
        doubts=job.doubts,
        stops=job.stops,
        rapid_length=rapid_length(job),
        way=way,
        entry=entry,
    )


def _way(job: Task) -> tuple[float | None, float]:
    """How far a run at constant feed goes along its path, and where its entry ends [m].

    Both are whole laps where they are so to within a sample.
    """
    if not isinstance(job, Job) or job.at_rest:
        return None, 0.0
    arc, length = job.arc - job.arc[0], float(job.contour.length)
    ways = np.array([arc[-1], arc[np.argmax(job.scored)]])
    laps = np.rint(ways / length) * length
    ways = np.where((laps > 0) & (np.abs(ways - laps) <= arc[1]), laps, ways)
    return float(ways[0]), float(ways[1])


def cycle_time(job: Task, dt: float) -> float:
    """Time of a run [s]; of one lap where it goes around its path more than once."""
    laps = np.ptp(job.arc) / float(job.contour.length) if isinstance(job, Job) else 1.0
    return _duration(job, dt) / max(1.0, float(laps))


def _duration(job: Task, dt: float) -> float:
    """Time of a run [s]: that of its planned motion, else from its first sample to its last."""
    if isinstance(job, Job) and job.planned is not None:
        return job.planned.duration
    return float((job.samples - 1) * dt)


def rapid_length(job: Task) -> float:
    """Length of the rapid moves of a run [m]."""
    if not isinstance(job, Job):
        return 0.0
    return float(unpadded(job.contour).extent[job.rapid].sum())


def peak_place(scenarios: Scenarios, replay: Replay, index: int, error: str) -> PeakPlace | None:
    """Place of the largest error over all plants that follow the contour; None where none does.

    `error` is the one that counts, "contour" or "tracking".
    """
    path = desired(scenarios)[index]
    vectors = replay.contour_error[index]
    if error == "tracking":
        vectors = replay.output[index] - path
    size = np.linalg.norm(vectors, axis=-1)  # (plant, time)
    lost = np.asarray(replay.metrics.diverged)[index]
    size = np.where(scored(scenarios)[index] & ~lost[:, None], size, -1.0)
    plant, sample = np.unravel_index(np.argmax(size), size.shape)
    if size[plant, sample] < 0:
        return None
    return PeakPlace(
        plant=scenarios.plants[plant],
        error=float(size[plant, sample]),
        time=float(sample * scenarios.references.dt),
        position=tuple(path[sample].tolist()),
        line=scenarios.jobs[index].line_at(int(sample)),
    )
