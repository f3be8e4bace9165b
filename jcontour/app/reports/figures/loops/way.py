"""A contour with the way along it: where it begins, its direction, rapid moves."""

import numpy as np
from matplotlib.axes import Axes

from jcontour.app.reports.figures.loops.contour_runs import ContourRuns
from jcontour.app.reports.figures.shared.axes import DESIRED, OTHER

ARROWS = np.array([0.2, 0.5, 0.8])  # of the way: where arrows show its direction
ARROW = 0.005  # of the way: length of one,
LONGEST = 0.05  # and of the contour's size: it is straight, the way is not
ARROW_STYLE = {"arrowstyle": "-|>", "color": DESIRED}


def draw_way(axes: Axes, runs: ContourRuns) -> None:
    """The contour [mm] where it counts, its first point, its direction, and rapid moves."""
    desired = 1e3 * runs.shown(runs.reference)[:, :2]
    axes.plot(*desired.T, color=DESIRED, linewidth=0.8, linestyle="--", label="contour")
    place, counts = 1e3 * runs.reference[:, :2], runs.scored
    between = counts.copy()
    between[1:-1] &= counts[:-2] & counts[2:]  # up to the cuts on both sides
    if runs.rapids:
        beside = np.where(between[:, None], np.nan, place).T
        axes.plot(*beside, color=OTHER, linewidth=0.8, linestyle=":", label="rapid")
    axes.plot(*place[counts.argmax()], "o", color="black", markersize=3.5, label="first point")
    _draw_arrows(axes, place, np.flatnonzero(counts))


def _draw_arrows(axes: Axes, place: np.ndarray, cut: np.ndarray) -> None:
    """Arrows at `ARROWS` of the way along the samples `cut` of places (T, 2) [mm]."""
    begins = np.diff(cut, prepend=cut[0] - 2) > 1  # of every stretch without a rapid move
    steps = np.linalg.norm(np.diff(place[cut], axis=0, prepend=place[cut[:1]]), axis=1)
    way = np.cumsum(np.where(begins, 0.0, steps))
    length = min(ARROW * way[-1], LONGEST * float(np.ptp(place[cut], axis=0).max()))
    tips = np.searchsorted(way, way[-1] * ARROWS)
    tails = np.searchsorted(way, way[tips] - length, side="right") - 1
    tails = np.maximum(tails, np.maximum.accumulate(np.where(begins, np.arange(cut.size), 0))[tips])
    for tail, tip in zip(cut[tails], cut[tips], strict=True):
        axes.annotate("", tuple(place[tip]), tuple(place[tail]), arrowprops=ARROW_STYLE)
