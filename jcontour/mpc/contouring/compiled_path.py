"""A contour for a controller on the host: position and derivative at a path parameter.

Compiled, without allocation. The pieces are the contour's own (`jcontour.geometry.pieces`), waves
included, in a chosen unit of length: nothing is fitted anew.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from jcontour._compiled import compiled
from jcontour.geometry.contour import Contour


class Path(NamedTuple):
    """Pieces of a path in one unit of length, s from the start of each.

    p(s) = sum_i polynomial[i] s^i + cosine cos(rate s) + sine sin(rate s); `waves` holds cosine and
    sine.
    """

    polynomial: Float[np.ndarray, "P 6 m"]
    waves: Float[np.ndarray, "P 2 m"]
    rate: Float[np.ndarray, " P"]
    start: Float[np.ndarray, " P+1"]

    @property
    def length(self) -> float:
        """Largest path parameter."""
        return float(self.start[-1])

    @property
    def axes(self) -> int:
        """Number of axes m."""
        return self.polynomial.shape[-1]

    def at(self, arc: float) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, " m"]]:
        """Position and its derivative at a path parameter, which ends where the path does."""
        position, slope = np.empty(self.axes), np.empty(self.axes)
        path_at(*self, min(max(arc, 0.0), self.length), position, slope)
        return position, slope


def path_of(contour: Contour, unit: float) -> Path:
    """The path of one contour in units of `unit` [m].

    Raises:
        ValueError: the unit is not above zero, or the contour is a stack or has no length.
    """
    if not (np.isfinite(unit) and unit > 0):
        raise ValueError(f"length_unit: needs to be above zero, received {unit}")
    mask = np.asarray(contour.mask)
    if mask.ndim != 1:
        raise ValueError(
            f"contour: needs a single contour, received a stack of shape {mask.shape[:-1]}"
        )
    polynomial, cosine, sine, rate, _, extent = (
        np.asarray(rows, float)[mask] for rows in contour.pieces
    )
    if not (extent.size and extent.sum() > 0):
        raise ValueError("contour: a path needs a length above zero, received zero")
    powers = unit ** (np.arange(polynomial.shape[1]) - 1.0)
    start = np.append(0.0, np.cumsum(extent / unit))
    return Path(
        polynomial * powers[:, None], np.stack([cosine, sine], axis=1) / unit, rate * unit, start
    )


@compiled
def path_at(polynomial, waves, rate, start, arc, position, slope) -> None:
    """Write p(arc) and dp/darc, of the piece that begins at or before `arc`.

    The last piece goes on beyond the end.
    """
    low, high = 0, rate.size - 1
    while low < high:
        middle = (low + high + 1) // 2
        if start[middle] <= arc:
            low = middle
        else:
            high = middle - 1
    s, m = arc - start[low], polynomial.shape[2]
    for a in range(m):
        value, change = 0.0, 0.0
        for i in range(polynomial.shape[1] - 1, -1, -1):
            change = change * s + value
            value = value * s + polynomial[low, i, a]
        position[a], slope[a] = value, change
    if rate[low] != 0:
        cos, sin = np.cos(rate[low] * s), np.sin(rate[low] * s)
        for a in range(m):
            cosine, sine = waves[low, 0, a], waves[low, 1, a]
            position[a] += cosine * cos + sine * sin
            slope[a] += rate[low] * (sine * cos - cosine * sin)
