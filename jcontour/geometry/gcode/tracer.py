"""Moves that a machine has made, and what X and Y alone see of an arc in another plane."""

import math
from dataclasses import dataclass, field

from jcontour.geometry.gcode.modes import PLANES
from jcontour.geometry.gcode.move import DWELL, UP_OR_DOWN, ZERO, Move, Point, Stop, check_near
from jcontour.geometry.toolpath_rules import MOST_MOVES, SHORTEST, ToolpathError


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
