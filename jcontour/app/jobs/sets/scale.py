"""Size, feed and place of the runs that a machine makes: what other runs are made like."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from jcontour.app.jobs.job import Job
from jcontour.app.jobs.sets.stretches import angle_between, corner_angles
from jcontour.motion.references import along

CHORD_SAMPLES = 10  # at the feed: what a loop passes quicker is a corner or rounding of the file
LEAST_CHORDS = 24  # of a run: short ones are still seen to turn


class Scale(NamedTuple):
    """Sizes that runs have in common.

    Attributes:
        radius: length of path [m] for each radian that it turns: that of a circle is its radius,
            that of a square 0.64 of its side.
        half_diagonal: of the bounding box [m].
        feed: speed along the path [m/s].
        low: least middle of a run's bounding box, axis by axis [m].
        high: greatest one.
    """

    radius: float
    half_diagonal: float
    feed: float
    low: Float[np.ndarray, " m"]
    high: Float[np.ndarray, " m"]


def scale_of(jobs: Sequence[Job], dt: float) -> Scale:
    """Medians over runs at this sample period [s]; only what is scored counts, no rapid move.

    What a loop feels of a curve is v^2 over its radius, so the radius is found from the length and
    from all turns, those at corners included: it is the same for a curve and for the many short
    lines that stand for it. Turns are those of chords of ten samples, so that the rounding of a
    file counts as little as the loop feels it. A path that hardly turns has its half diagonal for
    radius: nothing made like it is larger than it.

    The feed is the speed that half of the way is made at or above: the programmed one, where moves
    are long enough to reach it.
    """
    runs = [_Run.of(job, dt) for job in jobs]
    middles = np.array([run.middle for run in runs])
    return Scale(
        radius=float(np.median([run.radius for run in runs])),
        half_diagonal=float(np.median([run.half_diagonal for run in runs])),
        feed=float(np.median([run.feed for run in runs])),
        low=middles.min(axis=0),
        high=middles.max(axis=0),
    )


def sharpest_corner(job: Job) -> float:
    """Greatest change of direction [rad] between two pieces, both of them scored."""
    turned = corner_angles(job.contour)
    if job.at_rest:
        corner = np.asarray(job.contour.start)[1:]  # a closed contour's last one is not passed
        sample = np.searchsorted(job.arc, corner)
        turned = turned[: corner.size][job.scored[sample - 1] & job.scored[sample]]
    return float(np.max(turned, initial=0.0))


class _Run(NamedTuple):
    """The same of a single run."""

    radius: float
    half_diagonal: float
    feed: float
    middle: Float[np.ndarray, " m"]

    @classmethod
    def of(cls, job: Job, dt: float) -> "_Run":
        feed = _feed(job, dt)
        way = job.arc[job.scored]
        chord = min(CHORD_SAMPLES * feed * dt, float(np.ptp(way)) / LEAST_CHORDS)
        arc = np.arange(way[0], way[-1], chord)
        # Whether the run is scored where it comes to every arc length [m]
        sample = np.searchsorted(job.arc, arc)
        counts = job.scored[np.minimum(sample, job.samples - 1)]
        points = np.asarray(along(job.contour, arc, dt, 0, at_rest=True).position)
        chords, both = np.diff(points, axis=0), counts[:-1] & counts[1:]
        between = both[:-1] & both[1:]
        turned = np.sum(angle_between(chords[:-1], chords[1:])[between])
        low, high = points[counts].min(axis=0), points[counts].max(axis=0)
        half_diagonal = 0.5 * float(np.linalg.norm(high - low))
        length = chord * np.count_nonzero(between)
        radius = min(half_diagonal, length / turned) if turned > 0 else half_diagonal
        return cls(float(radius), half_diagonal, feed, 0.5 * (low + high))


def _feed(job: Job, dt: float) -> float:
    """Speed [m/s] at or above which half of the scored way is made."""
    step = np.diff(job.arc)[job.scored[1:] & job.scored[:-1]]
    step = np.sort(step)[::-1]
    way = np.cumsum(step)
    return float(step[np.searchsorted(way, 0.5 * way[-1])]) / dt
