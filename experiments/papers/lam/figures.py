"""Figures of Lam, Manzie & Good, drawn from a result."""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from experiments.papers.lam.claims import CONTROLLERS, curve
from experiments.papers.lam.result import Result
from jcontour.app.reports.figures.axes import legend_below
from jcontour.app.reports.figures.png import save_figures

COLOURS = dict(zip(CONTROLLERS, ("tab:blue", "tab:green", "tab:orange", "tab:red"), strict=True))
TRACE_COLOURS = ("tab:blue", "tab:orange")
MAGNIFIED = 50.0  # contour error in Fig. 8, which else could not be seen


def draw(result: Result, folder: Path) -> list[Path]:
    """Save all figures as PNG files in `folder`."""
    figures = {
        "figure-8": contour,
        "figures-9-to-11": along_the_path,
        "figure-13": trade_off,
    }
    return save_figures(figures, result, folder)


def contour(result: Result) -> Figure:
    """Fig. 8: the path and the tool, the distance between them enlarged."""
    figure = Figure(figsize=(6.5, 6.5), layout="constrained")
    axes = figure.subplots()
    x, y = result.path.points_mm.T
    axes.plot(x, y, color="0.3", linestyle="--", linewidth=0.8, label="path")
    for colour, trace in zip(TRACE_COLOURS, result.traces, strict=True):
        x, y = (trace.foot_mm + MAGNIFIED * (trace.tool_mm - trace.foot_mm)).T
        axes.plot(x, y, color=colour, linewidth=1.0, label=f"q_theta = {trace.q_theta:g}")
    axes.set(
        aspect="equal",
        xlabel="x [mm]",
        ylabel="y [mm]",
        title=f"Fig. 8: MPCC, contour error x {MAGNIFIED:g}, friction plant",
    )
    axes.legend(frameon=False, loc="upper right")
    return figure


def along_the_path(result: Result) -> Figure:
    """Figs 9 to 11: currents, path speed and contour error over the path parameter."""
    figure = Figure(figsize=(8.0, 9.0), layout="constrained")
    rows = figure.subplots(4, 1, sharex=True)
    for colour, trace in zip(TRACE_COLOURS, result.traces, strict=True):
        label = f"q_theta = {trace.q_theta:g}"
        curves = (*trace.control_a.T, trace.speed_mm_s, trace.contour_error_um)
        for axes, values in zip(rows, curves, strict=True):
            axes.plot(trace.theta_mm, values, color=colour, linewidth=0.9, label=label)
    labels = ("i_x [A]", "i_y [A]", "path speed [mm/s]", "contour error [um]")
    for axes, label in zip(rows, labels, strict=True):
        axes.set(ylabel=label)
        axes.grid(color="0.9")
        axes.margins(x=0.01)
    figure.suptitle("Figs 9, 10, 11: MPCC on the friction plant")
    legend_below(figure, rows[0], columns=2)
    rows[-1].set(xlabel="path parameter theta [mm]")
    return figure


def trade_off(result: Result) -> Figure:
    """Fig. 13: RMS contour error over traversal time, one panel for each plant."""
    count = len(result.plants)
    figure = Figure(figsize=(max(5.5, 4.2 * count), 4.6), layout="constrained")
    panels = np.atleast_1d(figure.subplots(1, count, sharey=True))
    for axes, plant in zip(panels, result.plants, strict=True):
        for controller, colour in COLOURS.items():
            times, errors = curve(result, controller, plant)
            style = {"color": colour, "markersize": 4, "linewidth": 1.0, "label": controller}
            axes.plot(times, errors, "o-", **style)
        axes.set(xlabel="traversal time [s]", title=f"{plant} plant", yscale="log")
        axes.grid(color="0.9", which="both")
    panels[0].set(ylabel="RMS contour error [% of the largest radius]")
    legend_below(figure, panels[0], columns=4)
    figure.suptitle("Fig. 13: accuracy against traversal time")
    return figure
