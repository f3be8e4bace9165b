"""Figures of Yuan's chapter 4, drawn from a result."""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from experiments.papers.yuan_bounded.result import LoopRow, Result
from experiments.papers.yuan_bounded.runs import DT
from jcontour.app.reports.figures.axes import CYCLE, OTHER, grid, legend_below
from jcontour.app.reports.figures.png import save_figures


def draw(result: Result, folder: Path) -> list[Path]:
    """Save all figures as PNG files in `folder`."""
    return save_figures({"figure-4-2": errors}, result, folder)


def errors(result: Result) -> Figure:
    """Tracking error under the disturbances, between the promised bounds."""
    figure = Figure(figsize=(9.0, 3.6), layout="constrained")
    panels = np.atleast_1d(figure.subplots(1, len(result.loops)))
    for axes, row in zip(panels, result.loops, strict=True):
        _panel(axes, row)
    figure.suptitle("Bounded MPC: slow, random and worst disturbances, a third of the run each")
    legend_below(figure)
    return figure


def _panel(axes, row: LoopRow) -> None:
    axes.plot(DT * np.arange(row.samples), row.error_mm, color=CYCLE[0], label="tracking error")
    for sign in (-1, 1):
        axes.axhline(sign * row.promised_mm, color=OTHER, linestyle="--", label="promised")
    grid(axes, f"reference {row.reference}", "time [s]", "error [mm]")
