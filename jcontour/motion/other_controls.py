"""Motions of LinuxCNC and grbl along a path, by the rules that they document.

Both limit acceleration and not jerk. A path is a chain of legs, each with a greatest speed and
acceleration. The speeds at their joints follow from the control's rule for corners and from what
lies within its look-ahead.

    LinuxCNC  "Trajectory Control", G64: joints that turn little are passed; others are rounded by
              an arc within P, or, out of one plane, slowed down in while the next leg begins; a
              rapid move and a cut are never joined. Short lines within P become one.
    grbl      "Configuration": the speed in a corner is that on a circle at the junction deviation.

Where LinuxCNC's manual says no number, it was taken from samples of its servo thread (2.9): half of
the acceleration is left along arcs, and along legs that are not joined by one.
"""

import math
from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from jcontour.geometry.contour import Contour, unpadded
from jcontour.geometry.pieces import Piece

Control = Literal["linuxcnc", "grbl"]

ACROSS = math.sqrt(0.75)  # of the acceleration, on LinuxCNC's arcs, so that half is left along them
KINK = 0.1  # of the acceleration: a joint that asks for less within a cycle is passed
CYCLE = 1e-3  # [s] of LinuxCNC's servo thread
AHEAD = {"linuxcnc": 50, "grbl": 15}  # legs that are known ahead
MOST_CHAINED = 100  # lines that LinuxCNC makes one of
ALIKE = 1e-6  # of a direction: one that turns less goes straight on
SHORT = 1e-9  # [m]


class ControlLimits(NamedTuple):
    """Settings of a control, SI units."""

    control: Control  # whose they are
    # speed, acceleration: (m,) greatest of every axis
    speed: Float[np.ndarray, " m"]
    acceleration: Float[np.ndarray, " m"]
    # path_speed, path_acceleration: greatest along the path
    path_speed: float = math.inf
    path_acceleration: float = math.inf
    tolerance: float | None = None  # P of G64, from the path [m]; None as G64 without P
    junction_deviation: float = 10e-6  # of grbl [m]
    arc_tolerance: float = 2e-6  # of grbl's chords from an arc [m]

    def along(self, direction: np.ndarray) -> tuple[float, float]:
        """Greatest speed and acceleration along a direction."""
        share = np.maximum(np.abs(direction), ALIKE)
        speed, acceleration = (float(np.min(most / share)) for most in self[1:3])
        return min(speed, self.path_speed), min(acceleration, self.path_acceleration)

    def in_plane(self, one: np.ndarray, other: np.ndarray) -> tuple[float, float]:
        """Greatest speed and acceleration in every direction of a plane of two unit vectors."""
        second = other - (one @ other) * one
        size = float(np.linalg.norm(second))
        return self.along(one if size < ALIKE else np.hypot(one, second / size))


class Leg(NamedTuple):
    """A line or an arc that is run at once."""

    # begin, end: arc length on the contour there [m]
    begin: float
    end: float
    start: np.ndarray  # its first point [m]
    # leaves, arrives: unit tangents at its ends
    leaves: np.ndarray
    arrives: np.ndarray
    length: float  # of it [m]
    speed: float  # greatest [m/s]
    acceleration: float  # along it [m/s^2]
    after: int  # piece of the contour that it ends with; -1 inside of one
    rapid: bool  # whether it is a rapid move
    bent: bool = False  # whether it is the curved piece `after`
    radius: float = 0.0  # of a rounded corner [m]; 0 for others
    # within which the next leg begins before this one has ended [m]; 0 for not
    tolerance: float = 0.0


class ControlMotion(NamedTuple):
    """Samples of a motion: arc length on the contour, place [m], unit tangent; cycle time [s]."""

    arc: Float[np.ndarray, " T"]
    place: Float[np.ndarray, "T m"]
    tangent: Float[np.ndarray, "T m"]
    duration: float


