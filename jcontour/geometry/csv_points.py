"""Points in the rows of a CSV file, read without anything heavy; `toolpaths` says what is there."""

import math
import re
from collections.abc import Iterable
from typing import NamedTuple

from jcontour.geometry.toolpath_rules import (
    FARTHEST,
    MM,
    MOST_MOVES,
    NUMBER,
    SHORTEST,
    ToolpathError,
    shown,
)

CSV_NUMBER = re.compile(rf"{NUMBER}(?:[eE][+-]?[0-9]+)?")
CSV_HEADERS = (["x", "y"], ["x", "y", "z"], ["x_mm", "y_mm"], ["x_mm", "y_mm", "z_mm"])

Point = tuple[float, ...]  # [m]


class CsvPoints(NamedTuple):
    """Points of a file in order.

    Attributes:
        places: coordinates of each [m].
        lines: of the file that they are from, from 1.
    """

    places: list[Point]
    lines: list[int]


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
