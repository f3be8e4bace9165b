"""Legend of a figure of a paper: one for all panels, below them, where it hides no curve."""

from collections.abc import Iterable

from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure


def legend_below(figure: Figure, axes: Axes, columns: int, more: Iterable[Artist] = ()) -> None:
    """Draw the labels of one panel, and these entries besides, below all panels."""
    handles, _ = axes.get_legend_handles_labels()
    entries = [*handles, *more]
    figure.legend(handles=entries, loc="outside lower center", ncols=columns, frameon=False)
