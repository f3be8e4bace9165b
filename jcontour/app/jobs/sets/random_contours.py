"""Random contours in the size and feed of a machine: many to tune on, as many never seen.

`random:64` on the command line is 64 contours to tune on and 64 others that are held out.
"""

import re
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from jcontour.app.jobs.contours import BUILT_IN
from jcontour.app.jobs.entry import ENTRY
from jcontour.app.jobs.job import Job, Pace, at_constant_feed
from jcontour.app.jobs.sets.random_shapes import KINDS, Shape
from jcontour.app.jobs.sets.scale import scale_of
from jcontour.app.jobs.sets.stretches import beginning, corner_feed, curve_feed, moved, shortened

SIZES = 2.0  # times larger or smaller than the middle size
FEEDS = 1.5  # times faster or slower than the middle feed
# of the size: an arc this near to a corner would need the path acceleration at the same feed
CORNER_DEVIATION = 0.05
LEAST_SAMPLES, MOST_SAMPLES = 150, 400  # behind the entry: 64 runs are tuned in minutes
MOST_CONTOURS = 1000  # their runs are 500,000 samples
WORDS = re.compile(r"random:([0-9]{1,6})")

Seed = int | np.random.SeedSequence
Places = tuple[Float[np.ndarray, " m"], Float[np.ndarray, " m"]]


def contour_jobs(
    words: str, pace: Pace, seed: int, parts: Sequence[Job] = ()
) -> tuple[list[Job], list[Job]]:
    """Training and held-out contours that words such as `random:64` ask for, as many of each.

    Size, feed and place are drawn around those of the user's own parts, or of the machine's usual
    training contours where there are none. The held-out contours come from a stream of random
    numbers of their own.

    Raises:
        ValueError: other words or numbers, or a machine of a single axis.
    """
    asked = WORDS.fullmatch(words)
    if asked is None:
        raise ValueError(f"contours: needs random:COUNT, as random:64, received {words[:40]!r}")
    count, machine = int(asked[1]), pace.machine
    _check(count, seed, pace)
    usual = parts or [BUILT_IN[name](pace) for name in machine.usual.training]
    scale = scale_of(usual, machine.model.dt)
    places = scale.low, scale.high
    training = random_jobs(count, seed, pace, scale.radius, scale.feed, places)
    others = np.random.SeedSequence(seed).spawn(1)[0]
    held_out = random_jobs(count, others, pace, scale.radius, scale.feed, places)
    return training, [job._replace(name=job.name.replace("random", "held-out")) for job in held_out]


def random_jobs(
    count: int, seed: Seed, pace: Pace, size: float, feed: float, places: Places | None = None
) -> list[Job]:
    """Runs at constant feed along as many random contours; the same seed makes the same ones.

    Every kind of shape has an equal share, in random order. Sizes are drawn log-uniformly from
    half to twice `size` [m], feeds from `feed` / 1.5 to 1.5 `feed` [m/s]. Both are drawn one from
    each of equally likely ranges, so that two sets are as alike as random sets can be. Middles of
    the contours are uniform in a box.

    The feed is lowered to the speed of the slowest axis, and where a curve would need more than the
    path acceleration of `pace` or of the machine. At a sharp corner the velocity jumps. There an
    arc that passes it at a twentieth of the size needs no more: without that the sharpest corner
    would outweigh all curves.

    A run has 150 to 400 samples. A closed contour that is passed twice within these is run and
    scored as in `at_constant_feed`; its feed is lowered where it would be over sooner. A longer one
    ends early, as open ones do: these samples then come behind an entry that is not scored.

    Raises:
        ValueError: fewer than one contour or too many, a negative seed, size or feed not finite and
            above zero, or a machine of a single axis.
    """
    _check(count, seed, pace)
    for name, value in (("size", size), ("feed", feed)):
        if not (np.isfinite(value) and value > 0):
            raise ValueError(
                f"contours: {name} needs to be finite and above zero, received {value}"
            )
    random = np.random.default_rng(seed)
    axes = pace.machine.model.axes
    low, high = (np.zeros(axes), np.zeros(axes)) if places is None else places
    drawn = []
    # How many of each kind: equal numbers, the rest to kinds drawn at random
    kinds = len(KINDS)
    extra = random.permutation(kinds) < count % kinds
    for kind, share in zip(KINDS, count // kinds + extra, strict=True):
        sizes = size * SIZES ** _spread(random, share)
        feeds = feed * FEEDS ** _spread(random, share)
        drawn += [(kind, *pair) for pair in zip(sizes, feeds, strict=True)]
    digits = max(2, len(str(count)))
    return [
        _job(f"random-{n:0{digits}}", random, *drawn[i], pace, random.uniform(low, high))
        for n, i in enumerate(random.permutation(count), start=1)
    ]


def _job(
    name: str,
    random: np.random.Generator,
    kind: Shape,
    size: float,
    feed: float,
    pace: Pace,
    middle: Float[np.ndarray, " m"],
) -> Job:
    dt, limits = pace.machine.model.dt, pace.machine.limits
    samples = int(random.integers(LEAST_SAMPLES, MOST_SAMPLES + 1))
    speed = None if limits.speed is None else float(limits.speed.min())
    feed = feed if speed is None else min(feed, speed)
    # Path acceleration [m/s^2] that the pace asks for, within the machine's limit
    limit, asked = pace.machine.limits.acceleration, pace.acceleration_or_default
    acceleration = asked if limit is None else min(asked, float(limit.min()))
    # no curve of this size is faster: an open contour need not be longer
    most = min(feed, 2.0 * np.sqrt(acceleration * size))
    contour = moved(kind(random, size, most * dt * (ENTRY + samples)), middle)
    feed = min(
        feed,
        curve_feed(contour, acceleration),
        corner_feed(contour, acceleration, CORNER_DEVIATION * size),
    )
    # twice the run: what a preview sees is there, a long rest would only take time
    contour = beginning(contour, 2.0 * feed * dt * (ENTRY + MOST_SAMPLES))
    if bool(contour.closed):
        feed = min(feed, 2.0 * float(contour.length) / (LEAST_SAMPLES * dt))
        samples = MOST_SAMPLES
    return shortened(at_constant_feed(name, contour, pace._replace(feed=feed)), samples)


def _spread(random: np.random.Generator, count: int) -> Float[np.ndarray, " n"]:
    """Numbers in [-1, 1], one in each of as many equal intervals, in random order."""
    return 2.0 * (random.permutation(count) + random.random(count)) / max(count, 1) - 1.0


def _check(count: int, seed: Seed, pace: Pace) -> None:
    if not 1 <= count <= MOST_CONTOURS:
        raise ValueError(f"contours: needs a count from 1 to {MOST_CONTOURS}, received {count}")
    if isinstance(seed, int) and seed < 0:
        raise ValueError(f"contours: needs a seed that is not negative, received {seed}")
    if pace.machine.model.axes < 2:
        raise ValueError(
            "contours: random ones need a machine of two or three axes, "
            f"{pace.machine.name} has one"
        )
