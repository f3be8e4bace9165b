"""The figures of Yuan's chapter 3, drawn from the numbers of a run."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from experiments.reports.png import save_figures

KEPT_PERIOD = 5e-3  # [s] between the kept samples
LABELS = {"cascade": "PI", "cascade-notch": "PI with filter", "cascade-leso-exact": "PI with LESO"}
COLOURS = {"cascade": "tab:blue", "cascade-notch": "tab:orange", "cascade-leso-exact": "tab:green"}


def draw(summary: dict[str, Any], folder: Path) -> list[Path]:
    """All figures, as PNG files in `folder`."""
    figures: dict[str, Callable[[dict[str, Any]], Figure]] = {
        "figure-3-8": partial(positions, task="A", number="3.8"),
        "figure-3-9": partial(errors, task="A", number="3.9"),
        "figure-3-10": partial(positions, task="B", number="3.10"),
        "figure-3-11": partial(errors, task="B", number="3.11"),
        "ranking": ranking,
        "smooth-twin": twin,
    }
    return save_figures(figures, summary, folder)


def positions(summary: dict[str, Any], task: str, number: str) -> Figure:
    """Figs 3.8 and 3.10: motor and end effector beside the reference."""
    return _over_time(
        summary,
        task,
        f"Fig. {number}: position, task {task}",
        "position [mm]",
        lambda s, side: np.array(s[side]),
        True,
    )


def errors(summary: dict[str, Any], task: str, number: str) -> Figure:
    """Figs 3.9 and 3.11: what motor and end effector are off."""
    title = f"Fig. {number}: tracking error, task {task}"
    return _over_time(
        summary,
        task,
        title,
        "error [mm]",
        lambda s, side: np.array(s["wanted"]) - np.array(s[side]),
        False,
    )


def ranking(summary: dict[str, Any]) -> Figure:
    """Mean error of the end effector of every controller, as it starts and tuned."""
    rows = sorted(
        summary["ranking"], key=lambda row: row["A"]["ee_mean"] + row["B"]["ee_mean"], reverse=True
    )
    figure = Figure(figsize=(8.0, 0.3 * len(rows) + 1.5), layout="constrained")
    axes, place = figure.subplots(), np.arange(len(rows))
    for shift, task, colour in ((0.2, "A", "tab:blue"), (-0.2, "B", "tab:orange")):
        axes.barh(
            place + shift,
            [row[task]["ee_mean"] for row in rows],
            0.38,
            color=colour,
            label=f"task {task}",
        )
    axes.set_yticks(place, [f"{row['controller']}, {row['gains']}" for row in rows])
    axes.set(xscale="log", xlabel="mean end-effector error [mm]", title="Ranking on the true axis")
    axes.grid(axis="x", color="0.9", which="both")
    axes.set_axisbelow(True)
    axes.legend(frameon=False)
    return figure


def twin(summary: dict[str, Any]) -> Figure:
    """The gap of the smooth twin over its sharpness."""
    figure = Figure(figsize=(6.0, 4.0), layout="constrained")
    axes = figure.subplots()
    sharpness = [row["sharpness"] for row in summary["gap"]]
    for task, colour in (("A", "tab:blue"), ("B", "tab:orange")):
        axes.loglog(
            sharpness,
            [100 * row[task] for row in summary["gap"]],
            "o-",
            color=colour,
            label=f"task {task}",
        )
    axes.set(
        xlabel="sharpness [s/m]",
        ylabel="gap in RMS end-effector error [%]",
        title="Smooth twin against stick and slip",
    )
    axes.grid(color="0.9", which="both")
    axes.legend(frameon=False)
    return figure


def _over_time(
    summary: dict[str, Any],
    task: str,
    title: str,
    label: str,
    signal: Callable[[Any, str], np.ndarray],
    wanted: bool,
) -> Figure:
    figure = Figure(figsize=(8.0, 6.0), layout="constrained")
    for axes, side, name in zip(
        figure.subplots(2, 1, sharex=True),
        ("motor", "tool"),
        ("(a) motor", "(b) end effector"),
        strict=True,
    ):
        for controller, tasks in summary["signals"].items():
            values = 1e3 * signal(tasks[task], side)
            time = KEPT_PERIOD * np.arange(values.size)
            axes.plot(
                time, values, color=COLOURS[controller], linewidth=0.9, label=LABELS[controller]
            )
        if wanted:
            axes.plot(
                time,
                1e3 * np.array(tasks[task]["wanted"]),
                color="0.3",
                linewidth=0.8,
                linestyle="--",
                label="reference",
            )
        axes.set(ylabel=label, title=name)
        axes.grid(color="0.9")
        axes.margins(x=0.01)
    figure.axes[0].legend(frameon=False, ncols=4)
    figure.axes[-1].set(xlabel="time [s]")
    figure.suptitle(title)
    return figure
