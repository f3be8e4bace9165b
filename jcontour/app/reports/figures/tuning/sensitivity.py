"""Figure of the sensitivity over frequency, of the whole family, before and after tuning."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from jcontour.app.reports.figures.shared.axes import COLOURS, grid, legend_below, logarithmic


class FamilyCurves(NamedTuple):
    """Sensitivity over frequency.

    Attributes:
        frequency: [Hz].
        sensitivity: of every plant, the largest of all probes; NaN for a plant with a loop that is
            not stable.
    """

    frequency: Float[np.ndarray, " F"]
    sensitivity: Float[np.ndarray, "P F"]


def sensitivity_figure(curves: Mapping[str, FamilyCurves], bound: float | None) -> Figure:
    """One thin line for each plant, a thick one for the largest of all.

    Args:
        curves: by the name of the design.
        bound: that the tuner kept; None without.
    """
    figure = Figure(figsize=(7.0, 4.2), layout="constrained")
    axes = figure.subplots()
    for design, (frequency, sensitivity) in curves.items():
        colour, stable = COLOURS[design], np.isfinite(sensitivity).all(axis=1)
        axes.plot(frequency, sensitivity[stable].T, color=colour, linewidth=0.5, alpha=0.4)
        if stable.any():
            label = f"{design}, largest of the family"
            axes.plot(frequency, sensitivity[stable].max(axis=0), color=colour, label=label)
        if not stable.all():
            count = f"{(~stable).sum()} of {stable.size}"
            axes.plot([], [], color=colour, label=f"{design}: {count} plants not stable, not drawn")
    if bound is not None:
        axes.axhline(bound, color="0.3", linestyle="--", linewidth=1.0, label=f"limit {bound:g}")
    logarithmic(axes)
    title = "Sensitivity to disturbances, smooth family; below 1 the loop reduces them"
    grid(axes, title, "frequency [Hz]", "largest singular value of S")
    legend_below(figure)
    return figure
