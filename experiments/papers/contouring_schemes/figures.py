"""Figures of the comparison of contouring schemes, drawn from a result."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.papers.contouring_schemes.result import Result
from jcontour.app.reports.figures.axes import legend_below
from jcontour.app.reports.figures.png import save_figures

BARS = 0.8  # of the distance between two schemes


def draw(result: Result, folder: Path) -> list[Path]:
    """Save all figures as PNG files in `folder`."""
    return save_figures({"held-out-errors": errors, "tuning": tuning}, result, folder)


def errors(result: Result) -> Figure:
    """RMS contour error on held-out contours: every scheme on every machine."""
    figure, panels = _panels(result)
    for loops, axes in panels.items():
        _bars(axes, result, loops)
    legend_below(figure, figure.axes[0], columns=2 * len(panels))
    figure.axes[0].set(ylabel="RMS contour error [um]")
    figure.suptitle("Held-out contours, machine with stick and slip")
    return figure


def tuning(result: Result) -> Figure:
    """Best feasible objective over the evaluations.

    First those of the cascade, then every scheme from there, then from the start again.
    """
    figure, panels = _panels(result)
    for row in result.tuning:
        count = np.arange(1, len(row.best_um) + 1)
        panels[row.loops].plot(count, row.best_um, label=row.scheme, linewidth=1.0)
    for loops, axes in panels.items():
        axes.set(xlabel="evaluations", yscale="log", title=loops)
        axes.grid(color="0.9", which="both")
    figure.axes[0].set(ylabel="mean RMS contour error [um]")
    legend_below(figure, figure.axes[0], columns=2 * len(panels))
    figure.suptitle("Tuning on the smooth twin")
    return figure


def _bars(axes: Axes, result: Result, loops: str) -> None:
    """A group for each scheme, in it a bar for each machine."""
    schemes, plants = result.schemes, result.plants
    width = BARS / len(plants)
    for k, plant in enumerate(plants):
        heights = [result.mean(scheme, loops, plant, training=False) for scheme in schemes]
        place = np.arange(len(schemes)) + (k - (len(plants) - 1) / 2) * width
        axes.bar(place, heights, width, label=plant)
    axes.set_xticks(np.arange(len(schemes)), schemes, rotation=25, ha="right")
    axes.set(title=loops)
    axes.grid(color="0.9", axis="y")
    axes.set_axisbelow(True)


def _panels(result: Result) -> tuple[Figure, dict[str, Axes]]:
    """One panel for each kind of loops."""
    loops = result.loops
    figure = Figure(figsize=(6.0 * len(loops), 4.8), layout="constrained")
    panels = np.atleast_1d(figure.subplots(1, len(loops), sharey=True))
    return figure, dict(zip(loops, panels, strict=True))
