"""Toolpath files: G-code and CSV points become a `Contour`, with the programmed feed of every piece.

The G-code read here (RS-274 as mills speak it; numbers in mm until G20 says inches, everything is metres inside):

    motion     G0 rapid, G1 line, G2 / G3 arc clockwise / counter-clockwise, seen from the tip of the plane's normal
    arcs       centre by I J K (from the start of the arc) or radius R (R < 0: the long way round); G17 XY, G18 ZX, G19 YZ;
               motion along the normal makes a helix; I J K without an end point is a full circle
    modes      G20 G21 inch and mm; G90 G91 absolute and incremental end points; F feed per minute
    ignored    G40 G49 G54 G61 G64 (with P) G91.1 G94; M0 M1 M3 M4 M5 M6 M7 M8 M9; S, T, N; G80 ends the motion mode; M2 M30 end the program
    layout     (comments), ; comments, % lines; a line that begins with / is skipped, as with the block-delete switch on

Anything else is an error with its line number, dwells (G4), G53, other offsets, cycles, G90.1 and G93 among it: they move the tool
or the clock. The machine starts at X0 Y0 Z0 in mm, absolute, XY plane, with neither a feed nor a motion mode.
"""

import cmath
import math
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from jcontour import contours
from jcontour.contour import Contour
from jcontour.pieces import Piece

MM, INCH = 1e-3, 25.4e-3  # [m]
SHORTEST = 1e-9  # [m] moves below it are dropped, end points below it are the same: a thousandth of the finest word a program holds
FARTHEST = 100.0  # [m] of any coordinate; a machine that large is not meant
FASTEST = 100.0  # [m/s]
LARGEST = 1e9  # of any number in a program
MOST_BYTES = 64 * 2**20  # of a file; longer than any program with the number of moves below
MOST_MOVES = 100_000  # each is a sample at least, and kilobytes while its box is measured
ARC_SLACK, ARC_SLACK_RELATIVE, ARC_SLACK_MOST = 5e-6, 1e-3, 0.5e-3  # [m], of the radius, [m]: between both radii of an arc, as Grbl has it

PLANES = {17: (0, 1, 2), 18: (2, 0, 1), 19: (1, 2, 0)}  # first and second axis of the plane, then its normal
MODES = {"motion": (0, 1, 2, 3, 80), "plane": (17, 18, 19), "units": (20, 21), "distance": (90, 91)}
MODE_OF = {float(code): mode for mode, codes in MODES.items() for code in codes}
NO_MOTION_IN = frozenset({40, 49, 54, 61, 64, 91.1, 94})
MACHINE_CODES = frozenset({0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 30})
WORDS = frozenset("FIJKNRSTXYZ")

NUMBER = r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)"
WORD = re.compile(rf"\s*([A-Za-z])\s*({NUMBER})")
COMMENT = re.compile(r"\([^)]*\)|;.*")
CSV_NUMBER = re.compile(rf"{NUMBER}(?:[eE][+-]?[0-9]+)?")
CSV_HEADERS = (["x", "y"], ["x", "y", "z"], ["x_mm", "y_mm"], ["x_mm", "y_mm", "z_mm"])

Axes = Literal["XY", "XYZ"]
Point = tuple[float, float, float]


class ToolpathError(ValueError):
    """A toolpath that cannot be traced; the message is one line, which begins with the number of the line where there is one."""


class Toolpath(NamedTuple):
    """A program from its first to its last cutting move.

    Attributes:
        contour: what the tool traces, rapid moves in between included.
        feed: (P,) programmed speed along every piece [m/s], NaN for rapid moves, which have none.
        rapid: (P,) which pieces are rapid moves (G0): traced, but no part is cut there.
    """

    contour: Contour
    feed: Float[np.ndarray, " P"]
    rapid: Bool[np.ndarray, " P"]


