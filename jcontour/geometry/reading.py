"""Part files by their suffix."""

from os import PathLike
from pathlib import Path

from jcontour.geometry.gcode.modes import Tool
from jcontour.geometry.toolpath_rules import DRAWINGS, GAP, ToolpathError
from jcontour.geometry.toolpaths import Axes, Toolpath, read_csv, read_gcode


def read(
    path: str | PathLike[str],
    feed: float | None = None,
    axes: Axes = "XY",
    unit: float | None = None,
    gap: float = GAP,
    tools: dict[int, Tool] | None = None,
) -> Toolpath:
    """Toolpath of a file: .csv points, a .dxf or .svg drawing, or else G-code.

    Args:
        path: of the file.
        feed: along the contour [m/s]. Points and drawings need one; it replaces a program's own.
        axes: of a program, "XYZ", or "XY" for its projection.
        unit: of a drawing [m], whatever the file says; None for the file's own.
        gap: ends of a drawing within it are joined [m].
        tools: of a tool table, by number, for cutter compensation in a program.

    Raises:
        ToolpathError: as `read_csv`, `read_drawing` and `read_gcode`; points or a drawing without a
            feed.
    """
    suffix = Path(path).suffix.lower()
    if suffix != ".csv" and suffix not in DRAWINGS:
        return read_gcode(path, axes, feed, tools)
    if feed is None:
        raise ToolpathError(f"{suffix[1:]} files say no feed: give `feed` [m/s]")
    return read_csv(path, feed) if suffix == ".csv" else read_drawing(path, feed, unit, gap)


def read_drawing(
    path: str | PathLike[str], feed: float, unit: float | None = None, gap: float = GAP
) -> Toolpath:
    """Toolpath of a DXF or SVG file: contours at a feed [m/s], rapid moves between them.

    Contours come in the order of the file, from where each was begun to be drawn. Lines and arcs
    stay what they are. Ellipses, splines and Bezier curves become quintic pieces within 10 nm.

    Args:
        path: of the file.
        feed: along the contours [m/s].
        unit: of the drawing [m], whatever the file says; None for the file's own.
        gap: ends within it are joined [m].

    Raises:
        ToolpathError: the file or a shape cannot be read; nothing is drawn; a file without
            a unit where none is given.
    """
    try:
        if Path(path).suffix.lower() == ".svg":
            from jcontour.geometry.drawings.svg import read_svg as read_shapes
        else:
            from jcontour.geometry.drawings.dxf import read_dxf as read_shapes
        drawing = read_shapes(path, unit)
        return drawing.toolpath(feed, gap)
    except OverflowError:
        raise ToolpathError("a number is too large to compute with") from None
