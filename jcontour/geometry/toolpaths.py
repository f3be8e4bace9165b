"""Toolpath files: G-code and CSV points become a `Contour`, with the feed of every piece.

The G-code read here is RS-274/NGC as LinuxCNC defines it (its documentation, "G-Code"), as far as
mills, routers, lasers and plasma cutters of three axes use it. Everything is metres inside.

    motion     G0 rapid, G1 line, G2 / G3 arc clockwise / counter-clockwise, seen from the tip of
               the plane's normal
    arcs       centre by I J K (from the start of the arc; G90.1: in the program's coordinates) or
               radius R (R < 0: the long way round); P turns; G17 XY, G18 ZX, G19 YZ; motion along
               the normal makes a helix; I J K without an end point is a full circle
    cycles     G73 G74 G81 to G86 G88 G89 as moves, with G98 G99, R, Q and L
    places     G28 G30 G28.1 G30.1, G53, G54 to G59.3, G10 L2 L20, G52,
               G92 and its kin, G43.1
    dwells     G4 P (seconds, as in LinuxCNC; some controls mean milliseconds), or X without P; P of
               the cycles that dwell
    stops      M0 M1 M3 to M9 M19 M52 M60 M61 M64 M65 M66 M68 M100 to M199 but the fans M106 and
               M107, changes of offsets (G54 to G59.3, G43 G49, G92 and its kin, G10) and
               (MSG, ...), as in LinuxCNC; under G61.1 after every move, under G61 in corners;
               moves along Z alone where two axes are traced
    modes      G20 G21 (G70 G71) inch and mm; G90 G91 end points; G90.1 G91.1 centres; F feed per
               minute (G94)
    values     numbers, #1, #<name>, [expressions], functions
    flow       O-words: sub, call, return, if, while, do, repeat, break, continue; M98 M99;
               subprograms in files NAME.ngc beside the program
    tools      G41 G42 with a tool table, G41.1 G42.1 with a diameter D, in the XY plane; G40; G43
               with a tool table
    ignored    and listed, as they move nothing here: G64 (P is kept), G96, G97,
               G4 without a time, M codes that neither stop nor lead elsewhere, and D, E, H, S, T;
               G43 without a tool table
    ends       M2, M30, M99 in the program itself, the second %
    layout     (comments (also nested)), ; comments, N line numbers; case and white space mean
               nothing; a line that begins with / is skipped, as with the block-delete switch on;
               (ABORT, ...) is an error

Anything else is an error with its line number: probing, threads, splines, inverse time (G93), a
feed per turn (G95), the modal state kept (M70 to M73), axes other than X, Y and Z. Programs of 3D
printers are not read. The machine starts at X0 Y0 Z0 in mm, absolute, XY plane, G98 (LinuxCNC:
G99), without a feed; a first move that no motion code leads is a rapid one.
"""

from os import PathLike
from pathlib import Path
from typing import Literal, NamedTuple

import jax
import numpy as np
from jaxtyping import Bool, Float, Int

from jcontour.geometry import contours
from jcontour.geometry.contour import Contour
from jcontour.geometry.gcode.machine_values import warnings_of
from jcontour.geometry.gcode.modes import Tool
from jcontour.geometry.gcode.moves import (
    DWELL,
    EXACT,
    START,
    Move,
    Stop,
    ignored_words,
    stop_summary,
    stops_in_cuts,
)
from jcontour.geometry.gcode.programs import ProgramFiles, files_beside, interpreted
from jcontour.geometry.pieces import Piece
from jcontour.geometry.toolpath_rules import (
    FASTEST,
    SHORTEST,
    ToolpathError,
    csv_points,
    lines_of,
    read_program,
    read_text,
)

__all__ = [
    "Toolpath",
    "ToolpathError",
    "parse_gcode",
    "read_csv",
    "read_gcode",
]

Axes = Literal["XY", "XYZ"]
# [rad] of turn, up to which G61 passes a joint. LinuxCNC does where the turn takes a tenth of the
# acceleration within a cycle of 1 ms (tp.c): 0.005 at 50 mm/s and 2.5 m/s^2
CORNER = 5e-3