def as_planned_by(
    limits: ControlLimits,
    contour: Contour,
    feed: Float[np.ndarray, " P"],
    rapid: Bool[np.ndarray, " P"],
    rest: Float[np.ndarray, " P"],
    dt: float,
) -> ControlMotion:
    """Motion of a control from rest to rest along a contour, sampled.

    Args:
        limits: of the control.
        contour: one contour, not a stack.
        feed: greatest speed on every piece that is cut [m/s].
        rapid: which pieces are rapid moves, at the limits of the axes.
        rest: how long the tool rests behind every piece [s]; NaN where it goes on.
        dt: sample period [s].
    """
    from jcontour.motion.phase_plane import sweep  # loads Numba

    pieces = unpadded(contour)
    feed = np.where(rapid, np.inf, feed)
    legs = _legs(pieces, feed, rapid, limits)
    if limits.control == "linuxcnc":
        legs, joints = _joined(_chained(legs, rest, limits.tolerance), rest, limits)
    else:
        joints = [
            0.0
            if last.after >= 0 and not np.isnan(rest[last.after])
            else corner_speed(last, leg, limits)
            for last, leg in zip(legs, legs[1:], strict=False)
        ]
    # v_k^2 <= v_(k+1)^2 + 2 a_k L_k at the ends of legs, and the same forwards. What lies more than
    # `AHEAD` legs ahead is not known yet: the motion could stop before it.
    gain = np.array([2 * leg.acceleration * leg.length for leg in legs])
    fastest = np.array([leg.speed for leg in legs])
    square = np.zeros(len(legs) + 1)
    square[1:-1] = np.minimum(joints, np.minimum(fastest[1:], fastest[:-1])) ** 2
    total = np.append(0.0, np.cumsum(gain))
    known = np.minimum(np.arange(len(legs) + 1) + AHEAD[limits.control], len(legs))
    square = np.minimum(square, total[known] - total)
    sweep(np.stack([1.0 + 0.0 * gain, gain, gain, 0.0 * gain])[..., None], square)
    speeds = np.sqrt(square)
    return _sampled(pieces, legs, speeds, np.nan_to_num(np.append(rest, 0.0)), dt)


def corner_speed(last: Leg, leg: Leg, limits: ControlLimits) -> float:
    """Speed on a circle that touches both lines: v^2 = a R, R = d sin(h) / (1 - sin(h)).

    d is the junction deviation and h half of the angle between the lines.
    """
    cosine = float(-last.arrives @ leg.leaves)
    if abs(cosine) > 1 - ALIKE:
        return 0.0 if cosine > 0 else math.inf
    sine = math.sqrt(0.5 * (1 - cosine))
    across = leg.leaves - last.arrives
    _, most = limits.along(across / np.linalg.norm(across))
    return math.sqrt(most * limits.junction_deviation * (sine / (1 - sine)))


def _legs(pieces: Piece, feed: np.ndarray, rapid: np.ndarray, limits: ControlLimits) -> list[Leg]:
    """Legs of all pieces; grbl runs arcs as chords."""
    begins = np.append(0.0, np.cumsum(pieces.extent))
    bends = np.linalg.norm(pieces.jet(0.0 * pieces.extent)[2], axis=1)
    legs = []
    for k, extent in enumerate(pieces.extent):
        count, bend = 1, float(bends[k])
        bent = bend * extent > ALIKE and limits.control == "linuxcnc"
        if bend * extent > ALIKE and not bent:
            height = min(limits.arc_tolerance, 0.5 / bend)
            chord = 2 * math.sqrt(height * (2 / bend - height))
            count = max(1, math.floor(extent / chord))
        marks = np.linspace(0.0, extent, count + 1)
        place, velocity, acceleration = pieces.taken(np.full(count + 1, k)).jet(marks)
        velocity /= np.linalg.norm(velocity, axis=1, keepdims=True)
        for j in range(count):
            begin, end = float(begins[k] + marks[j]), float(begins[k] + marks[j + 1])
            leaves, arrives, length = velocity[j], velocity[j + 1], end - begin
            if bent:
                speed, most = limits.in_plane(leaves, acceleration[j] / bend)
                speed, most = min(speed, math.sqrt(ACROSS * most / bend)), 0.5 * most
            else:
                way = place[j + 1] - place[j]
                length = float(np.linalg.norm(way))
                leaves = arrives = way / length
                speed, most = limits.along(leaves)
            speed, after = min(speed, float(feed[k])), k if j == count - 1 else -1
            line = begin, end, place[j], leaves, arrives, length
            legs.append(Leg(*line, speed, most, after, bool(rapid[k]), bent))
    return legs


