"""Pieces of a contour from the segments of a drawing: lines and arcs as they are, others fitted.

Many smooth curves are one function for the fit of quintic pieces: curve j has the parameters 2 j to
2 j + 1. Each is therefore seen from its own side at both ends, where the curvature may jump to that
of the next one.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Complex, Float, Int

from jcontour.geometry.drawings.segments import Arc, Curve, Line, Segment, vanishes
from jcontour.geometry.pieces import Piece
from jcontour.geometry.quintics import fitted
from jcontour.geometry.toolpath_rules import ToolpathError

SEARCH = 33  # points of a curve at which a cusp is looked for
SLOW = 0.05  # of the mean speed: where a curve may have a cusp
CUSP = 1e-5  # of the mean speed: it has one, and is cut there
ZOOMS = 12  # of the search for the slowest point, each eight times as fine
QUARTER = 0.5 * np.pi

Jet = tuple[np.ndarray, np.ndarray, np.ndarray]  # position, first and second derivative (..., 2)
FIT_TOLERANCE = 1e-8  # [m] a tenth of what drawings are promised to be read to
NM = 1e-9  # [m]


class Ellipses(NamedTuple):
    """Parts of ellipses of a quarter of a turn at most."""

    owner: Int[np.ndarray, " n"]
    centre: Complex[np.ndarray, " n"]
    first: Complex[np.ndarray, " n"]
    second: Complex[np.ndarray, " n"]
    begin: Float[np.ndarray, " n"]
    sweep: Float[np.ndarray, " n"]

    @classmethod
    def of(cls, arcs: list[tuple[int, Arc]]) -> "Ellipses":
        """Arcs with the number of their segment, cut into quarters of a turn."""
        rows = []
        for owner, arc in arcs:
            count = max(1, int(np.ceil(abs(arc.sweep) / QUARTER - 1e-9)))
            step = arc.sweep / count
            rows += [
                (owner, arc.centre, arc.first, arc.second, arc.begin + i * step, step)
                for i in range(count)
            ]
        return cls(*map(np.array, zip(*rows, strict=True)))

    def jet(self, t: np.ndarray) -> Jet:
        """Points and derivatives."""
        j, u = _place(t, self.owner.size)
        sweep = self.sweep[j]
        angle = self.begin[j] + u * sweep
        cos, sin = np.cos(angle), np.sin(angle)
        wave = self.first[j] * cos + self.second[j] * sin
        slope = self.second[j] * cos - self.first[j] * sin
        return pairs(self.centre[j] + wave), pairs(sweep * slope), pairs(-(sweep**2) * wave)


class RationalCurves(NamedTuple):
    """Parts of rational curves, without a cusp inside."""

    owner: Int[np.ndarray, " n"]  # number of the segment that each is from
    top: Complex[np.ndarray, "n d"]  # coefficients of the numerator
    bottom: Float[np.ndarray, "n d"]  # coefficients of the denominator
    begin: Float[np.ndarray, " n"]  # parameter at which the part begins, of 0 to 1
    width: Float[np.ndarray, " n"]  # range of the parameter
    # whether the curve stands still at its beginning, and at its end
    stands: Bool[np.ndarray, "n 2"]

    @classmethod
    def of(cls, curves: list[tuple[int, Curve]]) -> "RationalCurves":
        """Curves with the number of their segment, cut at their cusps."""
        terms = max(len(curve.top) for _, curve in curves)
        owner = np.array([owner for owner, _ in curves])
        top = np.array([_padded(curve.top, terms) for _, curve in curves])
        bottom = np.array([_padded(curve.bottom, terms) for _, curve in curves])
        whole = np.ones(owner.size)
        still = np.zeros((owner.size, 2), bool)
        return cls(owner, top, bottom, 0 * whole, whole, still)._cut_at_cusps()

    def jet(self, t: np.ndarray) -> Jet:
        """Points and derivatives.

        Where a curve stands still at an end it has the direction of its second derivative there,
        and no curvature.
        """
        j, u = _place(t, self.owner.size)
        point, first, second, third = self._derivatives(j, self.begin[j] + u * self.width[j])
        ahead, behind = (u == 0) & self.stands[j, 0], (u == 1) & self.stands[j, 1]
        still = ahead | behind
        # of a curve whose second derivative is zero as well, the third one leads on
        straight = np.abs(second) <= CUSP * np.abs(third)
        along = np.where(straight, third, np.where(behind, -second, second))
        first, second = np.where(still, along, first), np.where(still, 0.0, second)
        width = self.width[j]
        return pairs(point), pairs(width * first), pairs(width**2 * second)

    def _derivatives(self, j, u):
        """Point and three derivatives with respect to the whole curve's parameter."""
        top, bottom = _taylor(self.top[j], u), _taylor(self.bottom[j], u)
        point = top[0] / bottom[0]
        first = (top[1] - point * bottom[1]) / bottom[0]
        second = (top[2] - 2 * first * bottom[1] - point * bottom[2]) / bottom[0]
        third = top[3] - 3 * second * bottom[1] - 3 * first * bottom[2] - point * bottom[3]
        return point, first, second, third / bottom[0]

    def _cut_at_cusps(self) -> "RationalCurves":
        """Each curve in its parts between points where it stands still."""
        with np.errstate(all="ignore"):
            every = np.arange(self.owner.size)[:, None]
            grid = np.linspace(0.0, 1.0, SEARCH)
            speed = np.abs(self._derivatives(every, grid)[1])
            mean = speed.mean(axis=1)
            # Where a row is not above its neighbours
            around = np.pad(speed, ((0, 0), (1, 1)), constant_values=np.inf)
            slow = (speed <= SLOW * mean[:, None]) & (
                (speed <= around[:, :-2]) & (speed <= around[:, 2:])
            )
            cusps: dict[int, list[float]] = {}
            for j, i in zip(*np.nonzero(slow), strict=True):
                low, high = grid[max(i - 1, 0)], grid[min(i + 1, SEARCH - 1)]
                slowest = self._slowest(int(j), float(low), float(high))
                if np.abs(self._derivatives(j, slowest)[1]) <= CUSP * mean[j]:
                    cusps.setdefault(int(j), []).append(float(slowest))
        if not cusps:
            return self
        parts = []
        for j in range(self.owner.size):
            stops = cusps.get(j, [])
            knots = [0.0, *sorted(t for t in stops if CUSP < t < 1 - CUSP), 1.0]
            still = [min(map(abs, (t - k for t in stops)), default=1.0) <= CUSP for k in knots]
            for i in range(len(knots) - 1):
                parts.append((j, knots[i], knots[i + 1] - knots[i], (still[i], still[i + 1])))
        index, begin, width, stands = map(np.array, zip(*parts, strict=True))
        return RationalCurves(
            self.owner[index], self.top[index], self.bottom[index], begin, width, stands
        )

    def _slowest(self, j: int, low: float, high: float) -> float:
        """Parameter of the least speed between two."""
        best = low
        for _ in range(ZOOMS):
            grid = np.linspace(low, high, 17)
            best = grid[np.argmin(np.abs(self._derivatives(j, grid)[1]))]
            step = grid[1] - grid[0]
            low, high = max(best - step, low), min(best + step, high)
        return float(best)


def _place(t: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Number of the curve, and its own parameter from 0 to 1."""
    j = np.clip((0.5 * t).astype(int), 0, count - 1)
    return j, t - 2 * j


def pairs(points: np.ndarray) -> np.ndarray:
    """Coordinates (..., 2) of points of the plane."""
    return np.stack([np.real(points), np.imag(points)], axis=-1)


def _padded(coefficients: tuple, terms: int) -> list:
    return [*coefficients, *[0.0] * (terms - len(coefficients))]


def _taylor(coefficients: np.ndarray, u: np.ndarray | float) -> list:
    """Polynomial and its three derivatives by Horner's rule."""
    value: list = [0.0 * u] * 4
    for i in reversed(range(coefficients.shape[-1])):
        for k in (3, 2, 1):
            value[k] = value[k] * u + value[k - 1]
        value[0] = value[0] * u + coefficients[..., i]
    return [value[0], value[1], 2 * value[2], 6 * value[3]]


class DrawnPieces(NamedTuple):
    """Pieces in the order of the segments."""

    pieces: Piece  # of the plane
    owner: Int[np.ndarray, " P"]  # number of the segment that each piece is from
    fit_error: float  # measured, of the ellipses and curves [m]


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
