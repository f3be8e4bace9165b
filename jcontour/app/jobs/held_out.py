"""Held-out contours in the size and feed of a user's own parts.

The tuner never sees them: they say whether tuned weights are good for more than the part.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Complex, Float

from jcontour.app.jobs.job import Job, Pace, at_constant_feed, from_rest_to_rest
from jcontour.app.jobs.stretches import (
    angle_between,
    beginning,
    corner_angles,
    curve_feed,
    moved,
    shortened,
)
from jcontour.geometry.contour import Contour
from jcontour.geometry.contours import arc, chain, circle, ellipse, lemniscate, line
from jcontour.motion.references import along

CONTOURS = 4  # that share the samples
LEAST_SAMPLES = 150  # of one of them, or too little is seen
MOST_SAMPLES = 1000  # of one of them: more says no more about a loop
CORNER = np.pi / 6  # [rad] a sharper corner is one; a smaller one stands for a curve
ELLIPSE_LENGTH = 9.688448220547676  # of an ellipse with half axes 2 and 1
LEMNISCATE_LENGTH = 5.244115108584239  # of a lemniscate with half width 1
SQUARE_CORNERS = np.array([-1 - 1j, 1 - 1j, 1 + 1j, -1 + 1j])
ROUNDING = 0.4  # of a side: from a rounded square's corner to the ends of its arc
CHORD_SAMPLES = 10  # at the feed: what a loop passes quicker is a corner or rounding of the file
LEAST_CHORDS = 24  # of a run: short ones are still seen to turn
STRAIGHT = 1e-6  # [rad] a smaller change of direction needs no rounding


class Scale(NamedTuple):
    """Sizes that runs have in common."""

    # length of path [m] for each radian that it turns: that of a circle is its radius, that of a
    # square 0.64 of its side
    radius: float
    half_diagonal: float  # of the bounding box [m]
    feed: float  # speed along the path [m/s]
    low: Float[np.ndarray, " m"]  # least middle of a run's bounding box, axis by axis [m]
    high: Float[np.ndarray, " m"]  # greatest one


def held_out_like(jobs: Sequence[Job], pace: Pace) -> list[Job]:
    """Circle, ellipse, lemniscate and square like these parts, for a machine of two or three axes.

    The size is such that a metre of path turns by as much as a metre of the parts. A circle has
    their mean radius of curvature, corners included, the median over parts; see `scale_of`. A loop
    feels a curve by v^2 over that radius, and not by how far apart two holes of a part are: a large
    part with small curves gets small contours. The radius is at most the half diagonal of a part,
    so that no contour reaches farther than 1.8 times that. The square is sharp where a part has a
    corner of more than 30 degrees, and has rounded corners otherwise.

    The feed is that of the parts, see `scale_of`. They run from rest to rest, by the rules and
    limits of a part, where most parts do. Otherwise they run at constant feed, lowered to limits
    that the machine states. Their middle is in the middle of the parts, since some machines are not
    the same everywhere.

    All together have about as many samples as the parts, but each at least 150 and at most 1000. A
    contour that would have more ends early and so keeps curvature and feed of the part; the square
    is made smaller as well, so that it keeps its corners. At constant feed a contour that ends
    early has its entry before these samples, and it is not scored.
    """
    if not jobs:
        raise ValueError("jobs: needs at least one part to be like, received none")
    machine = pace.machine
    if machine.model.axes < 2:
        raise ValueError(
            "jobs: contours need a machine of two or three axes, "
            f"{machine.name} has {machine.model.axes}"
        )
    scale = scale_of(jobs, machine.model.dt)
    samples = sum(job.samples for job in jobs) // CONTOURS
    samples = int(np.clip(samples, LEAST_SAMPLES, MOST_SAMPLES))
    sharp = max(sharpest_corner(job) for job in jobs) > CORNER
    at_rest = 2 * sum(job.at_rest for job in jobs) > len(jobs)
    longest = scale.feed * machine.model.dt * samples
    middle, runs = 0.5 * (scale.low + scale.high), []
    for name, contour in _contours(scale, sharp, longest).items():
        path, feed = moved(contour, middle), scale.feed
        if at_rest:
            if float(path.length) > longest:  # more is not planned, and then thrown away
                path = beginning(path, longest)
            run = from_rest_to_rest(name, path, pace, feed)
            if run.samples > samples:
                path = beginning(path, float(run.arc[samples - 1]))
                run = from_rest_to_rest(name, path, pace, feed)
        else:
            if machine.limits.speed is not None:
                feed = min(feed, float(machine.limits.speed.min()))
            if pace.axis_acceleration is not None:
                feed = min(feed, curve_feed(path, float(pace.axis_acceleration.min())))
            run = shortened(at_constant_feed(name, path, pace._replace(feed=feed)), samples)
        runs.append(run)
    return runs


def _contours(scale: Scale, sharp: bool, longest: float) -> dict[str, Contour]:
    """Contours by name, each as long as the angle that it turns by times the radius of the scale.

    A sharp square is at most `longest` [m] around, of a rounded one a side is.
    """
    around = 2 * np.pi * scale.radius
    semi_minor, half_width = around / ELLIPSE_LENGTH, 1.5 * around / LEMNISCATE_LENGTH
    name = "square" if sharp else "rounded-square"
    rounding = 0.0 if sharp else ROUNDING
    cut = 2 * rounding * (8 - 2 * np.pi)  # what its arcs are shorter than the sharp corners
    half_side = min(around / (8 - cut), longest / 8 if sharp else longest / 2)
    return {
        "circle": circle(scale.radius),
        "ellipse": ellipse(2 * semi_minor, semi_minor),
        "lemniscate": lemniscate(half_width),
        name: rounded_polygon(half_side * SQUARE_CORNERS, np.full(4, rounding)),
    }


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
    runs = [_scale_of(job, dt) for job in jobs]
    return Scale(
        radius=float(np.median([run.radius for run in runs])),
        half_diagonal=float(np.median([run.half_diagonal for run in runs])),
        feed=float(np.median([run.feed for run in runs])),
        low=np.min([run.low for run in runs], axis=0),
        high=np.max([run.high for run in runs], axis=0),
    )


def sharpest_corner(job: Job) -> float:
    """Greatest change of direction [rad] between two pieces, both of them scored."""
    turned = corner_angles(job.contour)
    if job.at_rest:
        corner = np.asarray(job.contour.start)[1:]  # a closed contour's last one is not passed
        sample = np.searchsorted(job.arc, corner)
        turned = turned[: corner.size][job.scored[sample - 1] & job.scored[sample]]
    return float(np.max(turned, initial=0.0))


def _scale_of(job: Job, dt: float) -> Scale:
    # Speed at or above which half of the scored way is made
    steps = np.sort(np.diff(job.arc)[job.scored[1:] & job.scored[:-1]])[::-1]
    made = np.cumsum(steps)
    feed = float(steps[np.searchsorted(made, 0.5 * made[-1])]) / dt
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
    middle = 0.5 * (low + high)
    return Scale(float(radius), half_diagonal, feed, middle, middle)


def rounded_polygon(
    points: Complex[np.ndarray, " n"], rounding: Float[np.ndarray, " n"]
) -> Contour:
    """Polygon with corners at complex points [m], rounded by tangent arcs.

    An arc begins and ends at `rounding` times the shorter side beside its corner, less than a half;
    0 leaves the corner sharp. The contour begins in the middle of the last side.
    """
    before, after = points - np.roll(points, 1), np.roll(points, -1) - points
    trim = rounding * np.minimum(np.abs(before), np.abs(after))
    turned = np.angle(after / before)
    into, out_of = before / np.abs(before), after / np.abs(after)
    first = at = points[0] - 0.5 * before[0]
    members: list[Contour] = []
    for i, corner in enumerate(points):
        start = corner - trim[i] * into[i]
        members.append(line(_in_plane(at), _in_plane(start)))
        at = corner + trim[i] * out_of[i]
        if trim[i] > 0 and abs(turned[i]) > STRAIGHT:
            radius = trim[i] / np.tan(0.5 * turned[i])  # below zero: to the right
            centre = start + 1j * radius * into[i]
            members.append(arc(_in_plane(start), _in_plane(centre), turned[i]))
        elif trim[i] > 0:
            members.append(line(_in_plane(start), _in_plane(at)))
    return chain([*members, line(_in_plane(at), _in_plane(first))])


def _in_plane(points: complex | np.ndarray) -> Float[np.ndarray, "*n 2"]:
    return np.stack([np.real(points), np.imag(points)], axis=-1)
