"""Random toolpaths and limits of all sizes, and how near their motions come to what is promised."""

import time
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from jcontour.geometry.contour import Contour
from jcontour.geometry.contours import from_pieces, polyline
from jcontour.geometry.pieces import Piece
from jcontour.motion.cornering import Planned, cornered
from jcontour.motion.jerk_limited.joints import unpadded
from jcontour.motion.jerk_limited.limits import AxisLimits
from jcontour.motion.point_to_point import PointToPoint

KINDS = ("lines", "lines, feeds differ", "chords of curves", "lines and arcs")
MOST_PIECES = 50
INSIDE = 3  # random times in every cell
BESIDE = 1e-9  # of a cell: so near its ends the motion is looked at, too
LONGEST = 100.0  # that a side of the box takes, in times in which the acceleration builds up
NEW = 0.6  # chance that a piece does not go on along the line or the circle of the one before
ON_PATH = 2000  # points whose distance from the lines is measured


class RandomPath(NamedTuple):
    """What a motion is planned for.

    Attributes:
        kind: one of `KINDS`.
        contour: lines, or lines and arcs.
        feed: (P,) [m/s].
        limits: of the axes.
        tolerance: in corners [m].
        points: of lines [m]; None where there are arcs.
    """

    kind: str
    contour: Contour
    feed: Float[np.ndarray, " P"]
    limits: AxisLimits
    tolerance: float
    points: Float[np.ndarray, "n m"] | None


class Checked(NamedTuple):
    """How near one motion came to each promise; above 1 it is broken.

    Attributes:
        seed, kind, pieces: of the path.
        feed, speed, acceleration, jerk: greatest ever, over its limit.
        deviation: from the path, over the tolerance.
        stopping: duration over that with a stop in every corner; NaN where that is not known.
        seconds: that it took to plan [s].
    """

    seed: int
    kind: str
    pieces: int
    feed: float
    speed: float
    acceleration: float
    jerk: float
    deviation: float
    stopping: float
    seconds: float


def random_path(seed: int) -> RandomPath:
    """Path of 2 to 50 pieces; sizes, limits, feed and tolerance vary over decades."""
    random = np.random.default_rng(seed)
    kind = KINDS[seed % len(KINDS)]
    count = int(random.integers(2, MOST_PIECES + 1))
    axes = 2 if kind == "lines and arcs" else int(random.integers(2, 4))
    feed = np.full(count, 10 ** random.uniform(-3, 0))
    if kind == "lines, feeds differ":
        feed *= random.uniform(0.1, 1.0, count)
    acceleration = 10 ** random.uniform(-1, 1.5, axes)
    build_up = 10 ** random.uniform(-2.5, -0.5)
    speed = 10 ** random.uniform(-2, 0.3, axes)
    limits = AxisLimits.of(axes, acceleration, acceleration / build_up, speed)
    slowest = min(feed.min(), speed.min())
    size = min(10 ** random.uniform(-4, -1), LONGEST * build_up * slowest)
    points = random.uniform(0, size, (count + 1, axes))
    if kind == "chords of curves":
        points = _curve(random, count, axes, size)
    contour = _with_arcs(random, points) if kind == "lines and arcs" else polyline(points)
    tolerance = 10 ** random.uniform(-6, -3.5)
    known = None if kind == "lines and arcs" else points
    return RandomPath(kind, contour, feed, limits, tolerance, known)


def checked(seed: int) -> Checked:
    """Plan the motion of a random path and compare it with its limits."""
    path = random_path(seed)
    began = time.perf_counter()
    planned = cornered(path.contour, path.feed, path.limits, path.tolerance)
    seconds = time.perf_counter() - began
    random = np.random.default_rng([seed, 1])
    peaks = _peaks(planned, random)
    off, stopping = planned.around.deviation, np.nan
    if path.points is not None:
        off = max(off, _farthest(planned, path.points, random))
        stopping = planned.motion.duration / stopping_time(path.points, path.feed, path.limits)
    pieces = path.feed.size
    return Checked(seed, path.kind, pieces, *peaks, off / path.tolerance, stopping, seconds)


def stopping_time(
    points: Float[np.ndarray, "n m"], feed: Float[np.ndarray, " P"], limits: AxisLimits
) -> float:
    """Duration of the motion along lines that stops in every corner [s], in closed form."""
    total = 0.0
    for delta, speed in zip(np.diff(points, axis=0), feed, strict=True):
        length = float(np.linalg.norm(delta))
        with np.errstate(divide="ignore"):
            fastest, *others = (float((each / np.abs(delta / length)).min()) for each in limits)
        total += PointToPoint(length, min(float(speed), fastest), *others).duration
    return total


def _curve(random: np.random.Generator, count: int, axes: int, size: float) -> np.ndarray:
    """Points on a sum of three waves, in short chords."""
    along = np.linspace(0.0, random.uniform(0.3, 1.0), count + 1)[:, None]
    phase, share = random.uniform(0, 2 * np.pi, (3, axes)), random.uniform(0, 1, (3, axes))
    waves = [share[k] * np.sin((k + 1) * along + phase[k]) for k in range(3)]
    return size * np.sum(waves, axis=0)


