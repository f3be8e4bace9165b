"""Figures of Smith & Lee, drawn from a result."""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from experiments.papers.zpetc.result import Result
from experiments.papers.zpetc.runs import FAST
from experiments.reports.axes import grid, legend_below
from experiments.reports.png import save_figures
from jcontour.plants.three_link import PATH_DURATION


def draw(result: Result, folder: Path) -> list[Path]:
    """Save all figures as PNG files in `folder`."""
    figures = {
        "figure-7": figure_7,
        "errors": errors,
        "integral-time": integral_time,
        "gain-error": gain_error,
    }
    return save_figures(figures, result, folder)


def figure_7(result: Result) -> Figure:
    """Legs of the manipulator along the path."""
    figure = Figure(figsize=(6.4, 3.6), layout="constrained")
    axes = figure.subplots()
    time = FAST * np.arange(len(result.path_mm))
    for leg in range(result.path_mm.shape[1]):
        axes.plot(time, result.path_mm[:, leg], label=f"link {leg}")
    grid(axes, "Fig. 7: desired length from the start, on a path of ours", "time [s]", "[mm]")
    legend_below(figure, axes)
    return figure


def errors(result: Result) -> Figure:
    """Errors over time, Figs 8 and 9 and the adaptive run."""
    figure = Figure(figsize=(6.4, 1.9 * len(result.errors_um)), layout="constrained")
    panels = np.atleast_1d(figure.subplots(len(result.errors_um), 1, sharex=True))
    for axes, (name, error) in zip(panels, result.errors_um.items(), strict=True):
        axes.plot(np.linspace(0, PATH_DURATION, error.size), error, linewidth=0.8)
        grid(axes, name, y="error [um]")
    panels[-1].set(xlabel="time [s]")
    return figure


def integral_time(result: Result) -> Figure:
    """Mean error over the integral time."""
    figure = Figure(figsize=(6.4, 4.0), layout="constrained")
    axes = figure.subplots()
    for truth in dict.fromkeys(row.truth for row in result.integral):
        rows = [row for row in result.integral if row.truth == truth and row.integral_time]
        times = [row.integral_time for row in rows]
        axes.loglog(times, [row.mean_um for row in rows], "o-", label=truth)
    grid(axes, "Zero phase tracking with an integrator", "integral time [s]", "mean error [um]")
    legend_below(figure, axes, columns=2)
    return figure


def gain_error(result: Result) -> Figure:
    """Gain that zero phase tracking leaves."""
    figure = Figure(figsize=(6.4, 3.6), layout="constrained")
    axes = figure.subplots()
    axes.loglog(result.gain_error.hertz, 100 * np.abs(result.gain_error.error))
    grid(axes, "Gain error, no phase error", "frequency [Hz]", "gain error [%]")
    return figure
