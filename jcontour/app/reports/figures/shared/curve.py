"""Curves that may have more points than a picture has dots."""

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes

MOST = 20_000  # points that are drawn one by one
COLUMNS = 600  # of a curve with more
LIGHT = 0.35  # opacity of its band
WORDS = "light: from least to most, line: mean"


def long(points: int) -> bool:
    """Whether so many points become a band."""
    return points > MOST


def draw_curve(
    axes: Axes,
    x: Float[np.ndarray, " T"],
    y: Float[np.ndarray, " T"],
    colour: str,
    width: float,
    label: str,
) -> None:
    """Draw y over x, which rises; where y is NaN there is a gap.

    A long curve is drawn in columns of one width on the x axis: its mean over x, and a band from
    the least to the most around it. No peak is lost, and a block of one colour tells nothing.
    """
    if not long(x.size):
        axes.plot(x, y, color=colour, linewidth=width, label=label)
        return
    edges = np.linspace(x[0], x[-1], COLUMNS + 1)
    low, high, mean = (np.repeat(rows, 2) for rows in _columns(x, y, edges))
    sides = np.repeat(edges, 2)[1:-1]
    axes.fill_between(sides, low, high, color=colour, alpha=LIGHT, linewidth=0)
    axes.plot(sides, mean, color=colour, linewidth=width, label=label)


def _columns(
    x: Float[np.ndarray, " T"], y: Float[np.ndarray, " T"], edges: Float[np.ndarray, " edges"]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Least, most and mean over x of y between neighbouring edges; NaN where there is nothing."""
    begins = edges[:-1]  # with a point at each, no column is empty
    place = np.append(begins, x)
    order = np.argsort(place, kind="stable")
    value = np.append(np.interp(begins, x, y), y)[order]
    first = np.searchsorted(place[order], begins)
    low, high = np.fmin.reduceat(value, first), np.fmax.reduceat(value, first)
    middle = 0.5 * (y[1:] + y[:-1])
    there = np.where(np.isfinite(middle), np.diff(x), 0.0)
    area, length = (
        np.diff(np.interp(edges, x, np.append(0.0, np.cumsum(part))))
        for part in (there * np.nan_to_num(middle), there)
    )
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.where(np.isfinite(high), area / length, np.nan)
    return low, high, np.clip(mean, low, high)  # a difference of sums is rounded