def read_gcode(path: str | PathLike[str], axes: Axes = "XY", feed: float | None = None) -> Toolpath:
    """Toolpath of a G-code file; see `parse_gcode`.

    Raises:
        ToolpathError: what `parse_gcode` says, or the file is missing, too long or not UTF-8.
    """
    return parse_gcode(_text(path), axes, feed)


def parse_gcode(text: str, axes: Axes = "XY", feed: float | None = None) -> Toolpath:
    """Toolpath of a G-code program; the module's docstring says what it may contain.

    An arc whose end lies beside its circle is accepted where Grbl accepts it: when the radii at start and end differ by at most
    5 um, or by at most 0.1 % and 0.5 mm. Its centre is then moved so that it meets both ends; beyond half a turn it becomes two arcs,
    to stay near the circle. An R arc too short for its end by no more than that is a half circle.

    Args:
        text: the program.
        axes: "XYZ", or "XY" for its projection: moves along Z alone vanish, the others last as long as they did (their feed is that of the
            projection), arcs in other planes are errors.
        feed: speed along the contour [m/s] instead of every programmed feed.

    Raises:
        ToolpathError: "line 12: ..." for whatever cannot be read or traced; no cutting move; a feed that is not above zero.
    """
    if axes not in ("XY", "XYZ"):
        raise ToolpathError(f'axes: needs "XY" or "XYZ", received {axes!r}')
    if feed is not None and not 0 < feed <= FASTEST:
        raise ToolpathError(f"feed: needs to be above 0 and at most {FASTEST:g} m/s, received {feed}")
    interpreter = _Interpreter(axes=len(axes), feed=feed)
    for number, line in enumerate(re.split(r"\r\n|\r|\n", text), start=1):
        try:
            interpreter.execute(line)
        except ToolpathError as error:
            raise ToolpathError(f"line {number}: {error}") from None
        if interpreter.ended:
            break
    moves = interpreter.moves
    cutting = [i for i, move in enumerate(moves) if not move.rapid]
    if not cutting:
        raise ToolpathError(f"the program has no cutting move (G1, G2, G3) along {' or '.join(axes)}")
    return _toolpath(moves[cutting[0] : cutting[-1] + 1], len(axes), feed)


def read_csv(path: str | PathLike[str]) -> Contour:
    """Polyline through the points of a CSV file: columns x,y or x,y,z in millimetres, one point per line.

    It is closed when the last point is the first. A header (x,y or x_mm,y_mm, likewise with z), empty lines and lines that begin
    with # may be there. Points within 1 nm of the one before are dropped.

    Raises:
        ToolpathError: "line 3: ..." for a row that is not two or three numbers; fewer than two distinct points; a file that cannot be read.
    """
    points: list[tuple[float, ...]] = []
    for number, line in enumerate(re.split(r"\r\n|\r|\n", _text(path)), start=1):
        cells = [cell.strip() for cell in line.split(",")]
        if cells == [""] or line.lstrip().startswith("#") or (not points and [cell.lower() for cell in cells] in CSV_HEADERS):
            continue
        if len(cells) not in (2, 3) or not all(CSV_NUMBER.fullmatch(cell) for cell in cells):
            raise ToolpathError(f"line {number}: needs two or three numbers x,y[,z] in mm, received {_shown(line)}")
        point = tuple(MM * float(cell) for cell in cells)
        if not all(abs(coordinate) <= FARTHEST for coordinate in point):
            raise ToolpathError(f"line {number}: {_shown(line)} is farther than {FARTHEST:g} m away")
        if points and len(point) != len(points[0]):
            raise ToolpathError(f"line {number}: needs {len(points[0])} numbers as the lines above, received {_shown(line)}")
        if not points or math.dist(point, points[-1]) >= SHORTEST:
            points.append(point)
        if len(points) > MOST_MOVES:
            raise ToolpathError(f"line {number}: more than {MOST_MOVES} points")
    if len(points) < 2:
        raise ToolpathError("the file has fewer than two distinct points")
    return contours.polyline(points)


