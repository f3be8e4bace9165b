"""`jcontour simulate PART --list-moves`: what was understood of a program or a drawing."""

import json
import math
from collections.abc import Iterable, Iterator, Sequence
from heapq import merge
from importlib import import_module
from pathlib import Path
from typing import NamedTuple

import numpy as np

from jcontour.app.catalogue.entries import CONTOURS
from jcontour.app.files.checks import named
from jcontour.app.flags.loops import Simulate
from jcontour.app.flags.shared import MachineFlags
from jcontour.app.plain_numbers import MM_PER_MIN, feed_number
from jcontour.geometry.gcode.machine_values import warnings_of
from jcontour.geometry.gcode.modes import read_tool_table
from jcontour.geometry.gcode.moves import (
    DWELL,
    EXACT,
    Move,
    Stop,
    ignored_words,
    stop_summary,
    stops_in_cuts,
)
from jcontour.geometry.gcode.programs import files_beside, interpreted
from jcontour.geometry.toolpath_rules import DRAWINGS, MM, ToolpathError, lines_of, read_program

USUAL = ("bridgeport", "xy-table", "emps")  # X and Y
UM = 1e-6  # [m]
AXES = "XYZ"
NAMES = "line", "move"


def command(flags: Simulate) -> int:
    """Print every move of the file."""
    if flags.contour is None or flags.contour in CONTOURS:
        raise ValueError(
            "list-moves: needs a program or a drawing, as in `jcontour simulate part.ngc`"
        )
    for line in listed_moves(Path(flags.contour), axes_of(flags.plant), flags):
        print(line)
    return 0


def axes_of(plant: str) -> int:
    """Number of axes of a machine; its model, which takes a second to load, where need be."""
    if plant in USUAL:
        return 2
    if Path(plant).suffix == ".json":
        try:
            axes = json.loads(Path(plant).read_text()).get("axes")
        except (OSError, ValueError, AttributeError):  # handled below
            axes = None
        if isinstance(axes, list) and axes:
            return len(axes)
    return import_module("jcontour.app.catalogue.choices").machine_named(plant).model.axes


class _Row(NamedTuple):
    """A line of the table: its cells, and what stands behind them."""

    cells: tuple[str, ...]
    behind: str = ""


def listed_moves(path: Path, axes: int, flags: MachineFlags) -> Iterator[str]:
    """Table of the moves of a program or a drawing, a line of text for each, in millimetres.

    A machine of two axes has the projection of a program to X and Y.

    Args:
        path: of the file.
        axes: of the machine.
        flags: with the feed where the file gives none, and the unit of a drawing.

    Raises:
        ToolpathError: it has no moves, or something in it cannot be read or traced.
    """
    suffix = path.suffix.lower()
    if suffix == ".csv":
        raise ToolpathError(f"list-moves: {path} holds points, no moves")
    with named(path, ToolpathError):
        if suffix in DRAWINGS:
            yield from _drawn(path, flags)
        else:
            yield from _programmed(path, min(axes, 3), flags)


def _programmed(path: Path, axes: int, flags: MachineFlags) -> Iterator[str]:
    given = flags.feed_mm_per_min
    feed = None if given is None else given * MM_PER_MIN
    tools = None if flags.tool_table is None else read_tool_table(flags.tool_table)
    lines = lines_of(read_program(path))
    machine = interpreted(lines, axes, feed, files_beside(path), tools=tools)
    if not machine.moves:
        raise ToolpathError(f"the program has no moves along {' or '.join(AXES[:axes])}")
    stops = machine.tracer.stops
    # a stop comes before the move that has its number
    shown = ((stop.after - 0.5, stop) for stop in stops if stop.why not in EXACT)
    steps = [step for _, step in merge(enumerate(machine.moves), shown)]
    rows = (_stop(one, axes) if isinstance(one, Stop) else _move(one, axes) for one in steps)
    yield from _table(rows, axes)
    yield _count(len(machine.moves), ignored_words(machine.ignored, stops))
    run = stops_in_cuts(stops, machine.moves)
    left_out = sum(stop.why not in EXACT for stop in stops) - sum(s.why not in EXACT for s in run)
    if stops:
        yield stop_summary(stops)
    if left_out:
        yield f"a run leaves out {left_out} of them, before the first cut or behind the last one"
    if machine.tolerance is not None:
        yield f"the program allows {machine.tolerance / UM:.4g} um from its path (P of G64)"
    yield from warnings_of(machine, stops)


