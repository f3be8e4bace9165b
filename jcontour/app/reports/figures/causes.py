"""Figure of a measured error and its causes over time."""

from collections.abc import Sequence

from matplotlib.figure import Figure

from jcontour.app.files.results.loop_results import CauseShare
from jcontour.app.reports.figures.axes import CYCLE, DESIRED, draw_curve, grid, short
from jcontour.app.reports.figures.contours import ContourRuns
from tuning.identification.error_causes import Shares

SHOWN = 4  # causes, the largest


def causes_figure(runs: ContourRuns, found: Shares, causes: Sequence[CauseShare]) -> Figure:
    """The error, below it the part that each of the largest causes has, and what is unexplained."""
    rows = [*range(min(SHOWN, len(causes) - 1)), len(causes) - 1]
    figure = Figure(figsize=(9.0, 2.0 + 1.5 * len(rows)), layout="constrained")
    above, *panels = figure.subplots(1 + len(rows), 1, sharex=True)
    draw_curve(above, runs.time, runs.shown(1e6 * found.along.sum(axis=0)), DESIRED, 0.8, "error")
    grid(above, f"{short(runs.name)}: measured error and its causes", "", "error [um]")
    for row, axes, colour in zip(rows, panels, CYCLE, strict=False):
        part = runs.shown(1e6 * found.along[row])
        draw_curve(axes, runs.time, part, colour, 0.8, causes[row].text)
        grid(axes, causes[row].text, "", "um")
    panels[-1].set_xlabel("time [s]")
    return figure
