"""Motions of piecewise constant jerk along a path: what a warp of time starts from; straight lines.

Stretches between two stops that are one straight line at one feed have their motion in closed form.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy.linalg import solve_banded

from jcontour._compiled import compiled
from jcontour.geometry.pieces import Piece
from jcontour.motion.jerk_limited.limits import AxisLimits, curved
from jcontour.motion.point_to_point import PointToPoint

# of a stretch: where a ramp ends, and the two halves of it
RAMP = 0.5
NEWTON_STEPS = 60
ROUNDING = 1e-16  # of a cell's duration: a smaller step changes nothing
FRACTIONS = np.array([0.25, 0.5, 0.75])  # of a cell at which a spline is looked at
Jet = tuple[np.ndarray, np.ndarray, np.ndarray]  # first, second and third derivative, axes last
SAME = 1e-9  # of the duration: places passed so near a change of the jerk begin no node


class MotionSamples(NamedTuple):
    """Arc length [m] and its derivatives with respect to time [m/s, m/s^2, m/s^3]."""

    arc: np.ndarray
    speed: np.ndarray
    acceleration: np.ndarray
    jerk: np.ndarray


def composed(path: Float[np.ndarray, "3 ... m"], motion: MotionSamples) -> Jet:
    """First, second and third derivative of p(sigma(tau)) with respect to tau, axes last."""
    first, second, third = path
    v, a, j = (values[..., None] for values in motion[1:])
    return (
        first * v,
        second * v**2 + first * a,
        third * v**3 + 3 * second * v * a + first * j,
    )


class CubicMotion(NamedTuple):
    """Motion s(tau), a cubic between neighbouring times, with continuous acceleration."""

    time: Float[np.ndarray, " nodes"]  # of the nodes [s]
    # (n, 4) of every stretch between nodes: arc length, speed, half the acceleration, a sixth of
    # the jerk
    coefficients: Float[np.ndarray, "n 4"]

    def on_cell(self, cell: Int[np.ndarray, "..."], elapsed: np.ndarray) -> MotionSamples:
        """Motion so long after the beginning of the stretch between nodes `cell`."""
        s, v, a, j = np.moveaxis(self.coefficients[cell], -1, 0)
        t = elapsed
        arc = s + t * (v + t * (a + t * j))
        return MotionSamples(arc, v + t * (2 * a + 3 * t * j), 2 * a + 6 * t * j, 6 * j + 0 * t)

    def at(self, time: np.ndarray) -> MotionSamples:
        """Motion at times within its duration."""
        last = len(self.coefficients) - 1
        cell = np.clip(np.searchsorted(self.time, time, side="right") - 1, 0, last)
        return self.on_cell(cell, time - self.time[cell])

    def reached(self, arc: Float[np.ndarray, " k"]) -> Float[np.ndarray, " k"]:
        """Times at which arc lengths [m] are reached."""
        starts = self.coefficients[:, 0]
        cell = np.clip(np.searchsorted(starts, arc, side="right") - 1, 0, starts.size - 1)
        lasting, since = np.diff(self.time)[cell], np.empty(arc.size)
        _fill_elapsed(self.coefficients[cell].ravel(), lasting, arc, since)
        return self.time[cell] + since


@compiled
def _fill_elapsed(cubics, lasting, arc, since):
    """Write the times since the beginning of cubics at which arc lengths are reached.

    By Newton's method, and bisection where it leaves the interval.
    """
    for i in range(arc.size):
        s, v, a, j = cubics[4 * i], cubics[4 * i + 1], cubics[4 * i + 2], cubics[4 * i + 3]
        low, high = 0.0, lasting[i]
        t = 0.5 * high
        for _ in range(NEWTON_STEPS):
            beyond = s + t * (v + t * (a + t * j)) - arc[i]
            if beyond > 0:
                high = t
            else:
                low = t
            speed, before = v + t * (2 * a + 3 * t * j), t
            t = 0.5 * (low + high)
            if speed > 0:
                newton = before - beyond / speed
                t = newton if low < newton < high else t
            if abs(t - before) <= ROUNDING * lasting[i]:
                break
        since[i] = t


def ramped(stops: Float[np.ndarray, " k"], ramp: Float[np.ndarray, " r"]) -> CubicMotion:
    """Motion from stop to stop that ramps up to 1 m/s over a length, goes on, and ramps down.

    Args:
        stops: arc lengths of the stops [m], those of both ends among them.
        ramp: (k-1,) length of both ramps of every stretch [m]; a stretch of no length is left out.
    """
    length = np.diff(stops)
    moves = length > 0
    starts, length, ramp = stops[:-1][moves], length[moves], ramp[moves]
    ramp = np.minimum(ramp, RAMP * length)
    cruise = np.maximum(length - 2 * ramp, 0.0)
    jerk = 1.0 / ramp**2  # half a ramp takes ramp / (1 m/s)
    durations = np.stack([ramp, ramp, cruise, ramp, ramp], axis=1).ravel()
    jerks = np.stack([jerk, -jerk, 0 * jerk, -jerk, jerk], axis=1).ravel()
    one = np.ones_like(ramp)
    speeds = np.stack([0 * one, 0.5 * one, one, one, 0.5 * one], axis=1).ravel()
    accelerations = np.stack([0 * one, 1 / ramp, 0 * one, 0 * one, -1 / ramp], axis=1).ravel()
    places = np.cumsum(
        np.stack([0 * one, ramp / 6, 5 * ramp / 6, cruise, 5 * ramp / 6], axis=1), axis=1
    )
    arcs = (starts[:, None] + places).ravel()
    coefficients = np.stack([arcs, speeds, accelerations / 2, jerks / 6], axis=1)
    kept = durations > 0
    time = np.concatenate([[0.0], np.cumsum(durations[kept])])
    return CubicMotion(time, coefficients[kept])


def through(
    time: Float[np.ndarray, " k"], arc: Float[np.ndarray, " k"], ends: Int[np.ndarray, " ends"]
) -> list[CubicMotion] | None:
    """Motions from rest to rest through places at times: cubic splines; None if one goes back.

    With accelerations M at nodes that are h apart, the speed has no jump at the inner nodes:

        h_i-1 M_i-1 / 6 + (h_i-1 + h_i) M_i / 3 + h_i M_i+1 / 6 = v_i - v_i-1,

    where v are the mean speeds between them. The first and the last interval of a motion have one
    more node in the middle, so that speed and acceleration vanish at both ends. Constant jerk from
    rest is M h^2 / 6 away there, which takes its place out of the equations.

    Args:
        time: times of all motions [s], one after the other; at least three of each.
        arc: places [m].
        ends: index at which every motion begins, and the end of the last.
    """
    halved = np.stack([ends[:-1], ends[1:] - 2], axis=1).ravel()  # intervals with one more node
    node = np.insert(time, halved + 1, 0.5 * (time[halved] + time[halved + 1]))
    place = np.insert(arc, halved + 1, arc[np.stack([ends[:-1], ends[1:] - 1], axis=1).ravel()])
    first = ends + 2 * np.arange(ends.size)  # node of every motion, and the end of the last
    start, stop = first[:-1], first[1:] - 1
    h = np.diff(node)
    h[stop[:-1]] = 1.0  # between two motions
    main, change = np.ones(node.size), np.zeros(node.size)
    main[1:-1], change[1:-1] = (h[:-1] + h[1:]) / 3, np.diff(np.diff(place) / h)
    below, above = h / 6, h / 6  # what the node before counts, and the one behind
    main[start + 1], main[stop - 1] = h[start], h[stop - 1]
    main[start], main[stop], change[start], change[stop] = 1.0, 1.0, 0.0, 0.0
    above[start], above[stop - 2], above[stop[:-1]] = 0.0, 0.0, 0.0
    below[start + 1], below[stop - 1], below[stop[:-1]] = 0.0, 0.0, 0.0
    bands = np.stack([np.append(0.0, above), main, np.append(below, 0.0)])
    push = solve_banded((1, 1), bands, change)
    place[start + 1] += push[start + 1] * h[start] ** 2 / 6
    place[stop - 1] += push[stop - 1] * h[stop - 1] ** 2 / 6
    speed = np.diff(place) / h - h * (2 * push[:-1] + push[1:]) / 6
    speed[start] = 0.0
    powers = np.stack([place[:-1], speed, push[:-1] / 2, np.diff(push) / h / 6], axis=1)
    inside = np.delete(np.arange(len(powers)), stop[:-1])
    on = CubicMotion(node, powers).on_cell(inside, FRACTIONS[:, None] * h[inside]).speed
    if not ((on > 0).all() and (np.delete(speed, np.append(start, stop[:-1])) > 0).all()):
        return None
    return [CubicMotion(node[a : b + 1], powers[a:b]) for a, b in zip(start, stop, strict=True)]


def joined(motions: list[CubicMotion]) -> CubicMotion:
    """One motion after the other, each in places of its own, without cells of no duration."""
    ends = np.cumsum([0.0, *(motion.time[-1] - motion.time[0] for motion in motions)])
    times = [
        motion.time[:-1] - motion.time[0] + end for motion, end in zip(motions, ends, strict=False)
    ]
    time = np.concatenate([*times, ends[-1:]])
    lasts = np.diff(time) > 0
    coefficients = np.concatenate([motion.coefficients for motion in motions])[lasts]
    return CubicMotion(time[np.append(lasts, True)], coefficients)


def straight_motions(
    pieces: Piece,
    feed: Float[np.ndarray, " P"],
    limits: AxisLimits,
    stretch: Int[np.ndarray, " P"],
) -> list[CubicMotion | None]:
    """Quickest motion of every stretch from rest to rest; None where it bends or changes its feed.

    An axis moves with its part t_i of the direction, so that along the line the limits are the
    least ones of V_i / |t_i|, A_i / |t_i| and J_i / |t_i|; `PointToPoint` is the motion under them.
    A node is where a piece begins.

    Args:
        pieces: of the path.
        feed: greatest speed on every piece [m/s].
        limits: of the axes.
        stretch: number of the stretch of every piece.
    """
    begins = np.flatnonzero(np.diff(stretch, prepend=-1))
    direction = np.abs(pieces.polynomial[:, 1])
    with np.errstate(divide="ignore", over="ignore"):
        speed, acceleration, jerk = (
            np.minimum.reduceat((limit / direction).min(axis=1), begins) for limit in limits
        )
    speed = np.minimum(speed, np.minimum.reduceat(feed, begins))
    even = np.maximum.reduceat(feed, begins) == np.minimum.reduceat(feed, begins)
    flat = even & ~np.logical_or.reduceat(curved(pieces), begins)
    starts = np.append(0.0, np.cumsum(pieces.extent))
    ends = np.append(begins[1:], stretch.size)
    motions: list[CubicMotion | None] = [None] * begins.size
    for k in np.flatnonzero(flat):
        places = starts[begins[k] : ends[k] + 1]
        law = PointToPoint(float(places[-1] - places[0]), speed[k], acceleration[k], jerk[k])
        motions[k] = _line(places, law)
    return motions


def _line(places: Float[np.ndarray, " n"], law: PointToPoint) -> CubicMotion:
    """A law from the first place [m] to the last, with a node at every place."""
    start, arc, speed, acceleration, jerk = law.phases
    powers = np.stack([places[0] + arc, speed, acceleration / 2, jerk / 6], axis=1)
    whole = CubicMotion(np.append(start, law.duration), powers)
    passed = whole.reached(places[1:-1])
    after = np.searchsorted(whole.time, passed)
    apart = np.minimum(passed - whole.time[after - 1], whole.time[after] - passed)
    time = np.unique(np.concatenate([whole.time, passed[apart > SAME * law.duration]]))
    cell = np.searchsorted(start, time[:-1], side="right") - 1
    s, v, a, j = whole.on_cell(cell, time[:-1] - start[cell])
    return CubicMotion(time, np.stack([s, v, a / 2, j / 6], axis=1))