class _Move(NamedTuple):
    """A line, or an arc or helix where `angle` is not zero (signed, around the plane's normal)."""

    start: Point
    end: Point
    centre: Point
    angle: float
    normal: int
    feed: float
    rapid: bool


@dataclass
class _Interpreter:
    """The modal state of a machine control, and the moves it has made."""

    axes: int
    feed: float | None
    motion: int | None = None
    plane: int = 17
    unit: float = MM
    incremental: bool = False
    at: Point = (0.0, 0.0, 0.0)
    ended: bool = False
    moves: list[_Move] = field(default_factory=list)

    def execute(self, line: str) -> None:
        line = COMMENT.sub(" ", line).strip()
        if line in ("", "%") or line.startswith("/"):
            return
        modes, machine_codes, values = _words(line)
        self.unit = {20: INCH, 21: MM}.get(modes.get("units", 0), self.unit)
        self.plane = modes.get("plane", self.plane)
        self.incremental = {90: False, 91: True}.get(modes.get("distance", 0), self.incremental)
        if "motion" in modes:
            self.motion = None if modes["motion"] == 80 else modes["motion"]
        if "F" in values:
            self._set_feed(values["F"])
        if values.keys() & frozenset("XYZIJKR"):
            self._move(values)
        if len(self.moves) > MOST_MOVES:
            raise ToolpathError(f"more than {MOST_MOVES} moves")
        self.ended = bool(machine_codes & {2, 30})

    def _set_feed(self, word: float) -> None:
        feed = word * self.unit / 60.0
        if not 0 < feed <= FASTEST:
            raise ToolpathError(f"the feed needs to be above 0 and at most {FASTEST:g} m/s, received F{word:g}")
        self.feed = feed

    def _move(self, values: dict[str, float]) -> None:
        target, offset, radius = self._lengths(values)
        if self.motion is None:
            raise ToolpathError("axis words without a motion mode (G0, G1, G2 or G3) before them")
        if self.motion > 0 and self.feed is None:
            raise ToolpathError("a cutting move without a feed (F) before it")
        if self.motion > 1:
            self._arc(target, offset, radius)
        elif offset or radius is not None:
            raise ToolpathError(f"I, J, K and R belong to arcs (G2, G3), not to G{self.motion}")
        else:
            self._trace(target, target, 0.0)

    def _lengths(self, values: dict[str, float]) -> tuple[Point, dict[int, float], float | None]:
        """End point, given centre offsets by axis, and the radius [m]."""
        lengths = {letter: values[letter] * self.unit for letter in values.keys() & frozenset("XYZIJKR")}
        origin = self.at if self.incremental else (0.0, 0.0, 0.0)
        x, y, z = (origin[i] + lengths[name] if name in lengths else self.at[i] for i, name in enumerate("XYZ"))
        if not all(abs(length) <= FARTHEST for length in (x, y, z, *lengths.values())):
            raise ToolpathError(f"a coordinate is farther than {FARTHEST:g} m away")
        return (x, y, z), {i: lengths[name] for i, name in enumerate("IJK") if name in lengths}, lengths.get("R")

    def _arc(self, target: Point, offset: dict[int, float], radius: float | None) -> None:
        first, second, normal = PLANES[self.plane]
        if normal < 2 and self.axes == 2:
            raise ToolpathError(f'an arc in the plane of G{self.plane} needs a third axis: read the program with axes "XYZ"')
        if bool(offset) == (radius is not None):
            raise ToolpathError("an arc needs either a centre (I, J, K) or a radius (R)")
        if offset.get(normal):
            raise ToolpathError(f"{'IJK'[normal]} is not in the plane of G{self.plane}")
        counter_clockwise = self.motion == 3
        start, end = complex(self.at[first], self.at[second]), complex(target[first], target[second])
        if radius is None:
            centre = start + complex(offset.get(first, 0.0), offset.get(second, 0.0))
        else:
            centre = _centre_from_radius(start, end, radius, counter_clockwise)
        arcs = list(_arcs(start, end, centre, counter_clockwise))
        rise = target[normal] - self.at[normal]
        slope = rise / sum(angle for _, _, angle in arcs) if abs(rise) >= SHORTEST else 0.0
        for end, centre, angle in arcs:
            level = self.at[normal]
            self._trace(_in_space(self.plane, end, level + slope * angle), _in_space(self.plane, centre, level), angle)

    def _trace(self, end: Point, centre: Point, angle: float) -> None:
        """Adds a move; one too short to see only takes the axes that are not traced along."""
        if angle == 0.0 and math.dist(self.at[: self.axes], end[: self.axes]) < SHORTEST:
            self.at = (self.at[0], self.at[1], end[2] if self.axes == 2 else self.at[2])
            return
        rapid = self.motion == 0
        feed = math.nan if rapid or self.feed is None else self.feed
        self.moves.append(_Move(self.at, end, centre, angle, PLANES[self.plane][2], feed, rapid))
        self.at = end