class Toolpath(NamedTuple):
    """A file from its first to its last cutting move."""

    contour: Contour  # path of the tool, rapid moves in between included
    # (P,) programmed speed along every piece [m/s], NaN for rapid moves, which have none
    feed: Float[np.ndarray, " P"]
    # (P,) which pieces are rapid moves (G0): traced, but no part is cut there
    rapid: Bool[np.ndarray, " P"]
    # (P,) line of the file that every piece is from; 0 where a drawing does not say
    line: Int[np.ndarray, " P"]
    ignored: tuple[str, ...]  # words of a program that mean nothing for the path, as S or M3
    # (P,) how long the tool dwells at the end of every piece [s]; NaN where it goes on
    rest: Float[np.ndarray, " P"]
    # (P,) how long Z then moves alone at its programmed feed [s], where two axes are traced; its
    # rapid moves count as 0
    z_alone: Float[np.ndarray, " P"]
    warnings: tuple[str, ...] = ()  # what of the program may be meant otherwise
    stops: str = ""  # where and why it stops, in words; empty where it does not
    # stops for more than a rest, as for M3 or while Z moves alone; `after` counts pieces. Why
    # "start": something comes before the first cut.
    asks: tuple[Stop, ...] = ()
    # numbers of the cut pieces along which Z moves too, where two axes are traced
    ramps: tuple[int, ...] = ()
    # how far from its path the program allows the tool to go, P of G64 [m]; None where it does not
    # say
    tolerance: float | None = None


def read_gcode(
    path: str | PathLike[str],
    axes: Axes = "XY",
    feed: float | None = None,
    tools: dict[int, Tool] | None = None,
) -> Toolpath:
    """Toolpath of a G-code file; see `parse_gcode`.

    Raises:
        ToolpathError: what `parse_gcode` says, or the file is missing or too long.
    """
    return parse_gcode(read_program(path), axes, feed, files_beside(Path(path)), tools)


def parse_gcode(
    text: str,
    axes: Axes = "XY",
    feed: float | None = None,
    files: ProgramFiles | None = None,
    tools: dict[int, Tool] | None = None,
) -> Toolpath:
    """Toolpath of a G-code program; the module's docstring says what it may contain.

    An arc whose end lies beside its circle is accepted where LinuxCNC accepts it: when the radii at
    start and end differ by at most 28.3 um (71.8 um in inches), or by at most 0.1 % and a hundred
    times that. Its centre is then moved so that it meets both ends; beyond half a turn it becomes
    two arcs, to stay near the circle. An R too short for its end by at most 5 um, or 0.1 % and
    0.5 mm, is a half circle.

    >>> program = '''
    ...     G21 G90 G0 X0 Y0
    ...     G1 X20 F600        (mm, mm/min)
    ...     G3 X20 Y10 J5
    ... '''
    >>> path = parse_gcode(program)
    >>> path.feed.tolist()
    [0.01, 0.01]
    >>> round(float(path.contour.length), 6)
    0.035708

    Args:
        text: the program.
        axes: "XYZ", or "XY" for its projection: the tool waits while Z moves alone, the other moves
            last as long as they did (their feed is that of the projection); a cut in another plane
            than XY is an error.
        feed: speed along the contour [m/s] instead of every programmed feed.
        files: lines of the files that subprograms are in, by name.
        tools: of a tool table, by number, for G41, G42 and G43; None without one.

    Raises:
        ToolpathError: "line 12: ..." for whatever cannot be read or traced; no cutting move; a feed
            that is not above zero.
    """
    if axes not in ("XY", "XYZ"):
        raise ToolpathError(f'axes: needs "XY" or "XYZ", received {axes!r}')
    if feed is not None and not 0 < feed <= FASTEST:
        raise ToolpathError(
            f"feed: needs to be above 0 and at most {FASTEST:g} m/s, received {feed}"
        )
    interpreter = interpreted(lines_of(text), len(axes), feed, files, tools=tools)
    moves = interpreter.moves
    cutting = [i for i, move in enumerate(moves) if not move.rapid]
    if not cutting:
        raise ToolpathError(
            f"the program has no cutting move (G1, G2, G3) along {' or '.join(axes)}"
        )
    traced = moves[cutting[0] : cutting[-1] + 1]
    every = interpreter.tracer.stops
    stops = stops_in_cuts(every, moves)
    path = _toolpath(traced, len(axes), feed, ignored_words(interpreter.ignored, stops))
    # Stops of a run, the first piece of which is a move, for more than a rest
    first = cutting[0]
    asked = [stop for stop in stops if stop.why != DWELL and stop.why not in EXACT]
    moved = [stop._replace(after=stop.after - first) for stop in asked]
    begun = moves[first]
    if first or begun.start[2] or any(stop.after == 0 and stop.why != DWELL for stop in every):
        moved.insert(0, Stop(0, begun.start, 0.0, begun.line, START))
    return path._replace(
        rest=_rest(stops, cutting[0], path.contour),
        z_alone=_z_alone(stops, cutting[0], path.contour),
        warnings=warnings_of(interpreter, stops),
        stops=stop_summary(stops),
        asks=tuple(moved),
        ramps=_ramps(traced) if len(axes) == 2 else (),
        tolerance=interpreter.tolerance,
    )