def _chained(legs: list[Leg], rest: np.ndarray, tolerance: float | None) -> list[Leg]:
    """Lines that follow one another within a tolerance, as one."""
    chain: list[Leg] = []
    passed: list[np.ndarray] = []  # ends of the lines in the last leg
    for leg in legs:
        last, end = (chain[-1] if chain else None), leg.start + leg.length * leg.leaves
        if (
            tolerance
            and last is not None
            and not (last.bent or leg.bent or last.rapid != leg.rapid)
            and np.isnan(rest[last.after])
            and len(passed) <= MOST_CHAINED
        ):
            length = float(np.linalg.norm(end - last.start))
            direction = (end - last.start) / max(length, SHORT)
            ways = np.array(passed) - last.start
            along = np.clip(ways @ direction, 0.0, length)[:, None]
            if np.linalg.norm(ways - along * direction, axis=1).max() <= tolerance:
                chain[-1] = last._replace(
                    end=leg.end,
                    leaves=direction,
                    arrives=direction,
                    length=length,
                    speed=min(last.speed, leg.speed),
                    acceleration=min(last.acceleration, leg.acceleration),
                    after=leg.after,
                )
                passed.append(end)
                continue
        chain.append(leg)
        passed = [end]
    return chain


def _joined(
    chain: list[Leg], rest: np.ndarray, limits: ControlLimits
) -> tuple[list[Leg], list[float]]:
    """Legs of LinuxCNC with its rounded corners, and the speeds at their joints."""
    legs, joints, halved = [chain[0]], [], False
    for before, leg in zip(chain, chain[1:], strict=False):
        last, slow = legs[-1], False
        speed = min(last.speed, leg.speed)
        turn = np.abs(last.arrives - leg.leaves) / limits.acceleration
        asked = speed * float(turn.max()) / CYCLE
        if last.rapid != leg.rapid or not np.isnan(rest[last.after]):
            joints.append(0.0)
        elif asked < KINK:
            legs[-1] = last._replace(acceleration=last.acceleration * (1 - asked))
            leg = leg._replace(acceleration=leg.acceleration * (1 - asked))
            joints.append(speed)
        elif (rounded := _rounded(last, leg, min(before.length, leg.length), limits)) is not None:
            legs[-1], arc, leg = rounded
            legs.append(arc)
            joints += [arc.speed, arc.speed]
        else:
            slow = True
            legs[-1] = last._replace(
                acceleration=last.acceleration * (1.0 if halved else 0.5),
                tolerance=limits.tolerance or math.inf,
            )
            leg = leg._replace(acceleration=0.5 * leg.acceleration)
            joints.append(0.0)
        halved = slow
        legs.append(leg)
    if np.isnan(rest[-1]) and not halved:  # it waits for a leg to join
        legs[-1] = legs[-1]._replace(acceleration=0.5 * legs[-1].acceleration)
    return legs, joints


def _rounded(
    last: Leg, leg: Leg, shorter: float, limits: ControlLimits
) -> tuple[Leg, Leg, Leg] | None:
    """Two legs cut short and the arc between them; None out of one plane or without room."""
    half = 0.5 * math.acos(np.clip(-last.arrives @ leg.leaves, -1.0, 1.0))
    second = leg.leaves - (last.arrives @ leg.leaves) * last.arrives
    second /= max(float(np.linalg.norm(second)), ALIKE)
    for other in (last.leaves, leg.arrives):
        aside = other - (other @ last.arrives) * last.arrives - (other @ second) * second
        if float(np.linalg.norm(aside)) > ALIKE:
            return None
    fastest, most = limits.in_plane(last.arrives, leg.leaves)
    tolerance = limits.tolerance or 0.25 * shorter
    room = min(math.cos(half) * tolerance / (1 - math.sin(half)), 0.5 * shorter, last.length)
    goal = min(max(last.speed, leg.speed), fastest)
    speed = min(goal, math.sqrt(ACROSS * most * math.tan(half) * room))
    radius = speed**2 / (ACROSS * most)
    length = radius * (math.pi - 2 * half)
    if length < speed * CYCLE * KINK or radius < SHORT:
        return None
    back = radius / math.tan(half)
    end = last.end - back * (last.end - last.begin) / last.length
    begin = leg.begin + back * (leg.end - leg.begin) / leg.length
    start = leg.start - back * last.arrives
    arc = Leg(
        *(end, begin, start, last.arrives, leg.leaves, length, speed, 0.5 * most, last.after),
        *(leg.rapid, False, radius),
    )
    later = leg._replace(begin=begin, length=leg.length - back, start=leg.start + back * leg.leaves)
    return last._replace(end=end, length=last.length - back), arc, later