def _words(line: str) -> tuple[dict[str, int], set[float], dict[str, float]]:
    """Modal G codes by their group, M codes, and the values of the other words of a line."""
    modes, others, machine_codes, values = {}, set(), set(), {}
    position = 0
    while position < len(line):
        match = WORD.match(line, position)
        if not match:
            raise ToolpathError(f"cannot read {_shown(line[position:])}")
        position = match.end()
        letter, value, word = match[1].upper(), float(match[2]), match[0]
        if not abs(value) <= LARGEST:
            raise ToolpathError(f"the number in {_shown(word)} is too large")
        if letter == "G" and value in MODE_OF:
            if MODE_OF[value] in modes:
                raise ToolpathError(f"{_shown(word)} and another G code of its kind ({MODE_OF[value]}) in one line")
            modes[MODE_OF[value]] = int(value)
        elif letter == "G" and value in NO_MOTION_IN:
            others.add(value)
        elif letter == "M" and value in MACHINE_CODES:
            machine_codes.add(value)
        elif letter in WORDS or (letter == "P" and 64 in others):
            if letter in values:
                raise ToolpathError(f"{letter} is given twice")
            values[letter] = value
        else:
            raise ToolpathError(f"{_shown(word)} is not supported" if letter in "GM" else f"unknown word {_shown(word)}")
        if letter in "NST" and (value < 0 or value % 1):
            raise ToolpathError(f"{_shown(word)}: {letter} needs a whole number that is not negative")
    return modes, machine_codes, values


def _in_space(plane: int, point: complex, level: float) -> Point:
    """Point in space from its place in a plane and its level along the plane's normal."""
    first, second, normal = PLANES[plane]
    coordinates = {first: point.real, second: point.imag, normal: level}
    return coordinates[0], coordinates[1], coordinates[2]


def _centre_from_radius(start: complex, end: complex, radius: float, counter_clockwise: bool) -> complex:
    chord = end - start
    half = 0.5 * abs(chord)
    if 2 * half < SHORTEST:
        raise ToolpathError("an arc by radius (R) needs an end apart from its start; a full circle needs I, J or K")
    if abs(radius) < SHORTEST or (abs(radius) < half and not _same_radius(abs(radius), half)):
        raise ToolpathError(f"a radius of {abs(radius) / MM:.6g} mm does not reach the end of the arc, {2 * half / MM:.6g} mm away")
    height = math.sqrt(max(radius**2 - half**2, 0.0))
    to_the_left = counter_clockwise == (radius > 0)
    return start + chord * (0.5 + (1j if to_the_left else -1j) * height / abs(chord))


