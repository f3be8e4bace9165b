"""The tool of a run beside its contour, its contour error drawn larger than it is."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes

from jcontour.app.reports.figures.loops.contour_runs import ContourRuns, DrawnRun

MAGNIFIED = 0.06  # of the contour's size: how large the largest error is drawn
ROUNDING = 1e-12  # of the largest coordinate: an error below it is none
TRUE = "error true to scale"


def draw_magnified(
    axes: Axes, runs: ContourRuns, run: DrawnRun, row: Sequence[DrawnRun], colour: str
) -> str:
    """Draw the tool; the magnification in words, the same for all runs of a row."""
    factor = _magnification(runs, row)
    tool = desired_on_contour(runs, run) + factor * 1e3 * runs.shown(run.contour_error)[:, :2]
    axes.plot(*tool.T, color=colour, linewidth=1.0, label=run.label)
    return TRUE if factor == 1 else f"error x {factor:g}"


def _magnification(runs: ContourRuns, compared: Sequence[DrawnRun]) -> float:
    """The one at which every one of these runs stays near the contour."""
    desired = runs.shown(runs.reference)[:, :2]
    errors = [runs.shown(run.contour_error)[:, :2] for run in compared if not run.diverged]
    return min((magnification(desired, error) for error in errors), default=1.0)


def desired_on_contour(runs: ContourRuns, run: DrawnRun) -> np.ndarray:
    """Nearest points of the contour to the tool [mm], in the plane (T, 2)."""
    return 1e3 * runs.shown(run.output - run.contour_error)[:, :2]


def magnification(desired: np.ndarray, error: np.ndarray) -> float:
    """1, 2, 5, 10, ...: the largest error becomes about `MAGNIFIED` of the contour's size."""
    size = float(np.nanmax(np.nanmax(desired, axis=0) - np.nanmin(desired, axis=0)))
    finite = np.abs(error[np.isfinite(error)])
    largest = float(finite.max()) if finite.size else 0.0
    if not ROUNDING * float(np.nanmax(np.abs(desired))) < largest < size:
        return 1.0
    factor = MAGNIFIED * size / largest
    if factor < 1:
        return 1.0
    decade = 10 ** np.floor(np.log10(factor))
    return float(decade * max(step for step in (1, 2, 5) if step <= factor / decade))
