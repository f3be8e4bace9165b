"""Moves of the tool with stops between them, arcs from words, and stops in words."""

import cmath
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from jcontour.geometry.gcode._expressions import whole
from jcontour.geometry.gcode.modes import ZERO, Modes, Point
from jcontour.geometry.toolpath_rules import FARTHEST, INCH, MM, MOST_MOVES, SHORTEST, ToolpathError

DWELL, UP_OR_DOWN = "G4", "Z"  # why a stop is made
# first and second axis of the plane, then its normal
PLANES = {170: (0, 1, 2), 180: (2, 0, 1), 190: (1, 2, 0)}
# difference between both radii of an arc, as LinuxCNC allows it: what rounding of the end and the
# centre to a hundredth of a millimetre or a thousandth of an inch makes, or a part of the radius
ARC_SLACK = 0.02 * math.sqrt(2.0) * MM  # [m] of programs in mm
ARC_SLACK_INCH = 0.002 * math.sqrt(2.0) * INCH  # [m] of programs in inches
ARC_SLACK_RELATIVE = 1e-3  # of the larger radius, up to
ARC_SLACK_TIMES = 100.0  # of the slack
# how much too short a radius (R) may be, as Grbl allows it
RADIUS_SLACK = 5e-6  # [m]
RADIUS_SLACK_RELATIVE = 1e-3  # of the radius, up to RADIUS_SLACK_MOST
RADIUS_SLACK_MOST = 0.5e-3  # [m]
Arcs = list[tuple[complex, complex, float]]  # end, centre [m] and angle [rad] of one after another
CENTRES = "IJK"
FARTHEST_CENTRE = 1e4  # [m]: CAM systems write arcs that bend by less than a micrometre
MOST_TURNS = 10_000  # of an arc, and holes of a cycle
MOST_REASONS = 6  # reasons to stop that are listed
START = "start"  # why, of what comes before the first cut
EXACT = {"G61.1": "after every move", "G61": "in corners"}  # why, and where


class Move(NamedTuple):
    """A line, or an arc or helix where `angle` is not zero."""

    start: Point  # first point [m]
    end: Point  # last point [m]
    centre: Point  # of the arc, in the plane of its start [m]
    angle: float  # turned [rad], positive counter-clockwise around the plane's normal
    normal: int  # axis number of the plane's normal
    feed: float  # speed along the move [m/s], NaN for a rapid move
    rapid: bool  # whether it is one (G0)
    line: int  # of the program, from 1


class Stop(NamedTuple):
    """A place between two moves where the tool comes to rest, for a time in a dwell."""

    after: int  # how many moves come before it
    place: Point  # where it rests [m]
    lasting: float  # for how long [s], 0 for a stop alone
    line: int  # of the program, from 1
    why: str  # words of the program that ask for it, as G4 or M8 M3
    besides: float = 0.0  # how long an axis that is not traced moves meanwhile [s]; NaN at traverse


def check_near(lengths: Iterable[float]) -> None:
    """Raise ToolpathError if any of these lengths [m] is too large for a machine."""
    for length in lengths:
        if not abs(length) <= FARTHEST:
            raise ToolpathError(f"a coordinate is farther than {FARTHEST:g} m away")


@dataclass
class Tracer:
    """Place of a machine, and its moves so far."""

    axes: int  # 3, or 2 where only X and Y are traced
    at: Point = ZERO  # place on the machine [m]
    line: int = 0  # of the program that is carried out
    moves: list[Move] = field(default_factory=list)  # made so far
    stops: list[Stop] = field(default_factory=list)  # between them, so far

    def add(self, end: Point, centre: Point, angle: float, feed: float, plane: int) -> None:
        """Add a move; one too short to see only moves the axes that are not traced, and stops.

        Raises:
            ToolpathError: it ends too far away, there are too many, or two axes cut in another
                plane than XY.
        """
        check_near(end)
        if angle == 0.0 and math.dist(self.at[: self.axes], end[: self.axes]) < SHORTEST:
            if self.axes == 2:
                rise = abs(end[2] - self.at[2])
                self.at = self.at[0], self.at[1], end[2]
                if rise >= SHORTEST:  # X and Y stand still meanwhile
                    self.stop(UP_OR_DOWN, besides=rise / feed)
            return
        rapid = math.isnan(feed)
        normal = PLANES[plane][2]
        if self.axes == 2 and normal < 2 and not rapid:
            raise ToolpathError(
                f"a cut in the plane of G{plane // 10} needs a third axis: "
                'a --plant of three axes, or axes "XYZ"'
            )
        self.moves.append(Move(self.at, end, centre, angle, normal, feed, rapid, self.line))
        self.at = end
        if len(self.moves) > MOST_MOVES:
            raise ToolpathError(f"more than {MOST_MOVES} moves")

    def add_line(self, end: Point, feed: float, plane: int) -> None:
        """Add a straight move, rapid where it has no feed (NaN)."""
        self.add(end, end, 0.0, feed, plane)

    def dwell(self, lasting: float, word: str) -> None:
        """Rest for a time [s], which `word` of the program gives.

        Raises:
            ToolpathError: the time is negative, or there are too many stops.
        """
        if not lasting >= 0:
            raise ToolpathError(f"{word}{lasting:g}: a dwell needs seconds, not below 0")
        self.stop(DWELL, lasting)

    def stop(self, why: str, lasting: float = 0.0, besides: float = 0.0) -> None:
        """Come to rest, for a time in a dwell [s]; see `Stop`.

        Before the first move there is nothing to stop, but an axis that is not traced may move.

        Raises:
            ToolpathError: there are too many stops.
        """
        if not (self.moves or lasting or besides > 0):
            return
        self.stops.append(Stop(len(self.moves), self.at, lasting, self.line, why, besides))
        if len(self.stops) > MOST_MOVES:
            raise ToolpathError(f"more than {MOST_MOVES} stops")


