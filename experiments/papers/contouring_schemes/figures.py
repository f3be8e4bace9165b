"""Figures of the comparison of contouring schemes, drawn from a result."""

import numpy as np
from matplotlib.figure import Figure

from experiments.papers.contouring_schemes.experiment import Result
from experiments.papers.panels import Curve, Panel, drawn
from jcontour.app.reports.figures.axes import legend_below

BARS = 0.8  # of the distance between two schemes


def errors(result: Result) -> Figure:
    """RMS contour error on held-out contours.

    A group for each scheme, in it a bar for each machine.
    """
    schemes, plants = result.schemes, result.different("plant")
    kinds, width = result.different("loops"), BARS / len(plants)
    figure = Figure(figsize=(6.0 * len(kinds), 4.8), layout="constrained")
    panels = np.atleast_1d(figure.subplots(1, len(kinds), sharey=True))
    for axes, loops in zip(panels, kinds, strict=True):
        for k, plant in enumerate(plants):
            heights = [result.mean(scheme, loops, plant, training=False) for scheme in schemes]
            place = np.arange(len(schemes)) + (k - (len(plants) - 1) / 2) * width
            axes.bar(place, heights, width, label=plant)
        axes.set_xticks(np.arange(len(schemes)), schemes, rotation=25, ha="right")
        axes.set(title=loops)
        axes.grid(color="0.9", axis="y")
        axes.set_axisbelow(True)
    legend_below(figure, panels[0], columns=2 * len(panels))
    panels[0].set(ylabel="RMS contour error [um]")
    figure.suptitle("Held-out contours, machine with stick and slip")
    return figure


def tuning(result: Result) -> Figure:
    """Best feasible objective over the evaluations.

    First those of the cascade, then every scheme from there, then from the start again.
    """
    panels: dict[str, Panel] = {}
    for row in result.tuning:
        y, log = "" if panels else "mean RMS contour error [um]", {"yscale": "log"}
        panel = panels.setdefault(row.loops, Panel(row.loops, "evaluations", y, [], log))
        count = np.arange(1, len(row.best_um) + 1)
        panel.curves.append(Curve(count, row.best_um, row.scheme, {"linewidth": 1.0}))
    kinds, title = len(panels), "Tuning on the smooth twin"
    size = (6.0 * kinds, 4.8)
    return drawn([*panels.values()], size, title, columns=kinds, legend=2 * kinds, sharey=True)


FIGURES = {"held-out-errors": errors, "tuning": tuning}
