"""The figure of a front: contour error against the control increment that is spent."""

from collections.abc import Sequence
from typing import NamedTuple

from matplotlib.figure import Figure

from experiments.reports.axes import TUNED, grid, legend_below, logarithmic


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
        "tuned for this budget": ("o", TUNED, [point for point in met if not point.slack]),
        "budget is slack": ("s", TUNED, [point for point in met if point.slack]),
        "budget not met": ("o", "none", [point for point in points if not point.feasible]),
    }
    axes.plot(*_places(met), color=TUNED, linewidth=1.0)
    for label, (marker, face, shown) in kinds.items():
        if shown:
            axes.plot(*_places(shown), marker, color=TUNED, mfc=face, label=label)
    grid(
        axes,
        title="Front over contours and family (smooth machine)",
        x=f"worst RMS control increment [{unit} per sample]",
        y=f"worst RMS {error} error [um]",
    )
    logarithmic(axes)
    legend_below(figure)
    return figure


def _places(points: Sequence[Spent]) -> tuple[list[float], list[float]]:
    return [point.increment for point in points], [1e6 * point.error for point in points]
