"""Feed laws: how far along a contour the tool should be at every sample. NumPy, on the host.

    constant_feed   s_k = feed k dt, in motion from the first sample to the last
    trapezoidal     from rest to rest as fast as the limits allow, slower at corners

The second works in the phase plane of arc length s and q = (ds/dt)^2, where a constant acceleration
a is a straight line, dq/ds = 2a. With the unit tangent t and the curvature vector c = dt/ds the
machine's acceleration is t a + c q, linear in both: every limit is a straight line too.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from jcontour.geometry.contour import Contour, unpadded
from jcontour.geometry.coordinates import Numbers, per_axis, per_piece, positive
from jcontour.geometry.pieces import Piece

__all__ = [
    "SharpTurnError",
    "constant_feed",
    "trapezoidal",
]

MOST_SAMPLES = 20_000_000  # 160 MB for the arc length alone
# of a sample: a run that is this close to a whole number of samples has that number
SAMPLE_ROUNDING = 1e-6
# [rad] the most a tangent turns between two nodes; limits are tightened by up to 1 - cos(0.025) =
# 0.03 % for it
STEP_ANGLE = 0.05
WIDE, FINER = 1.0, 16  # [rad] of a step that has met a hidden bend; its piece gets more of them
MOST_STEPS = 5_000_000  # of all pieces
FEWEST_STEPS = 4  # of a curved piece, so that the speed can rise between two stops
CORNER = 1e-6  # [rad] a smaller change of direction is rounding in the file


class Rests(NamedTuple):
    """Rests of a motion, in order: how long it stands still where it stops, as in dwells.

    A law of motion is planned without them. Time then stands still for each: with rests r_i that
    begin at the law's own times b_i, the time t of the whole is the law's time
    max(t - r_0 - ... - r_i, b_i), i being the last rest that has begun.
    """

    begin: Float[np.ndarray, " k"]  # times at which they begin, of the motion without rests [s]
    lasting: Float[np.ndarray, " k"]  # how long each lasts [s]

    @property
    def total(self) -> float:
        """Time that all of them last [s]."""
        return float(self.lasting.sum())

    def moving(self, time: Float[np.ndarray, " T"]) -> Float[np.ndarray, " T"]:
        """Times [s] of the motion without rests at times of the one with them.

        >>> Rests(np.array([2.0]), np.array([0.5])).moving(np.array([1.0, 2.25, 3.0])).tolist()
        [1.0, 2.0, 2.5]
        """
        lasted = np.append(0.0, np.cumsum(self.lasting))
        begun = np.searchsorted(self.begin + lasted[:-1], time, side="right")
        least = np.append(-np.inf, self.begin)
        return np.maximum(time - lasted[begun], least[begun])


NEVER = Rests(np.zeros(0), np.zeros(0))


def rest_of_pieces(rest: Float[np.ndarray, "..."] | None, count: int) -> Float[np.ndarray, " P"]:
    """How long a motion rests at the end of each of so many pieces [s]; NaN where it goes on.

    Raises:
        ValueError: wrong shape, a time below zero, or one that is infinite.
    """
    if rest is None:
        return np.full(count, np.nan)
    if rest.shape != (count,):
        raise ValueError(f"rest: needs shape ({count},), received {rest.shape}")
    wrong = np.isinf(rest) | (rest < 0)
    if wrong.any():
        raise ValueError(f"rest: needs finite times, not below zero, received {rest[wrong][0]}")
    return rest


class SharpTurnError(ValueError):
    """A curve that turns too sharply for its length to be followed in steps.

    Attributes:
        piece: number of the piece that needs most steps.
        steps: how many the whole contour needs.
    """

    def __init__(self, piece: int, steps: float):
        self.piece, self.steps = piece, steps
        super().__init__(
            f"contour: a curve turns too sharply for its length: it needs {steps:.2g} steps, "
            f"more than {MOST_STEPS:,}"
        )


def constant_feed(contour: Contour, feed: Numbers, dt: float) -> Float[np.ndarray, " T"]:
    """Arc length [m] at every sample of a motion at constant feed.

    It is 0, feed dt, 2 feed dt, ... as far as the contour reaches.

    >>> from jcontour import contours
    >>> arc = constant_feed(contours.circle(10e-3), feed=50e-3, dt=1e-3)
    >>> arc.size, arc[:3].round(9).tolist()
    (1257, [0.0, 5e-05, 0.0001])

    Args:
        contour: one contour, not a stack.
        feed: speed [m/s], one number or one for each piece (P,).
        dt: sample period [s].

    Raises:
        ValueError: a feed or `dt` is not finite and above zero, wrong shape, less than one sample
            or more than 20 million.
    """
    extent = unpadded(contour).extent
    feed, dt = per_piece("feed", feed, extent.size), positive("dt", dt)
    length, times = float(contour.length), _cumulated(extent / feed)
    steps = sample_count(times[-1] / dt + SAMPLE_ROUNDING)
    if steps < 1:
        raise ValueError(
            f"feed: the tool passes the whole contour, {length:.3g} m, "
            f"within one sample of {dt:g} s"
        )
    if np.all(feed == feed[0]):
        return np.minimum(np.arange(steps + 1) * (feed[0] * dt), length)
    return np.minimum(np.interp(np.arange(steps + 1) * dt, times, _cumulated(extent)), length)


def trapezoidal(
    contour: Contour,
    feed: Numbers,
    dt: float,
    acceleration: float,
    axis_speed: Numbers | None = None,
    axis_acceleration: Numbers | None = None,
    # half of what Grbl starts with; a few encoder counts of 0.8 um
    junction_deviation: float = 5e-6,
    rest: Float[np.ndarray, " P"] | None = None,
) -> Float[np.ndarray, " T"]:
    """Arc length [m] at every sample of a quick motion from rest to rest within the limits.

    The last sample rests at the end.

    >>> from jcontour import contours
    >>> path = contours.line([0.0, 0.0], [0.1, 0.0])
    >>> arc = trapezoidal(path, feed=0.1, dt=1e-3, acceleration=2.0)
    >>> arc.size, float(arc[-1])
    (1051, 0.1)

    With v = ds/dt, a = dv/dt, t the unit tangent and c = dt/ds
    the curvature vector, everywhere and
    for every axis i:

        v <= feed        |a| <= acceleration        |c| v^2 <= acceleration
        |t_i| v <= axis_speed_i                     |t_i a + c_i v^2| <= axis_acceleration_i

    At a corner, v^2 <= A d sin(h) / (1 - sin(h)) with h half the angle inside the corner and d the
    junction deviation, the usual rule (Grbl): at that speed an arc that is tangent to both sides
    and passes the corner at the distance d needs the centripetal acceleration A. A is
    `acceleration`, or less where the bisector of the corner meets an axis limit. The contour itself
    is not rounded, so the velocity jumps there. Each corner is judged by itself: a curve cut into
    short lines is limited by its corners, not by the curvature that they stand for.

    A backward pass over nodes in arc length finds the greatest v^2 from which the rest of the path
    can be mastered, a forward pass the greatest that is reached. Exact on lines. On curves the
    acceleration is constant between nodes at most 0.05 rad apart, and no point is passed faster
    than it could be passed at constant speed, which costs a little time where an axis limit binds.

    Args:
        contour: one contour, not a stack.
        feed: greatest speed [m/s], one number or one for each piece (P,).
        dt: sample period [s].
        acceleration: along the path, and across it [m/s^2].
        axis_speed: greatest speed of the axes [m/s], one number or (m,).
        axis_acceleration: greatest acceleration of the axes [m/s^2], one number or (m,).
        junction_deviation: d [m]; 0 stops at every corner.
        rest: (P,) how long it rests at the end of every piece [s], NaN where it goes on; nowhere
            when not given.

    Raises:
        ValueError: a limit or `dt` is not finite and above zero, a rest is negative, wrong shape,
            or more than 20 million samples.
    """
    speed_limit, acceleration_limit = (
        per_axis(name, np.inf if value is None else value, contour.axes, infinite=True)
        for name, value in (("axis_speed", axis_speed), ("axis_acceleration", axis_acceleration))
    )
    acceleration, dt = positive("acceleration", acceleration), positive("dt", dt)
    if not (np.isfinite(junction_deviation) and junction_deviation >= 0):
        raise ValueError(
            "junction_deviation: needs to be finite and not negative, "
            f"received {junction_deviation}"
        )
    pieces = unpadded(contour)
    feed = per_piece("feed", feed, pieces.extent.size)
    rest = rest_of_pieces(rest, feed.size)
    stops = np.flatnonzero(~np.isnan(rest))

    steps = _steps(pieces)
    ceiling = _ceiling(steps, feed, acceleration, speed_limit, acceleration_limit)
    corners = _corner_ceiling(steps, acceleration, acceleration_limit, junction_deviation)
    nodes = np.zeros(ceiling.size + 1)
    nodes[1:-1] = np.minimum(np.minimum(ceiling[:-1], ceiling[1:]), corners)
    nodes[np.searchsorted(steps.piece, stops, side="right")] = 0.0
    rows = _rows(steps, acceleration, acceleration_limit)
    profile = _profile(steps, ceiling, _quickest(steps, rows, nodes), rows)
    places = _cumulated(pieces.extent)
    return _sampled(*profile, float(places[-1]), dt, places[stops + 1], rest[stops])


class _Steps(NamedTuple):
    """Steps between neighbouring nodes; unit tangents and curvature vectors [1/m] at both ends."""

    length: Float[np.ndarray, " n"]
    piece: Float[np.ndarray, " n"]
    straight: Float[np.ndarray, " n"]
    tangent: Float[np.ndarray, "2 n m"]
    curvature: Float[np.ndarray, "2 n m"]

    @property
    def tightening(self) -> Float[np.ndarray, " n"]:
        """Factor on axis limits that hold at both ends, so that they hold in between.

        A component of a vector that turns by an angle exceeds the larger of its values at both ends
        by less than 1 / cos(angle / 2).
        """
        return np.cos(0.5 * self.turned)

    @property
    def turned(self) -> Float[np.ndarray, " n"]:
        """Angle [rad] by which the path turns at the larger of the curvatures at both ends."""
        return np.linalg.norm(self.curvature, axis=-1).max(axis=0) * self.length


class _Rows(NamedTuple):
    """Limits of a step: |along a + across q| <= limit.

    Its acceleration is a, and q = v^2 at its first node; `along` is not negative.
    """

    along: Float[np.ndarray, "n R"]
    across: Float[np.ndarray, "n R"]
    limit: Float[np.ndarray, "n R"]


def _steps(pieces: Piece) -> _Steps:
    """Steps of a contour: one for a line, several for a curve."""
    places = np.linspace(0.0, 1.0, 17)[:, None] * pieces.extent
    every = np.broadcast_to(np.arange(pieces.extent.size), places.shape)
    _, curvature = _frame(pieces, every, places)
    bend = np.linalg.norm(curvature, axis=-1).max(axis=0)
    straight = (pieces.rate == 0) & ~pieces.polynomial[:, 2:].any(axis=(1, 2))
    several = np.maximum(np.ceil(bend * pieces.extent / STEP_ANGLE), FEWEST_STEPS)
    count = np.where(straight, 1, several)
    while True:  # a bend may hide between the places that are looked at first
        if not count.sum() <= MOST_STEPS:
            raise SharpTurnError(int(np.argmax(count)), float(count.sum()))
        whole = count.astype(int)
        piece = np.repeat(np.arange(whole.size), whole)
        number = np.arange(piece.size) - np.repeat(np.cumsum(whole) - whole, whole)
        length = pieces.extent[piece] / whole[piece]
        ends = np.stack([number * length, (number + 1) * length])
        tangent, curvature = _frame(pieces, np.broadcast_to(piece, ends.shape), ends)
        steps = _Steps(length, piece, straight[piece], tangent, curvature)
        wide = piece[~(steps.turned < WIDE)]
        if wide.size == 0:
            return steps
        count[np.unique(wide)] *= FINER


def _frame(pieces: Piece, piece: Int[np.ndarray, "..."], s: Float[np.ndarray, "..."]):
    """Unit tangent and curvature vector [1/m]."""
    from jcontour.geometry.along_pieces import jet  # loads Numba

    _, velocity, bend, _ = jet(pieces, piece, s)
    square = np.sum(velocity**2, axis=-1, keepdims=True)
    across = bend - np.sum(bend * velocity, axis=-1, keepdims=True) / square * velocity
    return velocity / np.sqrt(square), across / square


def _ceiling(
    steps: _Steps, feed, acceleration, speed_limit, acceleration_limit
) -> Float[np.ndarray, " n"]:
    """Greatest v^2 at which a step can be passed at constant speed."""
    ceiling = feed[steps.piece] ** 2
    with np.errstate(divide="ignore", over="ignore"):  # no limit where an axis does not move
        bend = np.linalg.norm(steps.curvature, axis=-1)
        ceiling = np.minimum(ceiling, (acceleration / bend).min(axis=0))
        per_axis = (acceleration_limit / np.abs(steps.curvature)).min(axis=(0, 2))
        ceiling = np.minimum(ceiling, steps.tightening * per_axis)
        fastest = (speed_limit / np.abs(steps.tangent)).min(axis=(0, 2))
        ceiling = np.minimum(ceiling, (steps.tightening * fastest) ** 2)
    return ceiling


def _corner_ceiling(
    steps: _Steps, acceleration, acceleration_limit, deviation
) -> Float[np.ndarray, " inner"]:
    """Greatest v^2 at the nodes between steps; no limit where the direction does not change."""
    before, after = steps.tangent[1, :-1], steps.tangent[0, 1:]
    change = after - before
    size = np.linalg.norm(change, axis=-1)
    turned = 2.0 * np.arctan2(size, np.linalg.norm(after + before, axis=-1))
    with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
        per_axis = (acceleration_limit / np.abs(change / size[:, None])).min(axis=-1)
        along_bisector = np.minimum(acceleration, per_axis)
        sin_half = np.cos(0.5 * turned)  # h = (pi - turned) / 2
        ceiling = along_bisector * deviation * sin_half / (2.0 * np.sin(0.25 * turned) ** 2)
    return np.where(turned < CORNER, np.inf, ceiling)


def _rows(steps: _Steps, acceleration, acceleration_limit) -> _Rows:
    """Axis limits at both nodes of every step, and the limit along the path.

    At the last node v^2 = q + 2 a length.
    """
    limit = steps.tightening[:, None] * acceleration_limit
    one = np.ones((steps.length.size, 1))
    along_at_end = steps.tangent[1] + 2.0 * steps.length[:, None] * steps.curvature[1]
    along = np.concatenate([steps.tangent[0], along_at_end, one], axis=1)
    across = np.concatenate([steps.curvature[0], steps.curvature[1], 0.0 * one], axis=1)
    sign = np.where(along < 0, -1.0, 1.0)
    finite = np.concatenate([limit, limit, acceleration * one], axis=1)
    return _Rows(sign * along, sign * across, finite)


def _quickest(
    steps: _Steps, rows: _Rows, most: Float[np.ndarray, " nodes"]
) -> Float[np.ndarray, " nodes"]:
    """Greatest v^2 at every node, at most `most`, that is reached and from which the rest can be.

    With a = (q' - q) / (2 length) from q to q' a row holds while (along - 2 length across) q <=
    along q' + 2 length limit.
    """
    doubled = 2.0 * steps.length[:, None]
    slope = rows.along - doubled * rows.across
    with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
        per_end = np.where(slope > 0, rows.along / slope, 0.0)
        at_rest = np.where(slope > 0, doubled * rows.limit / slope, np.inf)
        gain = np.where(rows.along > 0, doubled * rows.limit / rows.along, np.inf)
        loss = np.where(rows.along > 0, doubled * rows.across / rows.along, 0.0)
    nodes = most.copy()
    from jcontour.motion.phase_plane import sweep  # loads Numba

    sweep(np.stack([per_end, at_rest, gain, loss]), nodes)
    return nodes


def _profile(steps: _Steps, ceiling, nodes, rows: _Rows):
    """Stretches of constant acceleration: lengths [m], and the speed [m/s] at both ends of each.

    A line has up to three.
    """
    first, last = nodes[:-1], nodes[1:]
    with np.errstate(divide="ignore", over="ignore"):
        doubled = 2.0 * (rows.limit / rows.along).min(axis=1)
    faster = np.maximum(first, last)
    peak = 0.5 * (first + last + doubled * steps.length)
    peak = np.clip(peak, faster, ceiling)
    up = np.where(steps.straight, np.minimum((peak - first) / doubled, steps.length), steps.length)
    down = np.where(steps.straight, np.minimum((peak - last) / doubled, steps.length - up), 0.0)
    peak = np.where(steps.straight, peak, last)
    length = np.stack([up, steps.length - up - down, down], axis=1)
    squares = np.stack([first, peak, peak, last], axis=1)
    kept = length > 0
    return length[kept], np.sqrt(squares[:, :-1][kept]), np.sqrt(squares[:, 1:][kept])


def _sampled(length, first, last, end: float, dt: float, stops, rest) -> Float[np.ndarray, " T"]:
    """Samples of stretches, with rests at stops [m]."""
    ends, times = _cumulated(length), _cumulated(2.0 * length / (first + last))
    rests = Rests(np.interp(stops, ends, times), rest)
    samples = sample_count(np.ceil((times[-1] + rests.total) / dt - SAMPLE_ROUNDING))
    time = np.minimum(rests.moving(np.arange(samples + 1) * dt), times[-1])
    i = np.minimum(np.searchsorted(times, time, side="right") - 1, length.size - 1)
    acceleration, elapsed = 0.5 * (last**2 - first**2) / length, time - times[i]
    travelled = first[i] * elapsed + 0.5 * acceleration[i] * elapsed**2
    arc = np.minimum(ends[i] + np.clip(travelled, 0.0, length[i]), end)
    arc[-1] = end
    return arc


def _cumulated(values) -> np.ndarray:
    return np.concatenate([[0.0], np.cumsum(values)])


def sample_count(steps: float) -> int:
    """Samples of a run, no more than memory holds."""
    if not steps < MOST_SAMPLES:
        raise ValueError(
            f"feed, dt: the run would have {steps:.3g} samples, more than {MOST_SAMPLES}"
        )
    return int(steps)


def __dir__() -> list[str]:
    return __all__