def _with_arcs(random: np.random.Generator, points: Float[np.ndarray, "n 2"]) -> Contour:
    """Lines, and arcs of up to three quarters of a turn; some in parts that meet smoothly.

    There are as many pieces as between the points; with parts, the last points are not reached.
    """
    count = len(points) - 1
    begins = np.flatnonzero(np.append(True, random.uniform(size=count - 1) < NEW))
    parts = np.diff(np.append(begins, count))
    pieces = []
    for start, end, number in zip(points[:-1], points[1:], parts, strict=False):
        length = random.uniform(0.2, 1.0, number)
        share = np.append(0.0, np.cumsum(length) / length.sum())
        if random.uniform() < 0.5:
            pieces.append(_line(start, end, share))
            continue
        angle = random.uniform(0.1, 1.5 * np.pi) * random.choice([-1, 1])
        chord = end - start
        across = np.array([-chord[1], chord[0]]) / (2 * np.tan(angle / 2))
        pieces.append(_arc(start, (start + end) / 2 + across, angle, share))
    # a contour for every piece would take a third of the time to plan
    return from_pieces(Piece(*(np.concatenate(rows) for rows in zip(*pieces, strict=True))))


def _line(
    start: Float[np.ndarray, "2"], end: Float[np.ndarray, "2"], share: Float[np.ndarray, " ends"]
) -> Piece:
    """Parts of a line."""
    extent = np.diff(share) * np.linalg.norm(end - start)
    polynomial = np.zeros((extent.size, 6, 2))
    polynomial[:, 0] = start + share[:-1, None] * (end - start)
    polynomial[:, 1] = (end - start) / np.linalg.norm(end - start)
    still, zero = np.zeros((extent.size, 2)), np.zeros(extent.size)
    return Piece(polynomial, still, still, zero, zero, extent)


def _arc(
    start: Float[np.ndarray, "2"],
    centre: Float[np.ndarray, "2"],
    angle: float,
    share: Float[np.ndarray, " ends"],
) -> Piece:
    """Parts of an arc."""
    x, y = start - centre
    turn, radius = angle * share[:-1], np.hypot(x, y)
    cos, sin = np.cos(turn), np.sin(turn)
    cosine = np.stack([x * cos - y * sin, x * sin + y * cos], axis=1)
    sine = np.sign(angle) * np.stack([-cosine[:, 1], cosine[:, 0]], axis=1)
    extent = np.diff(share) * abs(angle) * radius
    polynomial = np.zeros((extent.size, 6, 2))
    polynomial[:, 0] = centre
    zero = np.zeros(extent.size)
    return Piece(polynomial, cosine, sine, zero + 1 / radius, zero, extent)


def _peaks(planned: Planned, random: np.random.Generator) -> tuple[float, float, float, float]:
    """Feed, speed, acceleration and jerk over their limits: in every cell and at its ends."""
    motion = planned.motion
    length = np.diff(motion.nodes)[:, None]
    ends = np.broadcast_to([0.0, BESIDE, 1 - BESIDE], (length.size, 3))
    inside = np.concatenate([ends, random.uniform(0, 1, (length.size, INSIDE))], axis=1)
    at = (motion.nodes[:-1, None] + inside * length).ravel()
    speed, acceleration, jerk = motion.axes_at(at)
    arcs = np.append(0.0, np.cumsum(unpadded(motion.path).extent))
    piece = np.searchsorted(arcs, motion.at(at).arc, side="right") - 1
    # where two pieces meet, the feed of either holds
    either = np.clip([piece - (motion.at(at).arc - arcs[piece] < 1e-9 * arcs[-1]), piece], 0, None)
    allowed = motion.feed[np.minimum(either, motion.feed.size - 1)].max(axis=0)
    fed = float((np.linalg.norm(speed, axis=1) / allowed).max())
    over = [
        float((np.abs(values) / limit).max())
        for values, limit in zip((speed, acceleration, jerk), motion.limits, strict=True)
    ]
    return fed, over[0], over[1], over[2]


def _farthest(
    planned: Planned, points: Float[np.ndarray, "n m"], random: np.random.Generator
) -> float:
    """Greatest distance of points of the path from the nearest of all lines [m]."""
    pieces = unpadded(planned.around.path)
    piece = random.integers(0, pieces.extent.size, ON_PATH)
    on = pieces.taken(piece)
    place = on.jet(random.uniform(0, 1, ON_PATH) * on.extent)[0]
    nearest = np.full(ON_PATH, np.inf)
    for start, end in zip(points[:-1], points[1:], strict=True):
        delta = end - start
        share = np.clip((place - start) @ delta / (delta @ delta), 0.0, 1.0)
        nearest = np.minimum(
            nearest, np.linalg.norm(place - start - share[:, None] * delta, axis=1)
        )
    return float(nearest.max())
