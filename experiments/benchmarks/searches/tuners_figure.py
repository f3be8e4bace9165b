"""The figure of `jcontour bench tuners`: best value so far against evaluations."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from jcontour.app.reports.figures.axes import legend_below

COLOURS = {
    "jcontour": "tab:blue",
    "CMA-ES": "tab:orange",
    "TPE": "tab:green",
    "Nelder-Mead": "tab:red",
    "Sobol": "0.5",
    "grid": "0.75",
}
ABOVE = 10.0  # times the best value, up to which a panel shows


class Curve(NamedTuple):
    """Best value so far over the best known: quartiles and median over the seeds."""

    evaluations: Float[np.ndarray, " n"]
    low: Float[np.ndarray, " n"]
    middle: Float[np.ndarray, " n"]
    high: Float[np.ndarray, " n"]


def tuners_figure(curves: Mapping[str, Mapping[str, Curve]]) -> Figure:
    """A panel for every problem; medians as lines, quartiles as bands."""
    columns = min(3, len(curves))
    rows = -(-len(curves) // columns)
    figure = Figure(figsize=(3.3 * columns, 2.6 * rows + 0.5), layout="constrained")
    panels = np.atleast_1d(figure.subplots(rows, columns, squeeze=False)).ravel()
    for axes, (name, methods) in zip(panels, curves.items(), strict=False):
        for method, curve in methods.items():
            colour = COLOURS.get(method)
            axes.plot(curve.evaluations, _shown(curve.middle), color=colour, label=method)
            band = _shown(curve.low), _shown(curve.high)
            axes.fill_between(curve.evaluations, *band, color=colour, alpha=0.15, lw=0)
        axes.set(xscale="log", yscale="log", ylim=(0.95, ABOVE), title=name)
        axes.title.set_fontsize(9)
        axes.set_yticks([1, 2, 5, 10], ["1", "2", "5", "10"])
        axes.minorticks_off()
        axes.grid(alpha=0.3)
    for axes in panels[len(curves) :]:
        axes.set_visible(False)
    for axes in panels[: len(curves)]:
        axes.set_xlabel("evaluations", fontsize=8)
    figure.supylabel("best value so far over the best known", fontsize=9)
    legend_below(figure)
    return figure


def _shown(values: Float[np.ndarray, " n"]) -> np.ndarray:
    """Values far above the panel, where no point is within the limits yet."""
    return np.minimum(np.nan_to_num(values, posinf=1e3), 1e3)