def read_csv(path: str | PathLike[str], feed: float) -> Toolpath:
    r"""Polyline through the points of a CSV file, cut at `feed` [m/s].

    The columns are x,y or x,y,z in millimetres, one point per line. The polyline is closed when the
    last point is the first. A header (x,y or x_mm,y_mm, likewise with z), empty lines and lines
    that begin with # may be there. Points within 1 nm of the one before are dropped.

    >>> from pathlib import Path
    >>> _ = Path("points.csv").write_text("x,y\n0,0\n30,0\n30,40\n")
    >>> path = read_csv("points.csv", feed=0.05)
    >>> round(float(path.contour.length), 9), path.line.tolist()
    (0.07, [3, 4])

    Raises:
        ToolpathError: "line 3: ..." for a row that is not two or three numbers; fewer than two
            distinct points; a file that cannot be read.
    """
    points = csv_points(lines_of(read_text(path)))
    if len(points.places) < 2:
        raise ToolpathError("the file has fewer than two distinct points")
    line = np.array(points.lines[1:])
    same, never = np.full(line.size, feed), np.zeros(line.size)
    contour = contours.polyline(points.places)
    return Toolpath(contour, same, never > 0, line, (), np.full(line.size, np.nan), never)


def _rest(stops: list[Stop], first: int, contour: Contour) -> Float[np.ndarray, " P"]:
    """Rest at the end of every piece, the first of which is a move [s]; NaN where it goes on."""
    rest = np.full(contour.rate.size, np.nan)
    exact = any(stop.why == "G61" for stop in stops)
    corner = np.append(_turned(contour) > CORNER, True) if exact else None
    for stop in stops:
        move = stop.after - 1 - first
        if stop.why != "G61" or corner is None or corner[move]:
            rest[move] = np.nan_to_num(rest[move]) + stop.lasting
    return rest


def _ramps(moves: list[Move]) -> tuple[int, ...]:
    """Numbers of cuts that go up or down along the third axis."""
    return tuple(
        number
        for number, move in enumerate(moves)
        if not move.rapid and abs(move.end[2] - move.start[2]) >= SHORTEST
    )


def _z_alone(stops: list[Stop], first: int, contour: Contour) -> Float[np.ndarray, " P"]:
    """How long Z moves alone at its feed at the end of every piece [s]."""
    lasting = np.zeros(contour.rate.size)
    for stop in stops:
        lasting[stop.after - 1 - first] += np.nan_to_num(stop.besides)
    return lasting


def _turned(contour: Contour) -> Float[np.ndarray, " joints"]:
    """Jump of the direction between neighbouring pieces [1]."""
    pieces = jax.tree.map(np.asarray, contour.pieces)
    end, begin = (pieces.jet(s)[1] for s in (pieces.extent, 0.0 * pieces.extent))
    return np.linalg.norm(begin[1:] - end[:-1], axis=-1)


def _toolpath(
    moves: list[Move],
    axes: int,
    feed_given: float | None,
    ignored: tuple[str, ...],
) -> Toolpath:
    """Toolpath of all moves at once, without stops: a Contour per move would take minutes."""
    start, end, centre, angle, normal, feed, rapid, line = (
        np.array(column) for column in zip(*moves, strict=True)
    )
    axis = np.eye(3)[normal]
    pieces = _pieces(start, end, centre, angle, axis)
    if axes == 2:
        flat, length = np.array([1.0, 1.0, 0.0]), pieces.extent
        pieces = _pieces(start * flat, end * flat, centre * flat, angle, axis)
        feed = feed * pieces.extent / length
        pieces = pieces._replace(
            polynomial=pieces.polynomial[..., :2],
            cosine=pieces.cosine[:, :2],
            sine=pieces.sine[:, :2],
        )
    if feed_given is not None:
        feed = np.where(rapid, np.nan, feed_given)
    helical = (pieces.rate > 0) & pieces.polynomial[:, 1].any(axis=-1)
    newton_steps = contours.NEWTON_STEPS if helical.any() else 0
    contour = contours.from_pieces(pieces, newton_steps=newton_steps)
    nowhere, never = np.full(line.size, np.nan), np.zeros(line.size)
    return Toolpath(contour, feed, rapid, line, ignored, nowhere, never)


def _pieces(start, end, centre, angle, normal) -> Piece:
    turns = (angle != 0)[:, None]
    delta = end - start
    rise = np.sum(delta * normal, axis=1, keepdims=True) * normal
    radial = np.where(turns, start - centre, 0.0)
    along = np.where(turns, rise, delta)
    extent = np.hypot(np.linalg.norm(radial, axis=1) * angle, np.linalg.norm(along, axis=1))
    polynomial = np.zeros((angle.size, 6, 3))
    polynomial[:, 0], polynomial[:, 1] = np.where(turns, centre, start), along / extent[:, None]
    sine = np.sign(angle)[:, None] * np.cross(normal, radial)
    return Piece(polynomial, radial, sine, np.abs(angle) / extent, np.zeros(angle.size), extent)


def __dir__() -> list[str]:
    return __all__
