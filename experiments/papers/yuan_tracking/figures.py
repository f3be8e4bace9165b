"""Figures of Yuan's chapter 3, drawn from a result."""

from functools import partial

import numpy as np
from matplotlib.figure import Figure

from experiments.papers.panels import Curve, Panel, drawn
from experiments.papers.yuan_tracking.experiment import KEPT_PERIOD, Result
from jcontour.app.reports.figures.axes import legend_below

LABELS = {"cascade": "PI", "cascade-notch": "PI with filter", "cascade-leso-exact": "PI with LESO"}
# the first two are nearly the same: the wide line shows beneath the narrow one
STYLES = {
    "cascade": {"color": "tab:blue", "linewidth": 2.6, "alpha": 0.5},
    "cascade-notch": {"color": "tab:orange", "linewidth": 0.9},
    "cascade-leso-exact": {"color": "tab:green", "linewidth": 0.9},
}
SIDES = {"motor": "(a) motor", "tool": "(b) end effector"}
TASK_COLOURS = {"A": "tab:blue", "B": "tab:orange"}


def over_time(result: Result, task: str, number: str, error: bool) -> Figure:
    """Figs 3.8 to 3.11: motor and end effector beside the reference, or their errors."""
    wanted = next(iter(result.signals.values()))[task].wanted
    time, panels = KEPT_PERIOD * np.arange(wanted.size), []
    for side, title in SIDES.items():
        curves = []
        for controller, tasks in result.signals.items():
            signal = getattr(tasks[task], side)
            values = 1e3 * (wanted - signal if error else signal)
            curves.append(Curve(time, values, LABELS[controller], STYLES[controller]))
        if not error:
            dashed = {"color": "0.3", "linewidth": 0.8, "linestyle": "--"}
            curves.append(Curve(time, 1e3 * wanted, "reference", dashed))
        y = "error [mm]" if error else "position [mm]"
        panels.append(Panel(title, "time [s]", y, curves, {"xmargin": 0.01}))
    kind = "tracking error" if error else "position"
    title = f"Fig. {number}: {kind}, task {task}"
    return drawn(panels, (8.0, 6.0), title, legend=4, sharex=True)


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
    sharpness, curves = [row.sharpness for row in result.gap], []
    for task, colour in TASK_COLOURS.items():
        gap = [100 * getattr(row, task) for row in result.gap]
        curves.append(Curve(sharpness, gap, f"task {task}", {"marker": "o", "color": colour}))
    title, y = "Smooth twin against stick and slip", "gap in RMS end-effector error [%]"
    log = {"xscale": "log", "yscale": "log"}
    return drawn([Panel(title, "sharpness [s/m]", y, curves, log)], (6.0, 4.0))


FIGURES = {
    "figure-3-8": partial(over_time, task="A", number="3.8", error=False),
    "figure-3-9": partial(over_time, task="A", number="3.9", error=True),
    "figure-3-10": partial(over_time, task="B", number="3.10", error=False),
    "figure-3-11": partial(over_time, task="B", number="3.11", error=True),
    "ranking": ranking,
    "smooth-twin": twin,
}
