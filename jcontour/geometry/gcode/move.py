"""One move of the tool: a line, an arc or a helix; and a stop between two of them."""

from collections.abc import Iterable
from typing import NamedTuple

from jcontour.geometry.toolpath_rules import FARTHEST, ToolpathError

Point = tuple[float, float, float]  # [m]
ZERO: Point = (0.0, 0.0, 0.0)
DWELL, UP_OR_DOWN = "G4", "Z"  # why a stop is made


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
