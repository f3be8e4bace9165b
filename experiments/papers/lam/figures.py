"""The figures of Lam, drawn from the numbers of a run."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from experiments.papers.lam.claims import MPCC, MPTC, PI_FAST, PI_SLOW, curve
from experiments.reports.png import save_figures

COLOURS = {MPCC: "tab:blue", MPTC: "tab:green", PI_SLOW: "tab:orange", PI_FAST: "tab:red"}
TRACE_COLOURS = ("tab:blue", "tab:orange")
MAGNIFIED = 50.0  # contour error in Fig. 8, which else could not be seen


def draw(summary: dict[str, Any], folder: Path) -> list[Path]:
    """All figures, as PNG files in `folder`."""
    figures: dict[str, Callable[[dict[str, Any]], Figure]] = {
        "figure-8": contour,
        "figures-9-to-11": along_the_path,
        "figure-13": trade_off,
    }
    return save_figures(figures, summary, folder)


def contour(summary: dict[str, Any]) -> Figure:
    """Fig. 8: the path and the tool, the distance between them enlarged."""
    figure = Figure(figsize=(6.5, 6.5), layout="constrained")
    axes = figure.subplots()
    axes.plot(
        *np.array(summary["path"]["points_mm"]).T,
        color="0.3",
        linestyle="--",
        linewidth=0.8,
        label="path",
    )
    for colour, trace in zip(TRACE_COLOURS, summary["traces"], strict=True):
        tool, foot = np.array(trace["tool_mm"]), np.array(trace["foot_mm"])
        axes.plot(
            *(foot + MAGNIFIED * (tool - foot)).T,
            color=colour,
            linewidth=1.0,
            label=f"q_theta = {trace['q_theta']:g}",
        )
    axes.set(
        aspect="equal",
        xlabel="x [mm]",
        ylabel="y [mm]",
        title=f"Fig. 8: MPCC, contour error x {MAGNIFIED:g}, friction plant",
    )
    axes.legend(frameon=False, loc="upper right")
    return figure


def along_the_path(summary: dict[str, Any]) -> Figure:
    """Figs 9 to 11: currents, path speed and contour error over the path parameter."""
    figure = Figure(figsize=(8.0, 9.0), layout="constrained")
    rows = figure.subplots(4, 1, sharex=True)
    for colour, trace in zip(TRACE_COLOURS, summary["traces"], strict=True):
        control = np.array(trace["control_a"])
        curves = (control[:, 0], control[:, 1], trace["speed_mm_s"], trace["contour_error_um"])
        for axes, values in zip(rows, curves, strict=True):
            axes.plot(
                trace["theta_mm"],
                values,
                color=colour,
                linewidth=0.9,
                label=f"q_theta = {trace['q_theta']:g}",
            )
    labels = ("i_x [A]", "i_y [A]", "path speed [mm/s]", "contour error [um]")
    for axes, label in zip(rows, labels, strict=True):
        axes.set(ylabel=label)
        axes.grid(color="0.9")
        axes.margins(x=0.01)
    rows[0].set(title="Figs 9, 10, 11: MPCC on the friction plant")
    rows[0].legend(frameon=False, ncols=2)
    rows[-1].set(xlabel="path parameter theta [mm]")
    return figure


def trade_off(summary: dict[str, Any]) -> Figure:
    """Fig. 13: RMS contour error over traversal time, one panel for each plant."""
    plants = summary["plants"]
    figure = Figure(figsize=(4.2 * len(plants), 4.4), layout="constrained")
    for axes, plant in zip(
        np.atleast_1d(figure.subplots(1, len(plants), sharey=True)), plants, strict=True
    ):
        for controller, colour in COLOURS.items():
            axes.plot(
                *curve(summary, controller, plant),
                "o-",
                color=colour,
                markersize=4,
                linewidth=1.0,
                label=controller,
            )
        axes.set(xlabel="traversal time [s]", title=f"{plant} plant", yscale="log")
        axes.grid(color="0.9", which="both")
    figure.axes[0].set(ylabel="RMS contour error [% of the largest radius]")
    figure.axes[-1].legend(frameon=False)
    figure.suptitle("Fig. 13: accuracy against traversal time")
    return figure