def arcs_between(
    start: complex, end: complex, centre: complex, counter_clockwise: bool, slack: float = ARC_SLACK
) -> Iterator[tuple[complex, complex, float]]:
    """Ends, centres and signed angles of the one or two arcs which run exactly from start to end.

    The given centre may be slightly off: both radii may differ by `slack` [m], or by a thousandth
    up to a hundred times that.

    Raises:
        ToolpathError: the end is off its circle, or there is no radius.
    """
    first, last = abs(start - centre), abs(end - centre)
    most = min(ARC_SLACK_RELATIVE * max(first, last), ARC_SLACK_TIMES * slack)
    if abs(first - last) > max(slack, most):
        raise ToolpathError(
            f"the end of the arc is off its circle: the radius is {first / MM:.6g} mm at the start "
            f"and {last / MM:.6g} mm at the end, {abs(first - last) / MM:.3g} mm apart"
        )
    if min(first, last) < SHORTEST:
        raise ToolpathError("an arc without a radius")
    chord = end - start
    if abs(chord) < SHORTEST:
        yield start, centre, math.copysign(math.tau, 1 if counter_clockwise else -1)
        return
    angle = angle_between(start - centre, end - centre, counter_clockwise)
    from_middle = (centre - 0.5 * (start + end)) / chord
    if abs(angle) > math.pi and abs(from_middle.real * chord) > SHORTEST:
        middle = centre + (start - centre) * cmath.rect(0.5 * (first + last) / first, 0.5 * angle)
        yield from arcs_between(start, middle, centre, counter_clockwise, slack)
        yield from arcs_between(middle, end, centre, counter_clockwise, slack)
        return
    centre = 0.5 * (start + end) + 1j * from_middle.imag * chord  # on the bisector of the chord
    yield end, centre, angle_between(start - centre, end - centre, counter_clockwise)


def angle_between(first: complex, last: complex, counter_clockwise: bool) -> float:
    """Signed angle from one radius to the other, a whole turn when they agree."""
    turned = cmath.phase(last / first) * (1 if counter_clockwise else -1) % math.tau
    turned = math.tau if turned * abs(first) < SHORTEST else turned
    return turned if counter_clockwise else -turned


def arcs_of(
    values: dict[str, float], here: Point, there: Point, modes: Modes, counter_clockwise: bool
) -> Arcs:
    """Arcs in the plane in force from one point to another, both of the program [m].

    Raises:
        ToolpathError: neither a centre nor a radius, or both; one that does not fit the points.
    """
    first, second, normal = PLANES[modes.plane]
    letters = CENTRES[first], CENTRES[second]
    if any(letter in values for letter in CENTRES) == ("R" in values):
        raise ToolpathError("an arc needs either a centre (I, J, K) or a radius (R)")
    if values.get(CENTRES[normal]):
        raise ToolpathError(f"{CENTRES[normal]} is not in the plane of G{modes.plane // 10}")
    if "R" not in values and modes.absolute_centres and not values.keys() >= set(letters):
        raise ToolpathError(f"a centre under G90.1 needs {' and '.join(letters)}")
    start, end = complex(here[first], here[second]), complex(there[first], there[second])
    lengths = [values.get(letter, 0.0) * modes.unit for letter in ("R", *letters)]
    if not all(abs(length) <= FARTHEST_CENTRE for length in lengths):
        raise ToolpathError(f"the centre of an arc is farther than {FARTHEST_CENTRE:g} m away")
    offset = complex(*lengths[1:])
    if "R" in values:
        centre = _centre_from_radius(start, end, lengths[0], counter_clockwise)
    else:
        centre = offset if modes.absolute_centres else start + offset
    slack = ARC_SLACK_INCH if modes.unit == INCH else ARC_SLACK
    try:
        arcs = list(arcs_between(start, end, centre, counter_clockwise, slack))
    except ToolpathError as error:
        if "R" in values or modes.absolute_centres:
            raise
        try:
            list(arcs_between(start, end, offset, counter_clockwise, slack))
        except ToolpathError:
            raise error from None
        text = "in absolute coordinates its centre fits: G90.1 says so"
        raise ToolpathError(f"{error}; {text}") from None
    turns = whole(values.get("P", 1.0), "P of an arc")
    if not 1 <= turns <= MOST_TURNS:
        raise ToolpathError(f"P of an arc needs to be 1 to {MOST_TURNS}, received {turns}")
    if turns > 1:
        whole_turn = math.copysign(math.tau, arcs[0][2])
        arcs = [(start, arcs[0][1], whole_turn)] * (turns - 1) + arcs
    return arcs


