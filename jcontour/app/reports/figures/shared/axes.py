"""Colours, axes and legends that all figures of the commands share."""

from collections.abc import Iterable, Sequence

from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, MaxNLocator, NullLocator, StrMethodFormatter

START, TUNED, DESIRED, OTHER = "tab:orange", "tab:blue", "0.25", "0.7"
COLOURS = {"start": START, "tuned": TUNED}
CYCLE = (TUNED, START, "tab:green", "tab:red", "tab:purple", "tab:brown")  # of other labels


def colours_of(labels: Sequence[str]) -> dict[str, str]:
    """Colour of every label; start and tuned weights always have their own."""
    others = [label for label in labels if label not in COLOURS]
    return COLOURS | {label: CYCLE[k % len(CYCLE)] for k, label in enumerate(others)}


def short(name: str, most: int = 40) -> str:
    """A name with its middle left out where a title has no room for it."""
    return name if len(name) <= most else f"{name[: most // 2]}...{name[-most // 2 + 3 :]}"


def grid(axes: Axes, title: str = "", x: str = "", y: str = "") -> None:
    """Titles, and a grid behind the curves."""
    axes.set_title(title, fontsize=10)
    axes.set(xlabel=x, ylabel=y)
    axes.set_axisbelow(True)
    axes.grid(color="0.9", which="both")


def logarithmic(axes: Axes) -> None:
    """Both scales logarithmic, with numbers that are read at once."""
    axes.set(xscale="log", yscale="log")
    plain_ticks(axes.xaxis)
    plain_ticks(axes.yaxis)


def plain_ticks(axis: Axis) -> None:
    """Plain numbers instead of powers, as few as can be read."""
    low, high = axis.get_view_interval()
    if high > 3 * low:
        steps = (1.0, 2.0, 5.0) if high > 10 * low else (1.0, 2.0, 3.0, 5.0, 7.0)
        axis.set_major_locator(LogLocator(subs=steps, numticks=8))
    else:
        axis.set_major_locator(MaxNLocator(6, steps=[1, 2, 5, 10]))
    axis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axis.set_minor_locator(NullLocator())


def legend_below(
    figure: Figure, axes: Axes | None = None, columns: int = 3, more: Iterable[Artist] = ()
) -> None:
    """One legend under all axes, where it hides no curve.

    It names the curves of `axes`, or of all, and `more` besides; every name once.
    """
    named: dict[object, Artist] = {}
    for one in figure.axes if axes is None else [axes]:
        handles, labels = one.get_legend_handles_labels()
        named |= {label: handle for handle, label in zip(handles, labels, strict=True)}
    named |= {artist.get_label(): artist for artist in more}
    figure.legend(
        handles=list(named.values()), loc="outside lower center", ncols=columns, frameon=False
    )
