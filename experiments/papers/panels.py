"""Figures of a paper: panels, and the curves of each."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from matplotlib.figure import Figure

from jcontour.app.reports.figures.axes import grid, legend_below


@dataclass(frozen=True)
class Curve:
    """Values over x, drawn with a style of matplotlib.

    Without x a number is a level right across the panel.
    """

    x: Any
    y: Any
    label: str | None = None
    style: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Panel:
    """Curves in one pair of axes."""

    title: str  # above it
    x: str  # label of its axis
    y: str  # label of its axis
    curves: list[Curve]  # from back to front
    # other properties of the axes, as `xscale="log"`
    axes: dict[str, Any] = field(default_factory=dict)


def drawn(
    panels: Sequence[Panel],
    size: tuple[float, float],
    title: str = "",
    columns: int = 1,
    legend: int = 3,
    **shared: Any,
) -> Figure:
    """Panels row by row in a figure of this size [inch], and below them one legend of all labels.

    The legend has so many names in a row; axes that are shared, by `sharex`, have one label.
    """
    figure = Figure(figsize=size, layout="constrained")
    rows = -(-len(panels) // columns)
    places = figure.subplots(rows, columns, squeeze=False, **shared).ravel()
    for axes, panel in zip(places, panels, strict=False):
        for curve in panel.curves:
            if curve.x is None:
                axes.axhline(curve.y, label=curve.label, **curve.style)
            else:
                axes.plot(curve.x, curve.y, label=curve.label, **curve.style)
        grid(axes, panel.title, panel.x, panel.y)
        axes.set(**panel.axes)
        if shared:
            axes.label_outer()
    for axes in places[len(panels) :]:
        axes.remove()
    if title:
        figure.suptitle(title)
    if any(curve.label for panel in panels for curve in panel.curves):
        legend_below(figure, columns=legend)
    return figure