def _move(move: Move, axes: int) -> _Row:
    around = ""
    if move.angle:
        around = _around(move.centre[:axes], math.degrees(move.angle))
    kind = "rapid" if move.rapid else "line"
    if move.angle:
        rises = abs(move.end[move.normal] - move.start[move.normal]) > 0
        kind = "helix" if rises else "arc"
    return _Row(_cells(move.line, kind, move.end[:axes], move.feed), around)


def _stop(stop: Stop, axes: int) -> _Row:
    dwells = stop.why == DWELL
    cells = _cells(stop.line, "dwell" if dwells else "stop", stop.place[:axes], math.nan)
    lasting = stop.lasting if dwells else stop.besides
    lasts = f"{lasting:.6g} s" if dwells or lasting > 0 else ""
    return _Row(cells, " ".join(filter(None, ["  for", "" if dwells else stop.why, lasts])))


def _drawn(path: Path, flags: MachineFlags) -> Iterator[str]:
    """Pieces of a drawing, whose curves are several pieces each; it takes a second to load."""
    from jcontour.app.jobs.pace import DRAWING_UNITS, FEED
    from jcontour.geometry.reading import read_drawing

    feed = FEED if flags.feed_mm_per_min is None else flags.feed_mm_per_min
    unit = None if flags.drawing_unit is None else DRAWING_UNITS[flags.drawing_unit]
    drawing = read_drawing(path, feed * MM_PER_MIN, unit, UM * flags.join_um)
    contour = drawing.contour
    ends = np.asarray(contour.position(contour.start + contour.extent))  # a closed one wraps
    polynomial, rate, extent = (
        np.asarray(c) for c in (contour.polynomial, contour.rate, contour.extent)
    )
    (x, y), (x_later, y_later) = np.asarray(contour.cosine).T, np.asarray(contour.sine).T
    turn = x * y_later - y * x_later  # a quarter of a turn later
    rows = []
    for k, end in enumerate(ends):
        kind, around = "rapid" if drawing.rapid[k] else "line", ""
        if polynomial[k, 2:].any():
            kind = "curve"
        elif rate[k]:
            kind = "arc"
            degrees = math.degrees(math.copysign(rate[k] * extent[k], turn[k]))
            around = _around(polynomial[k, 0].tolist(), degrees)
        cells = _cells(int(drawing.line[k]), kind, end.tolist(), float(drawing.feed[k]))
        rows.append(_Row(cells, around))
    yield from _table(rows, ends.shape[1])
    yield _count(len(ends), drawing.ignored)


def _table(rows: Iterable[_Row], axes: int) -> Iterator[str]:
    """The rows below their names, every column as wide as its widest cell."""
    rows = [_Row((*NAMES, *AXES[:axes], "mm/min")), *rows]
    widths = [max(map(len, column)) for column in zip(*(row.cells for row in rows), strict=True)]
    for row in rows:
        line, move, *numbers = map(str.rjust, row.cells, widths)
        yield "  ".join([line, move.strip().ljust(widths[1]), *numbers]) + row.behind


def _cells(line: int, kind: str, end: Sequence[float], feed: float) -> tuple[str, ...]:
    place = (f"{coordinate / MM + 0.0:.4f}" for coordinate in end)
    return str(line), kind, *place, "-" if math.isnan(feed) else feed_number(feed)


def _around(centre: Sequence[float], degrees: float) -> str:
    place = ", ".join(f"{coordinate / MM + 0.0:.4f}" for coordinate in centre)
    return f"  around {place} by {degrees:.4g} degrees"


def _count(moves: int, ignored: Sequence[str]) -> str:
    left_out = f"; ignored: {', '.join(ignored)}" if ignored else ""
    return f"{moves} move{'' if moves == 1 else 's'}{left_out}"
