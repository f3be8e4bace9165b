"""Drawings by the suffix of their files."""

from os import PathLike
from pathlib import Path

from jcontour.geometry.drawings.drawing import GAP, Drawing
from jcontour.geometry.drawings.dxf import read_dxf
from jcontour.geometry.drawings.svg import read_svg
from jcontour.geometry.toolpath_rules import ToolpathError
from jcontour.geometry.toolpaths import Toolpath

SUFFIXES = (".dxf", ".svg")


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
        return _drawing(Path(path), unit).toolpath(feed, gap)
    except OverflowError:
        raise ToolpathError("a number is too large to compute with") from None


def _drawing(path: Path, unit: float | None) -> Drawing:
    return read_svg(path, unit) if path.suffix.lower() == ".svg" else read_dxf(path, unit)
