"""Figures of Yuan's contouring controllers, drawn from a result."""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from experiments.papers.yuan_contouring_bounded.result import LoopRow, Result
from experiments.papers.yuan_gantry.runs import SAMPLE
from jcontour.app.reports.figures.axes import CYCLE, OTHER, grid, legend_below
from jcontour.app.reports.figures.png import save_figures

COLUMNS = 2


def draw(result: Result, folder: Path) -> list[Path]:
    """Save all figures as PNG files in `folder`."""
    return save_figures({"figures-5-14-and-5-16": errors}, result, folder)


def errors(result: Result) -> Figure:
    """Contour error along Fig. 5.11, below what is promised."""
    lines = -(-len(result.loops) // COLUMNS)
    figure = Figure(figsize=(9.0, 0.8 + 2.2 * lines), layout="constrained")
    panels = figure.subplots(lines, COLUMNS, squeeze=False).ravel()
    for axes, row in zip(panels, result.loops, strict=False):
        _panel(axes, row)
    for axes in panels[len(result.loops) :]:
        axes.remove()
    figure.suptitle("Figs 5.14 and 5.16: contour error under disturbances")
    legend_below(figure)
    return figure


def _panel(axes, row: LoopRow) -> None:
    time = SAMPLE * np.arange(len(row.contour_error_um))
    axes.plot(time, row.contour_error_um, color=CYCLE[0], linewidth=0.6, label="contour error")
    axes.axhline(row.promised_um, color=OTHER, linestyle="--", label="promised")
    grid(axes, f"{row.label}; {row.place}", "time [s]", "error [um]")
