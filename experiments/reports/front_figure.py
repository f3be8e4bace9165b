"""The figure of a front: contour error against the control increment that is spent."""

from collections.abc import Sequence
from typing import NamedTuple

from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

COLOUR = "tab:blue"


class Spent(NamedTuple):
    """One point of a front."""

    increment: float  # worst RMS control increment [control unit per sample]
    error: float  # worst RMS error [m]
    feasible: bool
    slack: bool


def front(points: Sequence[Spent], error: str, unit: str) -> Figure:
    """Least worst error of every budget.

    A filled marker is a budget that is used up, a square one that is slack, an open marker one that
    no weights met.
    """
    figure = Figure(figsize=(7.0, 5.0), layout="constrained")
    axes = figure.subplots()
    met = [point for point in points if point.feasible]
    kinds = {
        "tuned for this budget": ("o", COLOUR, [point for point in met if not point.slack]),
        "budget is slack": ("s", COLOUR, [point for point in met if point.slack]),
        "budget not met": ("o", "none", [point for point in points if not point.feasible]),
    }
    axes.plot(*_places(met), color=COLOUR, linewidth=1.0)
    for label, (marker, face, shown) in kinds.items():
        if shown:
            axes.plot(*_places(shown), marker, color=COLOUR, mfc=face, label=label)
    axes.set(
        xlabel=f"worst RMS control increment [{unit} per sample]",
        ylabel=f"worst RMS {error} error [um]",
        xscale="log",
        yscale="log",
        title="Front over contours and family (smooth machine)",
    )
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(LogLocator(subs=(1.0, 1.5, 2.0, 3.0, 5.0, 7.0), numticks=12))
        axis.set_major_formatter(StrMethodFormatter("{x:g}"))
        axis.set_minor_formatter(NullFormatter())
    axes.grid(color="0.9", which="both")
    figure.legend(loc="outside lower center", ncols=3, frameon=False)
    return figure


def _places(points: Sequence[Spent]) -> tuple[list[float], list[float]]:
    return [point.increment for point in points], [1e6 * point.error for point in points]
