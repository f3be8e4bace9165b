"""Random toolpaths and limits of all sizes, in the manners in which programs are written."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from jcontour.geometry.contour import Contour
from jcontour.geometry.contours import from_pieces, polyline
from jcontour.geometry.pieces import Piece
from jcontour.motion.jerk_limited.limits import AxisLimits

# one after the other, by the seed
KINDS = (
    "lines of all lengths",
    "lines back and forth, feeds differ",
    "rounded outlines, feeds differ",
    "rounded outlines in chords",
    "lines and arcs, nearly smooth",
    "lines",
    "lines, feeds differ",
    "chords of curves",
    "lines and arcs",
)
WITH_ARCS = ("lines and arcs", "lines and arcs, nearly smooth")
MOST_PIECES = 50
LONGEST = 100.0  # that a side of the box takes, in times in which the acceleration builds up
NEW = 0.6  # chance that a piece does not go on along the line or the circle of the one before
WHOLE = np.array([0.0, 1.0])  # a piece that is not parted


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


def random_path(seed: int, kind: str | None = None) -> RandomPath:
    """Path of 2 to 50 pieces; sizes, limits, feed and tolerance vary over decades.

    The kind follows from the seed where it is not given.
    """
    random = np.random.default_rng(seed)
    kind = kind or KINDS[seed % len(KINDS)]
    count = int(random.integers(2, MOST_PIECES + 1))
    axes = 2 if kind in WITH_ARCS else int(random.integers(2, 4))
    feed = np.full(count, 10 ** random.uniform(-3, 0))
    if kind == "lines, feeds differ":
        feed *= random.uniform(0.1, 1.0, count)
    if kind.endswith(("outlines, feeds differ", "forth, feeds differ")):
        feed *= np.repeat(random.uniform(0.1, 1.0, count), random.integers(1, 20, count))[:count]
    acceleration = 10 ** random.uniform(-1, 1.5, axes)
    build_up = 10 ** random.uniform(-2.5, -0.5)
    speed = 10 ** random.uniform(-2, 0.3, axes)
    limits = AxisLimits.of(axes, acceleration, acceleration / build_up, speed)
    slowest = min(feed.min(), speed.min())
    size = min(10 ** random.uniform(-4, -1), LONGEST * build_up * slowest)
    drawn = _drawn(random, kind, count, axes, size)
    tolerance = 10 ** random.uniform(-6, -3.5)
    if isinstance(drawn, Contour):
        return RandomPath(kind, drawn, feed, limits, tolerance, None)
    return RandomPath(kind, polyline(drawn), feed, limits, tolerance, drawn)


def _drawn(
    random: np.random.Generator, kind: str, count: int, axes: int, size: float
) -> Float[np.ndarray, "n m"] | Contour:
    """Points of lines, or lines and arcs."""
    if kind == "lines of all lengths":
        return _lines(random, count, axes, size)
    if kind == "lines back and forth, feeds differ":
        return _back_and_forth(random, count, axes, size)
    if kind.startswith("rounded outlines"):
        return _rounded(random, count, axes, size)
    if kind == "lines and arcs, nearly smooth":
        return _nearly_smooth(random, count, size)
    points = random.uniform(0, size, (count + 1, axes))
    if kind == "chords of curves":
        return _curve(random, count, axes, size)
    return _with_arcs(random, points) if kind == "lines and arcs" else points


def _lines(random: np.random.Generator, count: int, axes: int, size: float) -> np.ndarray:
    """Points that are some thousandths of the size apart, or all of it."""
    steps = random.normal(size=(count, axes))
    length = size * 10 ** random.uniform(-3, 0, (count, 1))
    steps *= length / np.linalg.norm(steps, axis=1, keepdims=True)
    return np.vstack([np.zeros(axes), np.cumsum(steps, axis=0)])


def _back_and_forth(
    random: np.random.Generator, count: int, axes: int, size: float
) -> Float[np.ndarray, "n m"]:
    """Points of lines that turn back, go on nearly straight or turn, some of a nanometre or so."""
    points, along = [np.zeros(axes)], random.normal(size=axes)
    for _ in range(count):
        turn = random.choice([0.0, 10 ** random.uniform(-8, -1), 1.0], p=[0.2, 0.6, 0.2])
        along = along / np.linalg.norm(along) + turn * random.normal(size=axes)
        along *= random.choice([-1.0, 1.0], p=[0.2, 0.8]) / np.linalg.norm(along)
        tiny = random.uniform() < 0.1
        length = 10 ** random.uniform(-9.5, -7) if tiny else size * 10 ** random.uniform(-4, 0)
        points.append(points[-1] + length * along)
    return np.array(points)


def _rounded(random: np.random.Generator, count: int, axes: int, size: float) -> np.ndarray:
    """Points of straight sides and of arcs in chords, as around a pad.

    They are rounded, as in a file; on a third axis the path climbs.
    """
    length, turn = np.empty(0), np.empty(0)
    while length.size < count:
        chords, chord = random.integers(2, 20), size * 10 ** random.uniform(-3, -1)
        side = size * 10 ** random.uniform(-3, 0)
        bend = random.choice([-1, 1]) * 10 ** random.uniform(-2.5, -0.7)  # [rad] in every chord
        length = np.concatenate([length, [side], np.full(chords, chord)])
        turn = np.concatenate([turn, [0.0], np.full(chords, bend)])
    heading = np.cumsum(turn[:count])
    steps = np.stack([np.cos(heading), np.sin(heading), 0.3 + 0 * heading], axis=1)[:, :axes]
    points = np.cumsum(steps * length[:count, None], axis=0)
    digit = size * 10 ** random.uniform(-7, -4)
    return np.round(np.vstack([np.zeros(axes), points]) / digit) * digit


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
    return _joined(pieces)


def _nearly_smooth(random: np.random.Generator, count: int, size: float) -> Contour:
    """Lines and arcs that go on in about the direction of the one before, as CAM systems fit them.

    Their lengths vary over decades.
    """
    place, heading, pieces = np.zeros(2), 0.0, []
    for _ in range(count):
        heading += random.choice([-1, 1]) * 10 ** random.uniform(-7, -1.5)
        along = np.array([np.cos(heading), np.sin(heading)])
        length = size * 10 ** random.uniform(-2.5, 0)
        turn = min(10 ** random.uniform(-2, 1) * length / size, 4.0)
        angle = random.choice([0.0, -turn, turn])
        if angle:
            centre = place + length / angle * np.array([-along[1], along[0]])
            pieces.append(_arc(place, centre, angle, WHOLE))
            place = centre + _turned(place - centre, angle)
        else:
            pieces.append(_line(place, place + length * along, WHOLE))
            place = place + length * along
        heading += angle
    return _joined(pieces)


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


def _turned(vector: Float[np.ndarray, "2"], angle: float) -> Float[np.ndarray, "2"]:
    (x, y), cos, sin = vector, np.cos(angle), np.sin(angle)
    return np.array([x * cos - y * sin, x * sin + y * cos])


def _joined(pieces: list[Piece]) -> Contour:
    # a contour for every piece would take a third of the time to plan
    return from_pieces(Piece(*(np.concatenate(rows) for rows in zip(*pieces, strict=True))))
