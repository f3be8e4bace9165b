"""Figures of Yuan's chapter 4, drawn from a result."""

import numpy as np
from matplotlib.figure import Figure

from experiments.papers.panels import Curve, Panel, drawn
from experiments.papers.yuan_bounded.experiment import DT, Result
from jcontour.app.reports.figures.axes import CYCLE, OTHER


def errors(result: Result) -> Figure:
    """Tracking error under the disturbances, between the promised bounds."""
    panels = []
    for row in result.loops:
        dashed = {"color": OTHER, "linestyle": "--"}
        time = DT * np.arange(row.samples)
        curves = [Curve(time, row.error_mm, "tracking error", {"color": CYCLE[0]})]
        curves += [Curve(None, sign * row.promised_mm, "promised", dashed) for sign in (-1, 1)]
        panels.append(Panel(f"reference {row.reference}", "time [s]", "error [mm]", curves))
    title = "Bounded MPC: slow, random and worst disturbances, a third of the run each"
    return drawn(panels, (9.0, 3.6), title, columns=len(panels))


def motions(result: Result) -> Figure:
    """Figs 4.3 and 4.5: tracking error of the end effector along the point-to-point motion."""
    curves = [
        Curve(run.period_s * np.arange(run.error_mm.size), run.error_mm, run.controller)
        for run in result.motions
    ]
    title = "Figs 4.3 and 4.5: point-to-point motion, the controllers that can be run"
    return drawn([Panel(title, "time [s]", "error [mm]", curves)], (8.0, 4.0), legend=2)


FIGURES = {"figure-4-2": errors, "figures-4-3-and-4-5": motions}
