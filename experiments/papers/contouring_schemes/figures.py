"""The figures of the comparison of contouring schemes, drawn from the numbers of a run."""

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from experiments.papers.contouring_schemes.claims import mean
from experiments.reports.png import save_figures


def draw(summary: dict[str, Any], folder: Path) -> list[Path]:
    """All figures, as PNG files in `folder`."""
    return save_figures({"held-out-errors": errors, "tuning": tuning}, summary, folder)


def errors(summary: dict[str, Any]) -> Figure:
    """RMS contour error on held-out contours: every scheme on every machine."""
    schemes = list(dict.fromkeys(row["scheme"] for row in summary["tuning"]))
    plants = list(dict.fromkeys(row["plant"] for row in summary["rows"]))
    figure, panels = _panels(summary)
    width = 0.8 / len(plants)
    for loops, axes in panels.items():
        for k, plant in enumerate(plants):
            heights = [
                mean(summary, scheme, "contour_um", loops=loops, plant=plant, training=False)
                for scheme in schemes
            ]
            axes.bar(
                np.arange(len(schemes)) + (k - (len(plants) - 1) / 2) * width,
                heights,
                width,
                label=plant,
            )
        axes.set_xticks(np.arange(len(schemes)), schemes, rotation=25, ha="right")
        axes.set(title=loops)
        axes.grid(color="0.9", axis="y")
        axes.set_axisbelow(True)
    figure.axes[0].set(ylabel="RMS contour error [um]")
    _legend(figure)
    figure.suptitle("Held-out contours, machine with stick and slip")
    return figure


def tuning(summary: dict[str, Any]) -> Figure:
    """The best objective so far: the cascade first, then every scheme from there, then from the start again."""
    figure, panels = _panels(summary)
    for row in summary["tuning"]:
        panels[row["loops"]].plot(
            np.arange(1, len(row["best_um"]) + 1),
            row["best_um"],
            label=row["scheme"],
            linewidth=1.0,
        )
    for loops, axes in panels.items():
        axes.set(xlabel="evaluations", yscale="log", title=loops)
        axes.grid(color="0.9", which="both")
    figure.axes[0].set(ylabel="mean RMS contour error [um]")
    _legend(figure)
    figure.suptitle("Tuning on the smooth twin")
    return figure


def _panels(summary: dict[str, Any]):
    """One panel for each kind of loops."""
    loops = list(dict.fromkeys(row["loops"] for row in summary["tuning"]))
    figure = Figure(figsize=(5.5 * len(loops), 4.6), layout="constrained")
    return figure, dict(
        zip(loops, np.atleast_1d(figure.subplots(1, len(loops), sharey=True)), strict=True)
    )


def _legend(figure: Figure) -> None:
    """One for all panels."""
    figure.legend(
        *figure.axes[0].get_legend_handles_labels(),
        loc="outside lower center",
        ncols=6,
        frameon=False,
    )
