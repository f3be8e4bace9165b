"""Sections of a run along a program: cuts, rapid moves, and what is to be done between them.

Two axes of a program are the projection of what it does. Where a rapid move begins or ends its tool
is lifted or lowered; elsewhere Z moves alone, or a spindle or a laser is switched. What has X and Y
alone has to stop there.
"""

import re
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from jcontour.app.jobs.job import Job, Task
from jcontour.geometry.gcode.moves import START, UP_OR_DOWN
from jcontour.geometry.toolpath_rules import SHORTEST
from jcontour.geometry.toolpaths import Toolpath

BEGINS = {False: "cut goes on", True: "rapid move begins"}  # by whether the next piece is rapid
SWITCHED = re.compile(r"[MST]\d*")  # words of spindles, lasers and tools
PREPARED = "the first cut begins, with Z, spindle and laser as there"


class Section(NamedTuple):
    """Samples of a run from a first to a last one, which the next section begins with."""

    first: int  # the samples
    last: int
    rapid: bool = False  # whether it is a rapid move, where no part is cut
    # samples between them where one rapid move ends and another begins
    corners: tuple[int, ...] = ()
    # what is to be done before it, by line of the program, from 1
    asked: tuple[tuple[int, str], ...] = ()


def sections(job: Task) -> list[Section]:
    """All sections of a run; a single one where nothing is to be done between its moves."""
    last = job.steps - 1
    if not isinstance(job, Job) or job.program is None:
        return [Section(0, last)]
    read = job.program
    begun: dict[int, tuple[int, list[tuple[int, str]]]] = {0: (0, [])}
    for piece, *asked in sorted([*_events(read, job.contour.axes == 2), *_changes(read.rapid)]):
        sample = _sample_at(job, piece)
        if sample < last:
            earlier = begun.get(sample, (0, []))[1]
            begun[sample] = piece, [*earlier, *asked]
    firsts = sorted(begun)
    between = np.flatnonzero(read.rapid[1:] & read.rapid[:-1]) + 1
    corners = [_sample_at(job, int(piece)) for piece in between]  # from one rapid move to another
    parts = []
    for first, end in zip(firsts, [*firsts[1:], last], strict=True):
        piece, asked = begun[first]
        rapid = bool(read.rapid[piece])
        within = tuple(k for k in corners if rapid and first < k < end)
        parts.append(Section(first, end, rapid, within, tuple(asked)))
    return parts


def halted(job: Task) -> np.ndarray:
    """Samples (T,) of rapid moves, and where a run stops as something is to be done.

    There the tool has to come to the program's place: it rests for as long as that takes.
    """
    stopped = np.zeros(job.steps, bool)
    for section in sections(job):
        if section.rapid:
            stopped[section.first : section.last + 1] = True
        stopped[section.first] |= bool(section.asked)
    return stopped


def _changes(rapid: np.ndarray) -> list[tuple[int]]:
    """Pieces where rapid moves begin or end."""
    return [(int(piece),) for piece in np.flatnonzero(np.diff(rapid)) + 1]


def _events(read: Toolpath, flat: bool) -> Iterator[tuple[int, tuple[int, str]]]:
    """Number of the piece before which something is to be done; line of the program, and what."""
    switched = any(SWITCHED.fullmatch(word) for word in read.ignored)
    lifted = flat and bool(read.rapid.any() or read.ramps)
    begun = [stop for stop in read.asks if stop.why == START]
    if switched or lifted or read.asks:
        yield 0, (begun[0].line if begun else int(read.line[0]), PREPARED)
    for stop in read.asks:
        if 0 < stop.after < read.rapid.size:
            yield stop.after, (stop.line, "Z moves" if stop.why == UP_OR_DOWN else stop.why)
    if flat:
        for (piece,) in _changes(read.rapid):
            yield piece, (int(read.line[piece]), BEGINS[bool(read.rapid[piece])])


def _sample_at(job: Job, piece: int) -> int:
    """The sample nearest to the start of a piece, the first one of several that rest there."""
    if piece == 0:
        return 0
    place = float(job.contour.start[piece])
    after = int(np.searchsorted(job.arc, place - SHORTEST))
    if after == job.samples:
        return after - 1
    nearer = after > 0 and place - job.arc[after - 1] < job.arc[after] - place
    return after - 1 if nearer else after