def _peak(leg: Leg, begin: float, end: float) -> float:
    """Greatest speed on a leg between speeds at its ends [m/s]."""
    reached = math.sqrt(leg.acceleration * leg.length + 0.5 * (begin**2 + end**2))
    return float(max(min(reached, leg.speed), begin, end))


def _sampled(
    pieces: Piece, legs: list[Leg], speeds: np.ndarray, rest: np.ndarray, dt: float
) -> ControlMotion:
    """Places at every sample of trapezoidal motions from joint to joint."""
    begins = np.zeros(len(legs) + 1)  # [s]
    phases = np.zeros((len(legs), 6))
    for k, leg in enumerate(legs):
        first, last = float(speeds[k]), float(speeds[k + 1])
        peak = _peak(leg, first, last)
        rise, fall = (peak - first) / leg.acceleration, (peak - last) / leg.acceleration
        ramps = 0.5 * (first + peak) * rise + 0.5 * (peak + last) * fall
        flat = max(leg.length - ramps, 0.0) / peak
        phases[k] = first, last, leg.acceleration, rise, flat, fall
        begins[k + 1] = begins[k] + rise + flat + fall + (0.0 if leg.radius else rest[leg.after])
        if leg.tolerance:
            later = legs[k + 1]
            half = 0.5 * math.acos(np.clip(-leg.arrives @ later.leaves, -1.0, 1.0))
            within = 2 * math.sqrt(leg.tolerance / (leg.acceleration * math.cos(half)))
            rises = _peak(later, 0.0, speeds[k + 2]) / later.acceleration
            begins[k + 1] -= min(fall, within, rises)
    at = dt * np.arange(math.ceil(begins[-1] / dt) + 1)
    now = np.clip(np.searchsorted(begins, at, side="right") - 1, 0, len(legs) - 1)
    arc, place, tangent = _on_legs(pieces, legs, phases, now, at - begins[now])
    before = np.maximum(now - 1, 0)
    late = np.flatnonzero((now > 0) & (at - begins[before] < phases[before, 3:].sum(axis=1)))
    if late.size:  # the leg before has not ended yet
        was, since = before[late], (at - begins[before])[late]
        moving = _on_legs(pieces, legs, phases, was, since)
        ended = _on_legs(pieces, legs, phases, was, np.full(late.size, np.inf))
        arc[late] += moving[0] - ended[0]
        place[late] += moving[1] - ended[1]
    return ControlMotion(arc, place, tangent, float(begins[-1]))


def _on_legs(
    pieces: Piece, legs: list[Leg], phases: np.ndarray, now: np.ndarray, since: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Arc lengths, places and tangents on legs so long after each has begun [s]."""
    columns = [np.array(column)[now] for column in zip(*legs, strict=True)]
    begin, end, start, leaves, arrives, length, _, _, after, _, bent, radius, _ = columns
    first, last, gain, rise, flat, fall = phases[now].T
    since = np.clip(since, 0.0, rise + flat + fall)
    rising, left = np.minimum(since, rise), np.minimum(rise + flat + fall - since, fall)
    way = first * rising + 0.5 * gain * rising**2
    way += np.clip(since - rise, 0.0, flat) * (first + gain * rise)
    way += (fall - left) * (last + 0.5 * gain * (fall + left))
    way = np.clip(way, 0.0, length)
    arc = begin + way / np.maximum(length, 1e-3 * SHORT) * (end - begin)  # blends may meet
    place, tangent = start + way[:, None] * leaves, leaves.copy()
    round_ = np.flatnonzero(radius)
    if round_.size:
        turned, ahead = (way / np.maximum(radius, SHORT))[round_, None], leaves[round_]
        inwards = arrives[round_] - np.sum(arrives[round_] * ahead, axis=1, keepdims=True) * ahead
        inwards /= np.linalg.norm(inwards, axis=1, keepdims=True)
        aside = np.sin(turned) * ahead + (1 - np.cos(turned)) * inwards
        place[round_] = start[round_] + radius[round_, None] * aside
        tangent[round_] = np.cos(turned) * ahead + np.sin(turned) * inwards
    on = np.flatnonzero(bent)
    if on.size:
        starts = np.append(0.0, np.cumsum(pieces.extent))[after[on]]
        place[on], velocity, _ = pieces.taken(after[on]).jet(arc[on] - starts)
        tangent[on] = velocity / np.linalg.norm(velocity, axis=1, keepdims=True)
    return arc, place, tangent
