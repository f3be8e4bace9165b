"""Drawings as toolpaths: contours in the order of the file, with rapid moves between them.

A contour begins with the first stroke that is left, as it was drawn. It goes on with the stroke
that begins or ends where it ends; where several do, with the one that bends least. Then it is
carried on backwards from its start in the same way.
"""

import cmath
import math
from collections import Counter, defaultdict
from collections.abc import Iterable
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from jcontour.geometry import contours
from jcontour.geometry.drawings.drawn_pieces import drawn_pieces
from jcontour.geometry.drawings.segments import (
    Drawn,
    Line,
    Planar,
    Segment,
    is_finite,
    similarity,
    vanishes,
)
from jcontour.geometry.toolpath_rules import FARTHEST, GAP, MOST_MOVES, SHORTEST, ToolpathError
from jcontour.geometry.toolpaths import Toolpath

Stroke = list[Drawn]  # segments that meet

NEARLY = 0.1  # of the gap: ends at distances this close are equally near
SAME = 1e-8  # [m] strokes whose points are this close are doubles
# of a segment's chord, its size: beyond, moving its ends would deform it, and a line closes the gap
MOST_CURLED = 10.0
ROUNDING = 1e-12  # [m] gaps of it are left
MOST_ENDS = 1000  # in a cell of the grid: more are no drawing, and take seconds
UM = 1e-6  # [m]


def joined(strokes: Iterable[Stroke], gap: float) -> list[Stroke]:
    """Contours of strokes whose ends are within `gap` [m]; their segments meet exactly.

    Raises:
        ToolpathError: far too many ends are within the gap.
    """
    strokes = list(strokes)
    ends = _Ends(strokes, gap)
    return [_meeting(ends.contour(i), gap) for i in range(len(strokes)) if i in ends.left]


def without_doubles(strokes: Iterable[Stroke]) -> tuple[list[Stroke], int]:
    """Strokes without those drawn before, in either direction, and how many those were."""
    by_place: dict[tuple, Stroke] = {}
    count = 0
    for stroke in strokes:
        count += 1
        forwards = tuple((round(p.real / SAME), round(p.imag / SAME)) for p in _points(stroke))
        by_place.setdefault(min(forwards, forwards[::-1]), stroke)
    return list(by_place.values()), count - len(by_place)


def is_closed(stroke: Stroke, gap: float) -> bool:
    """Whether the end meets the start, after a way that is longer than the gap."""
    start, end = stroke[0].segment.start, stroke[-1].segment.end
    if abs(end - start) > gap:
        return False
    return _farthest(stroke, start) > 2 * gap


def reversed_stroke(stroke: Stroke) -> Stroke:
    """The stroke from its end to its start."""
    return [Drawn(segment.backwards(), line) for segment, line in reversed(stroke)]


class _Ends:
    """Ends of the strokes that are left, in a grid of cells as wide as the gap."""

    def __init__(self, strokes: list[Stroke], gap: float):
        self.strokes = strokes
        self.gap = max(gap, SHORTEST)
        self.left = set(range(len(strokes)))
        self.closed = {i for i, stroke in enumerate(strokes) if is_closed(stroke, gap)}
        self.cells: dict[tuple[int, int], list[tuple[Planar, int, bool]]] = defaultdict(list)
        for i, stroke in enumerate(strokes):
            if i not in self.closed:
                self._add(stroke[0].segment.start, i, False)
                self._add(stroke[-1].segment.end, i, True)

    def _add(self, point: Planar, stroke: int, last: bool) -> None:
        cell = self.cells[self._cell(point)]
        cell.append((point, stroke, last))
        if len(cell) > MOST_ENDS:
            raise ToolpathError(
                f"line {self.strokes[stroke][0].line}: more than {MOST_ENDS} ends of lines within "
                f"{self.gap / UM:g} um: give another drawing unit, or join less"
            )

    def contour(self, first: int) -> Stroke:
        """Contour that begins with a stroke; its strokes are left no more."""
        self.left.discard(first)
        contour = self.strokes[first]
        if first in self.closed:
            return contour
        for _ in range(2):  # onwards from the end, then from the start, and back again
            contour = reversed_stroke(self._grown(contour))
        return contour

    def _grown(self, contour: Stroke) -> Stroke:
        """The contour with all that follows, until it is closed."""
        contour, start = list(contour), contour[0].segment.start
        farthest = _farthest(contour, start)
        while farthest <= 2 * self.gap or abs(contour[-1].segment.end - start) > self.gap:
            following = self._following(contour)
            if following is None:
                break
            contour += following
            farthest = max(farthest, _farthest(following, start))
        return contour

    def _following(self, contour: Stroke) -> Stroke | None:
        """Stroke that goes on where a contour ends, taken from those that are left."""
        end = contour[-1].segment.end
        candidates = [
            (abs(point - end), i, last)
            for point, i, last in self._near(end)
            if i in self.left and abs(point - end) <= self.gap
        ]
        if not candidates:
            return None
        least = min(distance for distance, _, _ in candidates)
        nearest = [c for c in candidates if c[0] <= least + NEARLY * self.gap]
        if len(nearest) > 1:
            back = contour[-1].segment.backwards().heading()
            nearest.sort(key=lambda c: (self._bend(-back, c[1], c[2]), c[1]))
        _, i, last = nearest[0]
        self.left.discard(i)
        return reversed_stroke(self.strokes[i]) if last else self.strokes[i]

    def _bend(self, heading: Planar, stroke: int, last: bool) -> float:
        """Angle by which the way bends into a stroke, rounded so that equal ones compare equal."""
        segments = self.strokes[stroke]
        into = segments[-1].segment.backwards() if last else segments[0].segment
        return round(abs(cmath.phase(into.heading() * heading.conjugate())), 9)

    def _near(self, point: Planar) -> list[tuple[Planar, int, bool]]:
        x, y = self._cell(point)
        around = [(x + i, y + j) for i in (-1, 0, 1) for j in (-1, 0, 1)]
        return [end for cell in around if cell in self.cells for end in self.cells[cell]]

    def _cell(self, point: Planar) -> tuple[int, int]:
        return math.floor(point.real / self.gap), math.floor(point.imag / self.gap)


