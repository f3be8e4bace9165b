"""Figures of Yuan's contouring controllers, drawn from a result."""

import numpy as np
from matplotlib.figure import Figure

from experiments.papers.panels import Curve, Panel, drawn
from experiments.papers.yuan_contouring_bounded.experiment import Result
from experiments.papers.yuan_gantry.runs import SAMPLE
from jcontour.app.reports.figures.axes import CYCLE, OTHER

COLUMNS = 2


def errors(result: Result) -> Figure:
    """Contour error along Fig. 5.11, below what is promised."""
    panels = []
    for row in result.loops:
        time = SAMPLE * np.arange(len(row.contour_error_um))
        thin, dashed = {"color": CYCLE[0], "linewidth": 0.6}, {"color": OTHER, "linestyle": "--"}
        curves = [
            Curve(time, row.contour_error_um, "contour error", thin),
            Curve(None, row.promised_um, "promised", dashed),
        ]
        panels.append(Panel(f"{row.label}; {row.place}", "time [s]", "error [um]", curves))
    size = (9.0, 0.8 + 2.2 * -(-len(panels) // COLUMNS))
    return drawn(
        panels, size, "Figs 5.14 and 5.16: contour error under disturbances", columns=COLUMNS
    )


FIGURES = {"figures-5-14-and-5-16": errors}
