"""Held-out contours in the size and feed of a user's own parts.

The tuner never sees them: they say whether tuned weights are good for more than the part.
"""

from collections.abc import Sequence

import numpy as np

from jcontour.app.jobs.job import Job, Pace, at_constant_feed, from_rest_to_rest
from jcontour.app.jobs.sets.random_shapes import rounded_polygon
from jcontour.app.jobs.sets.scale import Scale, scale_of, sharpest_corner
from jcontour.app.jobs.sets.stretches import beginning, curve_feed, moved, shortened
from jcontour.geometry.contour import Contour
from jcontour.geometry.contours import circle, ellipse, lemniscate

CONTOURS = 4  # that share the samples
LEAST_SAMPLES = 150  # of one of them, or too little is seen
MOST_SAMPLES = 1000  # of one of them: more says no more about a loop
CORNER = np.pi / 6  # [rad] a sharper corner is one; a smaller one stands for a curve
ELLIPSE_LENGTH = 9.688448220547676  # of an ellipse with half axes 2 and 1
LEMNISCATE_LENGTH = 5.244115108584239  # of a lemniscate with half width 1
SQUARE_CORNERS = np.array([-1 - 1j, 1 - 1j, 1 + 1j, -1 + 1j])
ROUNDING = 0.4  # of a side: from a rounded square's corner to the ends of its arc


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

    Raises:
        ValueError: no parts, or a machine of a single axis.
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
    run = _from_rest_to_rest if at_rest else _at_constant_feed
    middle = 0.5 * (scale.low + scale.high)
    return [
        run(name, moved(contour, middle), pace, scale.feed, samples)
        for name, contour in _contours(scale, sharp, longest).items()
    ]


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


def _from_rest_to_rest(name: str, contour: Contour, pace: Pace, feed: float, samples: int) -> Job:
    farthest = feed * pace.machine.model.dt * samples
    if float(contour.length) > farthest:  # more is not planned, and then thrown away
        contour = beginning(contour, farthest)
    run = from_rest_to_rest(name, contour, pace, feed)
    if run.samples <= samples:
        return run
    contour = beginning(contour, float(run.arc[samples - 1]))
    return from_rest_to_rest(name, contour, pace, feed)


def _at_constant_feed(name: str, contour: Contour, pace: Pace, feed: float, samples: int) -> Job:
    limits = pace.machine.limits
    if limits.speed is not None:
        feed = min(feed, float(limits.speed.min()))
    if pace.axis_acceleration is not None:
        feed = min(feed, curve_feed(contour, float(pace.axis_acceleration.min())))
    return shortened(at_constant_feed(name, contour, pace._replace(feed=feed)), samples)
