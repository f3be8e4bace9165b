"""Cutter compensation (G41, G42, G41.1, G42.1) in the XY plane: the tool beside its contour.

The rules are those of LinuxCNC's documentation, "Cutter Compensation". The first move leads in: it
ends beside its programmed end, an arc tangentially. An outside corner is passed on an arc around
it, an inside corner where the tool touches both sides. A move that would run backwards gouges and
is refused. The move after G40 leads out to its programmed end.
"""

import cmath
import math
from dataclasses import dataclass
from typing import NamedTuple

from jcontour.geometry.gcode._expressions import whole
from jcontour.geometry.gcode._words import CYCLES, LineWords
from jcontour.geometry.gcode.modes import Modes, Point, Tool, tool_numbered
from jcontour.geometry.gcode.moves import Tracer, angle_between, arcs_between
from jcontour.geometry.toolpath_rules import FARTHEST, MM, SHORTEST, ToolpathError

SMOOTH = 0.05  # [rad] of turn: a lesser corner is passed as if it were none, as in LinuxCNC
PLANE = 170
GOUGES = "the tool cannot reach an inside corner without gouging"


class Side(NamedTuple):
    """A line or an arc that the tool passes on its side."""

    # begins, ends: programmed directions, of length 1
    begins: complex
    ends: complex
    centre: complex | None  # of an arc [m]; None for a line
    angle: float  # turned, 0 for a line [rad]


@dataclass
class Compensation:
    """Path of a tool's centre beside the programmed one."""

    tracer: Tracer  # makes the moves
    # from the path to the tool, per unit of direction: i r to the left, -i r to the right, r the
    # tool's radius [m]
    offset: complex
    at: Point  # programmed place on the machine [m]
    line: int  # of the program that began it
    code: int  # that did, in tenths
    last: Side | None = None  # side that was passed last; None before the first one
    piece: int = -1  # number of its last move
    leaving: bool = False  # whether G40 has ended it; the next move leads out

    def check(self, line: LineWords, plane: int) -> None:
        """Refuse codes that it does not go on with, as LinuxCNC does."""
        if self.leaving:
            return
        groups = ("compensation", "plane", "once", "system", "tool length")
        changed = [line.codes[group] for group in groups if group in line.codes]
        changed = [code for code in changed if code not in (40, 400, plane)]
        changed += [line.codes["motion"]] if line.codes.get("motion") in CYCLES else []
        words = [f"G{code / 10:g}" for code in changed] + ["M6"] * (6 in line.m_codes)
        if words:
            raise ToolpathError(
                f"{words[0]} under the cutter compensation of line {self.line}: G40 ends it before"
            )

    def add(self, end: Point, centre: Point, angle: float, feed: float) -> None:
        """Add a move as `Tracer.add` does, in the XY plane.

        Args:
            end: of the programmed move.
            centre: of an arc.
            angle: of an arc, 0 for a line.
            feed: NaN for a rapid move.
        """
        start, stop = complex(*self.at[:2]), complex(*end[:2])
        self.at = end
        if self.leaving:
            if angle:
                raise ToolpathError("the first move after G40 needs to be a line")
            self.tracer.add_line(end, feed, PLANE)
        elif not angle and abs(stop - start) < SHORTEST:
            self.tracer.add_line((*self.tracer.at[:2], end[2]), feed, PLANE)
        else:
            side = _side(start, stop, complex(*centre[:2]), angle)
            target = stop + self.offset * side.ends
            leads_in = self.last is None
            if self.last is None:
                side = self._lead_in(side, start, stop, target)
            else:
                self._corner(self.last, side, start, feed)
            self._add(target, side.centre, side.angle, end[2], feed)
            self.piece = len(self.tracer.moves) - 1
            angle = self.tracer.moves[-1].angle if leads_in else side.angle
            self.last = side._replace(angle=angle)

    def _add(
        self, target: complex, centre: complex | None, angle: float, level: float, feed: float
    ) -> None:
        """Add a line; or arcs that meet both ends, though their circle may not."""
        if centre is None:
            self.tracer.add_line((target.real, target.imag, level), feed, PLANE)
            return
        start, bottom = complex(*self.tracer.at[:2]), self.tracer.at[2]
        arcs = list(arcs_between(start, target, centre, angle > 0, slack=FARTHEST))
        whole = sum(turned for *_, turned in arcs)
        for end, middle, turned in arcs:
            rise = (level - bottom) * turned / whole
            height = self.tracer.at[2]
            self.tracer.add(
                (end.real, end.imag, height + rise),
                (middle.real, middle.imag, height),
                turned,
                feed,
                PLANE,
            )

    def _lead_in(self, side: Side, start: complex, stop: complex, target: complex) -> Side:
        """First side, whose end is tangential to an arc; its start is where the tool is."""
        radius = abs(self.offset)
        length = abs(stop - start) if side.centre is None else abs(stop - side.centre)
        if side.centre is not None:
            inwards = (side.centre - stop) / length
            chord = complex(*self.tracer.at[:2]) - target
            along = (chord * inwards.conjugate()).real or 1.0 / FARTHEST
            reach = 0.5 * abs(chord) ** 2 / along
            side = side._replace(centre=target + reach * inwards)
            length = min(length, abs(reach))
        if length <= radius:
            what = "move" if side.centre is None else "arc's radius"
            raise ToolpathError(
                f"the first {what} of cutter compensation, {length / MM:.6g} mm, is not larger "
                f"than the tool's radius, {radius / MM:.6g} mm"
            )
        return side

    def _corner(self, last: Side, side: Side, place: complex, feed: float) -> None:
        """Pass the corner at `place` between two sides."""
        turned = cmath.phase(side.begins / last.ends)
        outwards = -turned if self.offset.imag > 0 else turned
        outwards += math.tau if outwards < -0.5 * math.pi else 0.0
        inside = [one.angle * self.offset.imag > 0 for one in (last, side)]
        if side.centre is not None and inside[1]:
            radius = abs(place - side.centre)
            if radius <= abs(self.offset):
                raise ToolpathError(
                    f"an inside arc of {radius / MM:.6g} mm is not larger than the tool's radius, "
                    f"{abs(self.offset) / MM:.6g} mm"
                )
        bulges = any(
            one.angle and not within for one, within in zip((last, side), inside, strict=True)
        )
        most = math.pi - SMOOTH if bulges else math.pi + SMOOTH
        if not -SMOOTH <= outwards <= most:
            self._end_at(_touching(self.offset, last, side, place))
        self._check(last)
        if SMOOTH < outwards <= most:
            begin = place + self.offset * side.begins
            around = None if math.isnan(feed) else place  # a rapid move cuts the corner
            self._add(begin, around, -self.offset.imag, self.tracer.at[2], feed)

    def _end_at(self, place: complex) -> None:
        """Let the side passed last end elsewhere; what came behind it stays above that place."""
        moves, stops = self.tracer.moves, self.tracer.stops
        move = moves[self.piece]
        angle, centre = move.angle, complex(*move.centre[:2])
        if angle:
            angle = angle_between(complex(*move.start[:2]) - centre, place - centre, angle > 0)
        moves[self.piece] = move._replace(end=(place.real, place.imag, move.end[2]), angle=angle)
        for k in range(self.piece + 1, len(moves)):
            begin, end = ((place.real, place.imag, p[2]) for p in (moves[k].start, moves[k].end))
            moves[k] = moves[k]._replace(start=begin, end=end, centre=end)
        for k, stop in enumerate(stops):
            if stop.after > self.piece:
                stops[k] = stop._replace(place=(place.real, place.imag, stop.place[2]))
        self.tracer.at = (place.real, place.imag, self.tracer.at[2])

    def _check(self, last: Side) -> None:
        """Refuse a side that is passed backwards."""
        move = self.tracer.moves[self.piece]
        run = complex(*move.end[:2]) - complex(*move.start[:2])
        backwards = (run * last.ends.conjugate()).real < 0
        if abs(move.angle) > abs(last.angle) + SMOOTH if move.angle else backwards:
            raise ToolpathError(GOUGES)


