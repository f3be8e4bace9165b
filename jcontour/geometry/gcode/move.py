"""Moves of the tool, lines, arcs and helices, with stops between them; what X and Y see of them."""

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import NamedTuple

from jcontour.geometry.toolpath_rules import FARTHEST, MOST_MOVES, SHORTEST, ToolpathError

Point = tuple[float, float, float]  # [m]
ZERO: Point = (0.0, 0.0, 0.0)
DWELL, UP_OR_DOWN = "G4", "Z"  # why a stop is made
# first and second axis of the plane, then its normal
PLANES = {170: (0, 1, 2), 180: (2, 0, 1), 190: (1, 2, 0)}


class Move(NamedTuple):
    """A line, or an arc or helix where `angle` is not zero.

    Attributes:
        start: first point [m].
        end: last point [m].
        centre: of the arc, in the plane of its start [m].
        angle: turned [rad], positive counter-clockwise around the plane's normal.
        normal: axis number of the plane's normal.
        feed: speed along the move [m/s], NaN for a rapid move.
        rapid: whether it is one (G0).
        line: of the program, from 1.
        lifted: whether Z, which is not traced, moves along and comes back.
    """

    start: Point
    end: Point
    centre: Point
    angle: float
    normal: int
    feed: float
    rapid: bool
    line: int
    lifted: bool = False


class Stop(NamedTuple):
    """A place between two moves where the tool comes to rest, for a time in a dwell.

    Attributes:
        after: how many moves come before it.
        place: where it rests [m].
        lasting: for how long [s], 0 for a stop alone.
        line: of the program, from 1.
        why: words of the program that ask for it, as G4 or M8 M3.
        besides: how long an axis that is not traced moves meanwhile [s]; NaN at traverse.
    """

    after: int
    place: Point
    lasting: float
    line: int
    why: str
    besides: float = 0.0


def check_near(lengths: Iterable[float]) -> None:
    """Raise ToolpathError if any of these lengths [m] is too large for a machine."""
    for length in lengths:
        if not abs(length) <= FARTHEST:
            raise ToolpathError(f"a coordinate is farther than {FARTHEST:g} m away")


@dataclass
class Tracer:
    """Place of a machine, and its moves so far.

    Attributes:
        axes: 3, or 2 where only X and Y are traced.
        at: place on the machine [m].
        line: of the program that is carried out.
        moves: made so far.
        stops: between them, so far.
    """

    axes: int
    at: Point = ZERO
    line: int = 0
    moves: list[Move] = field(default_factory=list)
    stops: list[Stop] = field(default_factory=list)

    def add(
        self,
        end: Point,
        centre: Point,
        angle: float,
        feed: float,
        plane: int,
        lifted: bool = False,
    ) -> None:
        """Add a move; one too short to see only moves the axes that are not traced, and stops.

        Raises:
            ToolpathError: it ends too far away, or there are too many.
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
        move = Move(self.at, end, centre, angle, normal, feed, rapid, self.line, lifted)
        self.moves.append(move)
        self.at = end
        if len(self.moves) > MOST_MOVES:
            raise ToolpathError(f"more than {MOST_MOVES} moves")

    def add_line(self, end: Point, feed: float, plane: int, lifted: bool = False) -> None:
        """Add a straight move, rapid where it has no feed (NaN)."""
        self.add(end, end, 0.0, feed, plane, lifted)

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

    def add_shadow(self, end: Point, centre: Point, angle: float, feed: float, plane: int) -> None:
        """Add what X and Y do on an arc in another plane: straight lines to and fro.

        Each lasts as long as its part of the arc.

        Raises:
            ToolpathError: the arc is a helix, whose shadow is bent.
        """
        first, second, normal = PLANES[plane]
        if abs(end[normal] - self.at[normal]) >= SHORTEST:
            raise ToolpathError(
                f"a helix in the plane of G{plane // 10} needs a third axis: "
                'a --plant of three axes, or axes "XYZ"'
            )
        radius = math.hypot(self.at[first] - centre[first], self.at[second] - centre[second])
        before = math.atan2(self.at[second] - centre[second], self.at[first] - centre[first])
        last = before + angle
        for stop in [*_turning_points(before, last, first < 2), last]:
            point = list(end)
            if stop != last:
                point[first] = centre[first] + radius * math.cos(stop)
                point[second] = centre[second] + radius * math.sin(stop)
            target = point[0], point[1], point[2]
            length = radius * abs(stop - before)
            if length > 0:
                self.add_line(
                    target, feed * math.dist(self.at, target) / length, plane, lifted=True
                )
            before = stop


def _turning_points(begin: float, last: float, cosine: bool) -> list[float]:
    """Angles between two at which the cosine, or the sine, turns back [rad]."""
    zero = 0.0 if cosine else 0.5 * math.pi
    low, high = sorted((begin, last))
    between = range(math.floor((low - zero) / math.pi) + 1, math.ceil((high - zero) / math.pi))
    stops = [zero + k * math.pi for k in between]
    return stops if last > begin else stops[::-1]