def _meeting(contour: Stroke, gap: float) -> Stroke:
    """The contour with its gaps closed."""
    # a segment is turned and scaled to begin where the one before ends; one that curls is left, a
    # line closes the gap
    meeting: Stroke = []
    closes = is_closed(contour, gap)
    first, last = contour[0].segment.start, len(contour) - 1
    at = first
    for i, (segment, line) in enumerate(contour):
        end = first if closes and i == last else segment.end
        moved = _moved(segment, at, end)
        if moved is segment and abs(segment.start - at) >= SHORTEST:
            meeting.append(Drawn(Line(at, segment.start), line))
        if not vanishes(moved):
            meeting.append(Drawn(moved, line))
            at = moved.end
    if closes and abs(at - first) >= SHORTEST:
        meeting.append(Drawn(Line(at, first), contour[-1].line))
    return meeting


def _moved(segment: Segment, start: Planar, end: Planar) -> Segment:
    """The segment between other ends; itself where these are its own, or where it curls."""
    if max(abs(segment.start - start), abs(segment.end - end)) <= ROUNDING:
        return segment
    chord = abs(segment.end - segment.start)
    size = max(chord, abs(segment.middle() - segment.start))
    if size >= MOST_CURLED * min(chord, abs(end - start)):
        return segment
    return segment.placed(similarity((segment.start, segment.end), (start, end)))


def _farthest(stroke: Stroke, start: Planar) -> float:
    return max(abs(point - start) for point in _points(stroke))


def _points(stroke: Stroke) -> Iterable[Planar]:
    yield stroke[0].segment.start
    for segment, _ in stroke:
        yield segment.middle()
        yield segment.end


def at_line(line: int) -> str:
    """Beginning of a message about a line of the file; 0 where it is not known."""
    return f"line {line}: " if line else ""


@dataclass
class Drawing:
    """What a file draws, in metres, as far as it is taken."""

    # segments that meet, in the order of the file
    strokes: list[Stroke] = field(default_factory=list)
    # what is not taken, in words, with its count
    left_out: Counter[str] = field(default_factory=Counter)
    count: int = 0  # of the segments
    warnings: tuple[str, ...] = ()  # what of it may be meant otherwise

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

    def toolpath(self, feed: float, gap: float = GAP) -> Toolpath:
        """Contours joined, each cut at `feed` [m/s], rapid moves between them.

        Ends within `gap` [m] are joined. What is drawn twice is cut once.

        Raises:
            ToolpathError: nothing is drawn, or a curve cannot be fitted.
        """
        strokes, doubles = without_doubles(self.strokes)
        ignored = tuple(f"{n} {words}" for words, n in sorted(self.left_out.items()))
        if not strokes:
            left_out = "; left out: " + ", ".join(ignored) if ignored else ""
            raise ToolpathError(f"no lines or curves are drawn{left_out}")
        ignored += (f"{doubles} drawn twice",) if doubles else ()
        return _toolpath(joined(strokes, gap), feed, ignored)._replace(warnings=self.warnings)


def _toolpath(strokes: list[Stroke], feed: float, ignored: tuple[str, ...]) -> Toolpath:
    drawn = list(strokes[0])
    rapid = [False] * len(drawn)
    for before, after in pairwise(strokes):
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
    return Toolpath(contour, speed, is_rapid, line, ignored, rest, np.zeros(line.size))


def _near(segment: Segment) -> bool:
    """Whether a segment is finite, and on a machine."""
    if not is_finite(segment):
        return False
    try:
        places = (segment.start, segment.middle(), segment.end)
        return all(abs(place) <= FARTHEST for place in places)
    except (ZeroDivisionError, OverflowError):
        return False