def diameter_of(
    code: int,
    values: dict[str, float],
    modes: Modes,
    tool: int,
    tools: dict[int, Tool] | None,
) -> float:
    """Diameter of the tool that G41 to G42.1 ask for [m]: D, or that of tool D or the spindle's."""
    name = f"G{code / 10:g}"
    if modes.plane != PLANE:
        raise ToolpathError(f"{name} needs the XY plane (G17)")
    if code % 10:
        diameter = values.get("D", 0.0) * modes.unit
        fault = f"{name} needs the tool's diameter, D, which is not 0"
    else:
        number = whole(values["D"], f"D of {name}") if "D" in values else tool
        diameter = tool_numbered(tools, number).diameter
        fault = f"{name}: tool {number} has no diameter in the tool table"
    if not diameter:
        raise ToolpathError(fault)
    return diameter


def _side(start: complex, stop: complex, centre: complex, angle: float) -> Side:
    if not angle:
        direction = (stop - start) / abs(stop - start)
        return Side(direction, direction, None, 0.0)
    ahead = 1j * math.copysign(1.0, angle)  # from a radius to the direction
    begins, ends = (ahead * (p - centre) / abs(p - centre) for p in (start, stop))
    return Side(begins, ends, centre, angle)


def _touching(offset: complex, last: Side, side: Side, place: complex) -> complex:
    """Centre of the tool that touches both sides of an inside corner, the nearest one."""
    one, other = place + offset * last.ends, place + offset * side.begins
    if last.centre is None and side.centre is None:
        across = (last.ends.conjugate() * side.begins).imag
        return one + ((other - one).conjugate() * side.begins).imag / across * last.ends
    if last.centre is not None and side.centre is not None:
        apart = side.centre - last.centre or SHORTEST
        first, second = abs(one - last.centre), abs(other - side.centre)
        foot = 0.5 * (1 + (first**2 - second**2) / abs(apart) ** 2) * apart
        centre, along, reach = last.centre, 1j * apart / abs(apart), first
    else:
        line, along = (one, last.ends) if last.centre is None else (other, side.begins)
        centre, on_circle = (last.centre, one) if side.centre is None else (side.centre, other)
        assert centre is not None
        foot = line - centre + ((centre - line) * along.conjugate()).real * along
        reach = abs(on_circle - centre)
    half = reach**2 - abs(foot) ** 2
    if half < 0:
        raise ToolpathError(GOUGES)
    places = (centre + foot + sign * math.sqrt(half) * along for sign in (1, -1))
    return min(places, key=lambda point: abs(point - place))
