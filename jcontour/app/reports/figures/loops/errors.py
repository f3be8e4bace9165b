"""Figure of the errors of runs along one contour over time."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from jcontour.app.reports.figures.loops.contour_runs import ContourRuns, DrawnRun
from jcontour.app.reports.figures.shared.axes import DESIRED, colours_of, grid, short
from jcontour.app.reports.figures.shared.curve import WORDS, draw_curve, long


def error_figure(runs: ContourRuns) -> Figure:
    """Contour error (of a single axis: its tool), tracking error and control increment over time.

    Every row of runs has a column of its own.
    """
    width = len(runs.rows)
    figure = Figure(figsize=(1.5 + 6.0 * width, 7.0), layout="constrained")
    columns = figure.subplots(3, width, sharex=True, squeeze=False).T
    for column, row in zip(columns, runs.rows, strict=True):
        _draw_errors(column, runs, row)
    left_out = ", without rapid moves" if runs.rapids else ""
    words = f" ({WORDS})" if long(runs.time.size) else ""
    figure.suptitle(f"{short(runs.name)}: scored samples{left_out}{words}")
    return figure


def _draw_errors(column: Sequence[Axes], runs: ContourRuns, row: Sequence[DrawnRun]) -> None:
    alone = len(runs.axes) == 1
    first = "tool [mm]" if alone else "contour error [um]"
    labels = (first, "tracking error [um]", f"increment [{runs.control_unit}]")
    colours = colours_of([run.label for run in row])
    for run in row:
        legend = f"{run.label}, {run.plant}{', diverged' if run.diverged else ''}"
        for axes, signal in zip(column, _errors(runs, run, alone), strict=True):
            draw_curve(axes, runs.time, runs.shown(signal), colours[run.label], 0.8, legend)
    if alone:
        desired = 1e3 * runs.shown(runs.reference)[:, 0]
        column[0].plot(runs.time, desired, color=DESIRED, linewidth=0.8, linestyle="--")
    for axes, label in zip(column, labels, strict=True):
        grid(axes, y=label)
    used = runs.time[runs.scored]
    column[-1].set(xlabel="time [s]", xlim=(used[0], used[-1]))
    column[0].legend(frameon=False, loc="lower left", bbox_to_anchor=(0.0, 1.0))


def _errors(runs: ContourRuns, run: DrawnRun, alone: bool) -> tuple[np.ndarray, ...]:
    """Signals drawn over time: contour error or tool, tracking error, increment."""
    contour = 1e6 * np.linalg.norm(run.contour_error, axis=-1)
    tracking = 1e6 * np.linalg.norm(run.output - runs.reference, axis=-1)
    increment = np.linalg.norm(np.diff(run.control, axis=0), axis=-1)
    return 1e3 * run.output[:, 0] if alone else contour, tracking, np.append(increment, np.nan)
