"""Figures of Yuan's chapter 3, drawn from a result."""

from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from experiments.papers.yuan_tracking.result import KEPT_PERIOD, Result, Signals
from jcontour.app.reports.figures.axes import legend_below
from jcontour.app.reports.figures.png import save_figures

LABELS = {"cascade": "PI", "cascade-notch": "PI with filter", "cascade-leso-exact": "PI with LESO"}
# the first two are nearly the same: the wide line shows beneath the narrow one
STYLES = {
    "cascade": {"color": "tab:blue", "linewidth": 2.6, "alpha": 0.5},
    "cascade-notch": {"color": "tab:orange", "linewidth": 0.9},
    "cascade-leso-exact": {"color": "tab:green", "linewidth": 0.9},
}
SIDES = {"motor": "(a) motor", "tool": "(b) end effector"}
TASK_COLOURS = {"A": "tab:blue", "B": "tab:orange"}


def draw(result: Result, folder: Path) -> list[Path]:
    """Save all figures as PNG files in `folder`."""
    figures = {
        "figure-3-8": partial(positions, task="A", number="3.8"),
        "figure-3-9": partial(errors, task="A", number="3.9"),
        "figure-3-10": partial(positions, task="B", number="3.10"),
        "figure-3-11": partial(errors, task="B", number="3.11"),
        "ranking": ranking,
        "smooth-twin": twin,
    }
    return save_figures(figures, result, folder)


def positions(result: Result, task: str, number: str) -> Figure:
    """Figs 3.8 and 3.10: motor and end effector beside the reference."""
    figure = _over_time(result, task, "position [mm]", getattr)
    wanted = 1e3 * next(iter(result.signals.values()))[task].wanted
    time = KEPT_PERIOD * np.arange(wanted.size)
    for axes in figure.axes:
        axes.plot(time, wanted, color="0.3", linewidth=0.8, linestyle="--", label="reference")
    legend_below(figure, figure.axes[0], columns=4)
    figure.suptitle(f"Fig. {number}: position, task {task}")
    return figure


def errors(result: Result, task: str, number: str) -> Figure:
    """Figs 3.9 and 3.11: tracking errors of motor and end effector."""

    def error(signals: Signals, side: str) -> Float[np.ndarray, " T"]:
        return signals.wanted - getattr(signals, side)

    figure = _over_time(result, task, "error [mm]", error)
    legend_below(figure, figure.axes[0], columns=3)
    figure.suptitle(f"Fig. {number}: tracking error, task {task}")
    return figure


def ranking(result: Result) -> Figure:
    """Mean error of the end effector of every controller, as it starts and tuned."""
    rows = sorted(result.ranking, key=lambda row: row.error, reverse=True)
    figure = Figure(figsize=(8.0, 0.3 * len(rows) + 1.8), layout="constrained")
    axes, place = figure.subplots(), np.arange(len(rows))
    for shift, (task, colour) in zip((0.2, -0.2), TASK_COLOURS.items(), strict=True):
        lengths = [row.on(task).ee_mean for row in rows]
        axes.barh(place + shift, lengths, 0.38, color=colour, label=f"task {task}")
    axes.set_yticks(place, [f"{row.controller}, {row.gains}" for row in rows])
    axes.set(xscale="log", xlabel="mean end-effector error [mm]", title="Ranking on the true axis")
    axes.grid(axis="x", color="0.9", which="both")
    axes.set_axisbelow(True)
    legend_below(figure, axes, columns=2)
    return figure


def twin(result: Result) -> Figure:
    """Gap of the smooth twin over its sharpness."""
    figure = Figure(figsize=(6.0, 4.0), layout="constrained")
    axes = figure.subplots()
    sharpness = [row.sharpness for row in result.gap]
    for task, colour in TASK_COLOURS.items():
        gap = [100 * row.on(task) for row in result.gap]
        axes.loglog(sharpness, gap, "o-", color=colour, label=f"task {task}")
    axes.set(
        xlabel="sharpness [s/m]",
        ylabel="gap in RMS end-effector error [%]",
        title="Smooth twin against stick and slip",
    )
    axes.grid(color="0.9", which="both")
    axes.legend(frameon=False)
    return figure


def _over_time(
    result: Result,
    task: str,
    label: str,
    signal: Callable[[Signals, str], Float[np.ndarray, " T"]],
) -> Figure:
    """One panel for the motor, one for the end effector."""
    figure = Figure(figsize=(8.0, 6.0), layout="constrained")
    panels = figure.subplots(2, 1, sharex=True)
    for axes, (side, title) in zip(panels, SIDES.items(), strict=True):
        for controller, tasks in result.signals.items():
            values = 1e3 * signal(tasks[task], side)
            time = KEPT_PERIOD * np.arange(values.size)
            axes.plot(time, values, label=LABELS[controller], **STYLES[controller])
        axes.set(ylabel=label, title=title)
        axes.grid(color="0.9")
        axes.margins(x=0.01)
    panels[-1].set(xlabel="time [s]")
    return figure
