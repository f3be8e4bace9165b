"""Pieces of a contour from the segments of a drawing: lines and arcs as they are, others fitted."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from jcontour.geometry.drawings.segments import Arc, Curve, Line, Segment, vanishes
from jcontour.geometry.drawings.smooth_curves import Ellipses, RationalCurves, pairs
from jcontour.geometry.pieces import Piece
from jcontour.geometry.quintics import fitted
from jcontour.geometry.toolpath_rules import ToolpathError

FIT_TOLERANCE = 1e-8  # [m] a tenth of what drawings are promised to be read to
NM = 1e-9  # [m]


class DrawnPieces(NamedTuple):
    """Pieces in the order of the segments.

    Attributes:
        pieces: of the plane.
        owner: number of the segment that each piece is from.
        fit_error: measured, of the ellipses and curves [m].
    """

    pieces: Piece
    owner: Int[np.ndarray, " P"]
    fit_error: float


class _Group(NamedTuple):
    """Pieces of one kind; waves and rates are zero where there is none."""

    owner: np.ndarray
    polynomial: Float[np.ndarray, "P 6 2"]
    cosine: Float[np.ndarray, "P 2"]
    sine: Float[np.ndarray, "P 2"]
    rate: Float[np.ndarray, " P"]
    extent: Float[np.ndarray, " P"]


def drawn_pieces(segments: Sequence[Segment]) -> DrawnPieces:
    """Pieces of all segments; those too short to see have none.

    Arcs of circles stay arcs. Ellipses and curves become quintic pieces within `FIT_TOLERANCE`.

    Raises:
        ToolpathError: a curve is no curve, as an ellipse without an area.
    """
    lines, arcs, ellipses, curves = [], [], [], []
    for i, segment in enumerate(segments):
        if vanishes(segment):
            continue
        if isinstance(segment, Line):
            lines.append((i, segment))
        elif isinstance(segment, Curve):
            curves.append((i, segment))
        else:
            (arcs if segment.is_circular() else ellipses).append((i, segment))
    groups, error = [], 0.0
    if lines:
        groups.append(_lines(lines))
    if arcs:
        groups.append(_arcs(arcs))
    smooth: list[Ellipses | RationalCurves] = []
    if ellipses:
        smooth.append(Ellipses.of(ellipses))
    if curves:
        smooth.append(RationalCurves.of(curves))
    for kind in smooth:
        group, worst = _fitted(kind)
        groups.append(group)
        error = max(error, worst)
    if not groups:
        raise ToolpathError("nothing that is drawn has a length")
    whole = _Group(*(np.concatenate(rows) for rows in zip(*groups, strict=True)))
    order = np.argsort(whole.owner, kind="stable")
    owner, *rows, extent = (rows[order] for rows in whole)
    return DrawnPieces(Piece(*rows, np.zeros(extent.size), extent), owner, error)


def _lines(lines: list[tuple[int, Line]]) -> _Group:
    start = np.array([line.start for _, line in lines])
    delta = np.array([line.end for _, line in lines]) - start
    extent = np.abs(delta)
    polynomial = np.zeros((extent.size, 6, 2))
    polynomial[:, 0], polynomial[:, 1] = pairs(start), pairs(delta / extent)
    still = np.zeros((extent.size, 2))
    return _Group(_owners(lines), polynomial, still, still, 0 * extent, extent)


def _arcs(arcs: list[tuple[int, Arc]]) -> _Group:
    centre = np.array([arc.centre for _, arc in arcs])
    radial = np.array([arc.start for _, arc in arcs]) - centre
    sense = np.array([np.sign((a.first.conjugate() * a.second).imag) for _, a in arcs])
    angle = sense * np.array([arc.sweep for _, arc in arcs])
    extent = np.abs(radial) * np.abs(angle)
    polynomial = np.zeros((extent.size, 6, 2))
    polynomial[:, 0] = pairs(centre)
    sine = 1j * np.sign(angle) * radial
    return _Group(
        _owners(arcs), polynomial, pairs(radial), pairs(sine), np.abs(angle) / extent, extent
    )


def _fitted(smooth: Ellipses | RationalCurves) -> tuple[_Group, float]:
    begin = 2.0 * np.arange(smooth.owner.size)
    try:
        fit = fitted("drawing", smooth.jet, lambda t, frame: frame, begin, begin + 1, FIT_TOLERANCE)
    except ValueError:
        raise ToolpathError(
            f"a curve or an ellipse cannot be fitted within {FIT_TOLERANCE / NM:g} nm"
        ) from None
    owner = smooth.owner[(0.5 * fit.begin).astype(int)]
    *rows, _, extent = fit.pieces()
    return _Group(owner, *rows, extent), fit.error


def _owners(numbered: list) -> np.ndarray:
    return np.array([owner for owner, _ in numbered])
