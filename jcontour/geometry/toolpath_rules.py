"""Text of toolpath files, rules that all of them obey, and points of CSV files; nothing heavy."""

import math
import re
from collections.abc import Iterable
from os import PathLike
from pathlib import Path
from typing import NamedTuple

from jcontour._regular_files import content_of

MM = 1e-3  # [m]
INCH = 25.4e-3  # [m]
# [m] shorter moves are dropped, nearer end points are the same: a thousandth of the finest word
# that a program holds
SHORTEST = 1e-9
FARTHEST = 100.0  # [m] of any coordinate; a machine that large is not meant
FASTEST = 100.0  # [m/s]
SLOWEST = 1e-6  # [m/s] of a programmed feed: a millimetre in a quarter of an hour
MOST_MOVES = 500_000  # each is a sample at least
DRAWINGS = (".dxf", ".svg")  # suffixes
GAP = 10e-6  # [m] ends of a drawing this close are joined: programs that draw snap to less
NUMBER = r"[+-]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)"  # regular expression of a decimal number


class ToolpathError(ValueError):
    """A toolpath that cannot be traced.

    The message is one line, which begins with the number of the line where there is one.
    """


def shown(text: str, most: int = 40) -> str:
    """Extract of a file for a message: one line, not long."""
    text = text.strip()
    return ascii(text if len(text) <= most else text[: most - 3] + "...")


# control characters that are no white space: tape marks, padding, the end of a DOS file (Ctrl-Z)
MARKS = "".join(map(chr, (*range(9), *range(14, 32), 127)))
BLANK = " \t\r\n\f\v"
UTF_16 = (b"\xff\xfe", b"\xfe\xff")  # with this mark ahead, as Windows' "Unicode" text has it
UTF_8_MARK = b"\xef\xbb\xbf"
MOST_BYTES = 64 * 2**20  # of a file; longer than any program with as many moves as may be


def read_text(path: str | PathLike[str]) -> str:
    """Text of a file in UTF-8, with or without a byte-order mark.

    Raises:
        ToolpathError: the file is missing, larger than 64 MiB or not UTF-8.
    """
    content = _content(Path(path))
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        byte = content[error.start]
        raise ToolpathError(f"line {line}: byte 0x{byte:02x} is not UTF-8 text") from None


def read_program(path: str | PathLike[str]) -> str:
    """Text of a program, in UTF-8, marked UTF-16, or else one byte a letter (Latin-1).

    Words are ASCII, so that UTF-8 and Latin-1 differ in comments only. Control characters around
    the program are left out.

    Raises:
        ToolpathError: the file is missing, or larger than 64 MiB.
    """
    content = _content(Path(path))
    try:
        marked = content.startswith(UTF_16)
        text = content.decode("utf-16", "replace") if marked else content.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = content.removeprefix(UTF_8_MARK).decode("latin-1")
    ahead = text[: len(text) - len(text.lstrip(MARKS + BLANK))]
    lines = ahead.translate(str.maketrans("", "", MARKS))
    return lines + text[len(ahead) :].rstrip(MARKS + BLANK)


def _content(path: Path) -> bytes:
    try:
        return content_of(path, MOST_BYTES)
    except FileNotFoundError:
        raise ToolpathError(f"{shown(str(path), 200)}: no such file") from None
    except OSError as error:
        raise ToolpathError(f"{shown(str(path), 200)}: {error.strerror}") from None


def lines_of(text: str) -> list[str]:
    r"""Lines that end with a line feed, a carriage return, or both.

    >>> lines_of("G1 X1\r\nX2\rX3")
    ['G1 X1', 'X2', 'X3']
    """
    return re.split(r"\r\n|\r|\n", text)


CSV_NUMBER = re.compile(rf"{NUMBER}(?:[eE][+-]?[0-9]+)?")
CSV_HEADERS = (["x", "y"], ["x", "y", "z"], ["x_mm", "y_mm"], ["x_mm", "y_mm", "z_mm"])

Point = tuple[float, ...]  # [m]


class CsvPoints(NamedTuple):
    """Points of a file in order."""

    places: list[Point]  # coordinates of each [m]
    lines: list[int]  # of the file that they are from, from 1


def csv_points(lines: Iterable[str]) -> CsvPoints:
    """Points of the lines, those within 1 nm of the one before left out.

    >>> csv_points(["x,y", "0,0", "", "30,40"])
    CsvPoints(places=[(0.0, 0.0), (0.03, 0.04)], lines=[2, 4])

    Raises:
        ToolpathError: "line 3: ..." for a row that is not two or three numbers.
    """
    points, found_in = list[Point](), list[int]()
    for number, line in enumerate(lines, start=1):
        cells = [cell.strip() for cell in line.split(",")]
        blank = cells == [""] or line.lstrip().startswith("#")
        header = not points and [cell.lower() for cell in cells] in CSV_HEADERS
        if blank or header:
            continue
        if len(cells) not in (2, 3) or not all(CSV_NUMBER.fullmatch(cell) for cell in cells):
            raise ToolpathError(
                f"line {number}: needs two or three numbers x,y[,z] in mm, received {shown(line)}"
            )
        point = tuple(MM * float(cell) for cell in cells)
        if not all(abs(coordinate) <= FARTHEST for coordinate in point):
            raise ToolpathError(f"line {number}: {shown(line)} is farther than {FARTHEST:g} m away")
        if points and len(point) != len(points[0]):
            raise ToolpathError(
                f"line {number}: needs {len(points[0])} numbers as the lines above, "
                f"received {shown(line)}"
            )
        if not points or math.dist(point, points[-1]) >= SHORTEST:
            points.append(point)
            found_in.append(number)
        if len(points) > MOST_MOVES:
            raise ToolpathError(f"line {number}: more than {MOST_MOVES} points")
    return CsvPoints(points, found_in)
