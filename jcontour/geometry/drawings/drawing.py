"""Drawings as toolpaths: contours in the order of the file, with rapid moves between them."""

from collections import Counter
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from jcontour.geometry import contours
from jcontour.geometry.drawings.drawn_pieces import drawn_pieces
from jcontour.geometry.drawings.joining import Stroke, joined, without_doubles
from jcontour.geometry.drawings.segments import Drawn, Line, Segment, is_finite, vanishes
from jcontour.geometry.toolpath_rules import FARTHEST, MOST_MOVES, SHORTEST, ToolpathError
from jcontour.geometry.toolpaths import Toolpath

GAP = 10e-6  # [m] ends this close are joined: programs that draw snap to less


def at_line(line: int) -> str:
    """Beginning of a message about a line of the file; 0 where it is not known."""
    return f"line {line}: " if line else ""


@dataclass
class Drawing:
    """What a file draws, in metres, as far as it is taken.

    Attributes:
        strokes: segments that meet, in the order of the file.
        left_out: what is not taken, in words, with its count.
        count: of the segments.
        doubts: what of it may be meant otherwise.
    """

    strokes: list[Stroke] = field(default_factory=list)
    left_out: Counter[str] = field(default_factory=Counter)
    count: int = 0
    doubts: tuple[str, ...] = ()

    def add(self, segments: list[Segment], line: int) -> None:
        """Add a stroke of a line of the file, 0 where it is not known.

        Raises:
            ToolpathError: it reaches too far away, or there are too many segments.
        """
        if not all(_near(segment) for segment in segments):
            raise ToolpathError(
                f"{at_line(line)}a point is farther than {FARTHEST:g} m away: is the unit right? "
                "(--drawing-unit mm reads millimetres)"
            )
        segments = [segment for segment in segments if not vanishes(segment)]
        self.count += len(segments)
        if self.count > MOST_MOVES:
            raise ToolpathError(f"{at_line(line)}more than {MOST_MOVES} segments")
        if segments:
            self.strokes.append([Drawn(segment, line) for segment in segments])

    def leave_out(self, words: str) -> None:
        """Count what is not taken."""
        self.left_out[words] += 1

    def told(self) -> tuple[str, ...]:
        """What is not taken."""
        return tuple(f"{n} {words}" for words, n in sorted(self.left_out.items()))

    def toolpath(self, feed: float, gap: float = GAP) -> Toolpath:
        """Contours joined, each cut at `feed` [m/s], rapid moves between them.

        Ends within `gap` [m] are joined. What is drawn twice is cut once.

        Raises:
            ToolpathError: nothing is drawn, or a curve cannot be fitted.
        """
        strokes, doubles = without_doubles(self.strokes)
        if not strokes:
            left_out = "; left out: " + ", ".join(self.told()) if self.told() else ""
            raise ToolpathError(f"no lines or curves are drawn{left_out}")
        told = self.told() + ((f"{doubles} drawn twice",) if doubles else ())
        return _toolpath(joined(strokes, gap), feed, told)._replace(doubts=self.doubts)


def _toolpath(found: list[Stroke], feed: float, told: tuple[str, ...]) -> Toolpath:
    drawn = list(found[0])
    rapid = [False] * len(drawn)
    for before, after in pairwise(found):
        way = Line(before[-1].segment.end, after[0].segment.start)
        if abs(way.end - way.start) >= SHORTEST:
            drawn.append(Drawn(way, after[0].line))
            rapid.append(True)
        drawn += after
        rapid += [False] * len(after)
    pieces, owner, error = drawn_pieces([segment for segment, _ in drawn])
    is_rapid = np.array(rapid)[owner]
    smooth = pieces.polynomial[:, 2:].any()
    contour = contours.from_pieces(pieces, error, contours.NEWTON_STEPS if smooth else 0)
    line = np.array([line for _, line in drawn])[owner]
    speed, rest = np.where(is_rapid, np.nan, feed), np.full(line.size, np.nan)
    return Toolpath(contour, speed, is_rapid, line, told, rest, np.zeros(line.size))


def _near(segment: Segment) -> bool:
    """Whether a segment is finite, and on a machine."""
    if not is_finite(segment):
        return False
    try:
        places = (segment.start, segment.middle(), segment.end)
        return all(abs(place) <= FARTHEST for place in places)
    except (ZeroDivisionError, OverflowError):
        return False