def _centre_from_radius(
    start: complex, end: complex, radius: float, counter_clockwise: bool
) -> complex:
    """Centre of the arc of a radius [m], below zero for the long way round."""
    chord = end - start
    half, size = 0.5 * abs(chord), abs(radius)
    if 2 * half < SHORTEST:
        raise ToolpathError(
            "an arc by radius (R) needs an end apart from its start; a full circle needs I, J or K"
        )
    slack = max(RADIUS_SLACK, min(RADIUS_SLACK_RELATIVE * size, RADIUS_SLACK_MOST))
    if size < SHORTEST or half - size > slack:
        raise ToolpathError(
            f"a radius of {size / MM:.6g} mm does not reach the end of the arc, "
            f"{2 * half / MM:.6g} mm away"
        )
    height = math.sqrt(max(radius**2 - half**2, 0.0))
    to_the_left = counter_clockwise == (radius > 0)
    return start + chord * (0.5 + (1j if to_the_left else -1j) * height / abs(chord))


def stops_in_cuts(stops: Sequence[Stop], moves: Sequence[Move]) -> list[Stop]:
    """Stops from the first cut on, to the end of the last one or until Z leaves it alone."""
    cuts = [k for k, move in enumerate(moves) if not move.rapid]
    if not cuts:
        return []
    within = [stop for stop in stops if cuts[0] < stop.after <= cuts[-1] + 1]
    leaves = (cuts[-1] + 1, UP_OR_DOWN)
    left = (k for k, stop in enumerate(within) if (stop.after, stop.why) == leaves)
    return within[: next(left, len(within))]


def stop_summary(stops: Sequence[Stop]) -> str:
    """Where and why a motion stops, in words; empty where it does not.

    What Z alone takes while two axes wait is listed apart.

    >>> rest = (0.0, 0.0, 0.0)
    >>> stop_summary([Stop(1, rest, 0.0, 4, "M3"), Stop(2, rest, 0.5, 9, "G4")])
    '2 stops: M3 at line 4, G4 at line 9 (0.5 s)'
    """
    by_reason: dict[str, list[Stop]] = {}
    for stop in stops:
        by_reason.setdefault(stop.why, []).append(stop)
    others = {why: some for why, some in by_reason.items() if why not in EXACT}
    reasons = []
    for why, some in list(others.items())[:MOST_REASONS]:
        first, lasting = f"line {some[0].line}", sum(stop.lasting for stop in some)
        where = f"at {first}" if len(some) == 1 else f"{len(some)} times from {first}"
        reasons.append(f"{why} {where}" + (f" ({lasting:.6g} s)" if lasting else ""))
    if len(others) > MOST_REASONS:
        reasons.append(f"{len(others) - MOST_REASONS} more reasons")
    count = sum(map(len, others.values()))
    sentences = [f"{count} stop{'' if count == 1 else 's'}: {', '.join(reasons)}"] if others else []
    sentences += [
        f"{why} from line {by_reason[why][0].line}: stops {where}"
        for why, where in EXACT.items()
        if why in by_reason
    ]
    waiting = [stop.besides for stop in by_reason.get(UP_OR_DOWN, [])]
    at_feed = [lasting for lasting in waiting if not math.isnan(lasting)]
    if at_feed:
        sentences.append(f"Z alone takes {sum(at_feed):.4g} s at its feed")
    rapid = len(waiting) - len(at_feed)
    if rapid:
        named = "1 rapid move of Z takes" if rapid == 1 else f"{rapid} rapid moves of Z take"
        sentences.append(f"{named} no time")
    return "; ".join(sentences)


def ignored_words(words: Iterable[str], stops: Sequence[Stop]) -> tuple[str, ...]:
    """Words without meaning for the path, sorted; those that stop it have one."""
    stopping = {word for stop in stops for word in stop.why.split()}
    return tuple(sorted(set(words) - stopping))
