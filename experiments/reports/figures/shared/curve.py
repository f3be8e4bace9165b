"""Curves that may have more points than a picture has dots."""

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes

MOST = 20_000  # points that are drawn one by one
COLUMNS = 400  # of a curve with more
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

    A long curve is drawn as its mean over x, and a band from the least to the most around it: no
    peak is lost, and a block of one colour tells nothing.
    """
    if not long(x.size):
        axes.plot(x, y, color=colour, linewidth=width, label=label)
        return
    first = np.linspace(0, x.size, COLUMNS, endpoint=False).astype(int)
    middle = 0.5 * (x[first] + x[np.append(first[1:], x.size) - 1])
    low, high = np.fmin.reduceat(y, first), np.fmax.reduceat(y, first)
    weight = np.where(np.isfinite(y), np.gradient(x), 0.0)
    with np.errstate(invalid="ignore"):  # nothing is drawn in a column without a value
        mean = np.add.reduceat(weight * np.nan_to_num(y), first) / np.add.reduceat(weight, first)
    axes.fill_between(middle, low, high, color=colour, alpha=LIGHT, linewidth=0)
    axes.plot(middle, mean, color=colour, linewidth=width, label=label)
