"""The tool of a run where it went, coloured by its contour error.

Contours with many details, as letters or pockets, have no room for a magnified error. Nor have
passes side by side.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Int
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection

from jcontour.app.reports.figures.loops.contour_runs import ContourRuns, DrawnRun

DETAILED = 0.35  # mean diameter of the curves, of the contour's size: below it there are many
CROWDED = 10.0  # length, of the contour's size: beyond it passes lie side by side
STANDSTILL = 1e-9  # m in a sample: no direction below it
MOST = 20_000  # pieces of a colour, beside those that end where a rapid move begins or ends
COLOURS = "viridis_r"  # dark where the error is large


def detailed(runs: ContourRuns) -> bool:
    """Whether passes lie side by side, or curves are tight: the length over the angle turned.

    That is the mean radius of the curves.
    """
    place = runs.reference[:, :2]
    step = np.diff(place, axis=0)[runs.scored[1:] & runs.scored[:-1]]
    length = np.linalg.norm(step, axis=1)
    step, length = step[length > STANDSTILL], length[length > STANDSTILL]
    heading = np.unwrap(np.arctan2(step[:, 1], step[:, 0]))
    turned = np.abs(np.diff(heading)).sum()
    size, whole = np.ptp(place[runs.scored], axis=0).max(), length.sum()
    return bool(whole > CROWDED * size or 2 * whole < DETAILED * size * turned)


def draw_coloured(
    axes: Axes, runs: ContourRuns, run: DrawnRun, row: Sequence[DrawnRun], colour: str
) -> str:
    """Draw the tool; the largest error in words, ringed in `colour`. A row has one scale."""
    place, error = 1e3 * runs.shown(run.output)[:, :2], _error(runs, run)
    starts = _starts(runs.scored)
    place, largest = place[starts], np.fmax.reduceat(error, starts)
    pieces = np.stack([place[:-1], place[1:]], axis=1)
    drawn = np.isfinite(pieces).all(axis=(1, 2))
    order = np.argsort(largest[:-1][drawn])  # large errors lie on top
    top = max(np.nanmax(_error(runs, one)) for one in row if not one.diverged)
    lines = LineCollection(
        list(pieces[drawn][order]),
        array=largest[:-1][drawn][order],
        cmap=COLOURS,
        clim=(0.0, top),
        linewidths=1.2,
        capstyle="round",
    )
    axes.add_collection(lines)
    axes.figure.colorbar(lines, ax=axes, label="error [um]")
    worst = int(np.nanargmax(error))
    ring = {"markersize": 9, "mfc": "none", "mec": colour, "linestyle": "none"}
    axes.plot(*1e3 * run.output[worst, :2], "o", label=f"largest, {run.label}", **ring)
    return f"largest error {error[worst]:.3g} um"


def _starts(scored: Bool[np.ndarray, " T"]) -> Int[np.ndarray, " K"]:
    """Samples where pieces begin: at equal distances, and on both sides of every border of a cut.

    A piece over a border would lose the end of a cut, or draw a short rapid move as one.
    """
    count = len(scored)
    before = np.flatnonzero(np.diff(scored))
    even = np.arange(0, count, -(-count // MOST))
    return np.unique(np.concatenate([even, before, before + 1, [count - 1]]))


def _error(runs: ContourRuns, run: DrawnRun) -> np.ndarray:
    """Contour error (T,) [um]; NaN where samples do not count."""
    return 1e6 * np.linalg.norm(runs.shown(run.contour_error), axis=-1)
