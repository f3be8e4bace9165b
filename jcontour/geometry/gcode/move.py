"""One move of the tool: a line, an arc or a helix; and a dwell between two of them."""

from typing import NamedTuple

Point = tuple[float, float, float]  # [m]


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
    """

    start: Point
    end: Point
    centre: Point
    angle: float
    normal: int
    feed: float
    rapid: bool
    line: int


class Dwell(NamedTuple):
    """A stop in which the tool rests for a time (G4, some canned cycles).

    Attributes:
        after: how many moves come before it.
        place: where it rests [m].
        lasting: for how long [s].
        line: of the program, from 1.
    """

    after: int
    place: Point
    lasting: float
    line: int
