"""How near the motions of random toolpaths come to their limits."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from jcontour._compiled import compiled
from jcontour.geometry.contour import unpadded
from jcontour.geometry.pieces import Piece
from jcontour.motion.cornering import Planned, cornered
from jcontour.motion.jerk_limited.limits import AxisLimits
from jcontour.motion.point_to_point import PointToPoint
from tests.jcontour.motion.random_paths import random_path

SLACK = 1e-9  # relative
INSIDE = 3  # random times in every cell
BESIDE = 1e-9  # of a cell: so near its ends the motion is looked at, too
ON_PATH = 2000  # points whose distance from the lines and arcs is measured


class Ratios(NamedTuple):
    """Greatest of a motion over its limit.

    Attributes:
        feed, speed, acceleration, jerk: at any time.
        deviation: from the path, over the tolerance.
        stopping: duration over that with a stop in every corner; NaN where arcs hide that.
    """

    feed: float
    speed: float
    acceleration: float
    jerk: float
    deviation: float
    stopping: float

    def exceeded(self) -> list[str]:
        """Limits that are not kept."""
        known = {name: one for name, one in self._asdict().items() if name != "stopping"}
        if not np.isnan(self.stopping):
            known["stopping"] = self.stopping
        return [name for name, ratio in known.items() if not ratio <= 1 + SLACK]


def ratios_of(seed: int, kind: str | None = None) -> Ratios:
    """Plan the motion of a random path and compare it with its limits."""
    path = random_path(seed, kind)
    alike = path.feed[1:] == path.feed[:-1]
    planned = cornered(path.contour, path.feed, path.limits, path.tolerance, alike=alike)
    random = np.random.default_rng([seed, 1])
    peaks = _peaks(planned, random)
    off = max(planned.around.deviation, _farthest(planned, random))
    stopping = np.nan
    if path.points is not None:
        stopping = planned.motion.duration / stopping_time(path.points, path.feed, path.limits)
    return Ratios(*peaks, off / path.tolerance, stopping)


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


def _farthest(planned: Planned, random: np.random.Generator) -> float:
    """Greatest distance of points of the path from the nearest of all lines and arcs [m]."""
    pieces, true = unpadded(planned.around.path), unpadded(planned.around.contour)
    piece = random.integers(0, pieces.extent.size, ON_PATH)
    on = pieces.taken(piece)
    place = on.jet(random.uniform(0, 1, ON_PATH) * on.extent)[0]
    lines = true.taken(true.rate == 0)
    start, along = lines.polynomial[:, 0].copy(), lines.polynomial[:, 1].copy()
    square = np.full(ON_PATH, np.inf)
    _fill_squares_to_lines(place, start, along, lines.extent, square)
    nearest = np.sqrt(square)
    for k in np.flatnonzero(true.rate > 0):
        nearest = np.minimum(nearest, _to_arc(place, true.taken(k)))
    return float(nearest.max())


@compiled
def _fill_squares_to_lines(place, start, along, extent, square):
    """Write the squared distance of places from the nearest of all lines, where it is less."""
    for k in range(extent.size):
        for i in range(square.size):
            into = 0.0
            for axis in range(place.shape[1]):
                into += (place[i, axis] - start[k, axis]) * along[k, axis]
            into = min(max(into, 0.0), extent[k])
            away = 0.0
            for axis in range(place.shape[1]):
                away += (place[i, axis] - start[k, axis] - into * along[k, axis]) ** 2
            square[i] = min(square[i], away)


def _to_arc(place: Float[np.ndarray, "n 2"], arc: Piece) -> Float[np.ndarray, " n"]:
    away, radius, turn = place - arc.polynomial[0], 1 / arc.rate, arc.rate * arc.extent
    begin, end = arc.cosine, arc.cosine * np.cos(turn) + arc.sine * np.sin(turn)
    to_ends = np.minimum(*(np.linalg.norm(away - one, axis=1) for one in (begin, end)))
    beside = np.mod(np.arctan2(away @ arc.sine, away @ arc.cosine), 2 * np.pi) < turn
    return np.where(beside, np.abs(np.linalg.norm(away, axis=1) - radius), to_ends)