def _arcs(start: complex, end: complex, centre: complex, counter_clockwise: bool) -> Iterator[tuple[complex, complex, float]]:
    """Ends, centres and signed angles of the one or two arcs which run exactly from start to end; the given centre may be slightly off."""
    first, last = abs(start - centre), abs(end - centre)
    if not _same_radius(first, last):
        raise ToolpathError(
            f"the end of the arc is off its circle: the radius is {first / MM:.6g} mm at the start and {last / MM:.6g} mm at the end, "
            f"{abs(first - last) / MM:.3g} mm apart"
        )
    if min(first, last) < SHORTEST:
        raise ToolpathError("an arc without a radius")
    chord = end - start
    if abs(chord) < SHORTEST:
        yield start, centre, math.copysign(math.tau, 1 if counter_clockwise else -1)
        return
    angle = _angle(start - centre, end - centre, counter_clockwise)
    from_middle = (centre - 0.5 * (start + end)) / chord
    if abs(angle) > math.pi and abs(from_middle.real * chord) > SHORTEST:
        middle = centre + (start - centre) * cmath.rect(0.5 * (first + last) / first, 0.5 * angle)
        yield from _arcs(start, middle, centre, counter_clockwise)
        yield from _arcs(middle, end, centre, counter_clockwise)
        return
    centre = 0.5 * (start + end) + 1j * from_middle.imag * chord  # on the bisector of the chord
    yield end, centre, _angle(start - centre, end - centre, counter_clockwise)


def _angle(first: complex, last: complex, counter_clockwise: bool) -> float:
    """Signed angle from one radius to the other, a whole turn when they agree."""
    turned = cmath.phase(last / first) * (1 if counter_clockwise else -1) % math.tau
    turned = math.tau if turned * abs(first) < SHORTEST else turned
    return turned if counter_clockwise else -turned


def _same_radius(first: float, last: float) -> bool:
    gap = abs(first - last)
    return gap <= ARC_SLACK or (gap <= ARC_SLACK_MOST and gap <= ARC_SLACK_RELATIVE * first)


def _toolpath(moves: list[_Move], axes: int, feed_given: float | None) -> Toolpath:
    """All pieces at once: chaining a Contour per move would take minutes."""
    start, end, centre, angle, normal, feed, rapid = (np.array(column) for column in zip(*moves, strict=True))
    pieces = _pieces(start, end, centre, angle, np.eye(3)[normal])
    if axes == 2:
        flat = np.array([1.0, 1.0, 0.0])
        length, pieces = pieces.extent, _pieces(start * flat, end * flat, centre * flat, angle, np.eye(3)[normal])
        feed = feed * pieces.extent / length
        pieces = pieces._replace(polynomial=pieces.polynomial[..., :2], cosine=pieces.cosine[:, :2], sine=pieces.sine[:, :2])
    if feed_given is not None:
        feed = np.where(rapid, np.nan, feed_given)
    helical = (pieces.rate > 0) & pieces.polynomial[:, 1].any(axis=-1)
    return Toolpath(contours.from_pieces(pieces, newton_steps=contours.NEWTON_STEPS if helical.any() else 0), feed, rapid)


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


def _text(path: str | PathLike[str]) -> str:
    path = Path(path)
    if not path.is_file():
        raise ToolpathError(f"{_shown(str(path), 200)}: {'not a file' if path.exists() else 'no such file'}")
    if path.stat().st_size > MOST_BYTES:
        raise ToolpathError(f"{path}: larger than {MOST_BYTES >> 20} MiB")
    try:
        content = path.read_bytes()
    except OSError as error:
        raise ToolpathError(f"{path}: {error.strerror}") from None
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        raise ToolpathError(f"line {line}: byte 0x{content[error.start]:02x} is not UTF-8 text") from None


def _shown(text: str, most: int = 40) -> str:
    """A piece of the file for a message: one line, not long."""
    text = text.strip()
    return ascii(text if len(text) <= most else text[: most - 3] + "...")
