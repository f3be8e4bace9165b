"""Colours, axes, legends and long curves that all figures share."""

import io
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TypeVar

import numpy as np
from jaxtyping import Float
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, MaxNLocator, NullLocator, StrMethodFormatter

from jcontour.app.beside import Beside
from jcontour.app.files.run_folder import write

START, TUNED, DESIRED, OTHER = "tab:orange", "tab:blue", "0.25", "0.7"
COLOURS = {"start": START, "tuned": TUNED}
CYCLE = (TUNED, START, "tab:green", "tab:red", "tab:purple", "tab:brown")  # of other labels
MOST = 20_000  # points that are drawn one by one
COLUMNS = 600  # of a curve with more
LIGHT = 0.35  # opacity of its band
WORDS = "light: from least to most, line: mean"


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


def legend_below(figure: Figure, columns: int = 3) -> None:
    """One legend under all axes, where it hides no curve; every name once."""
    named: dict[object, Artist] = {}
    for axes in figure.axes:
        handles, labels = axes.get_legend_handles_labels()
        named |= {label: handle for handle, label in zip(handles, labels, strict=True)}
    figure.legend(
        handles=list(named.values()), loc="outside lower center", ncols=columns, frameon=False
    )


def long(points: int) -> bool:
    """Whether so many points become a band."""
    return points > MOST


def draw_curve(
    axes: Axes,
    x: Float[np.ndarray, " T"],
    y: Float[np.ndarray, " T"],
    colour: str,
    width: float,
    label: str,
) -> None:
    """Draw y over x, which rises; where y is NaN there is a gap.

    A long curve is drawn in columns of one width on the x axis: its mean over x, and a band from
    the least to the most around it. No peak is lost, and a block of one colour tells nothing.
    """
    if not long(x.size):
        axes.plot(x, y, color=colour, linewidth=width, label=label)
        return
    edges = np.linspace(x[0], x[-1], COLUMNS + 1)
    low, high, mean = (np.repeat(rows, 2) for rows in _columns(x, y, edges))
    sides = np.repeat(edges, 2)[1:-1]
    axes.fill_between(sides, low, high, color=colour, alpha=LIGHT, linewidth=0)
    axes.plot(sides, mean, color=colour, linewidth=width, label=label)


def _columns(
    x: Float[np.ndarray, " T"], y: Float[np.ndarray, " T"], edges: Float[np.ndarray, " edges"]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Least, most and mean over x of y between neighbouring edges; NaN where there is nothing."""
    begins = edges[:-1]  # with a point at each, no column is empty
    place = np.append(begins, x)
    order = np.argsort(place, kind="stable")
    value = np.append(np.interp(begins, x, y), y)[order]
    first = np.searchsorted(place[order], begins)
    low, high = np.fmin.reduceat(value, first), np.fmax.reduceat(value, first)
    middle = 0.5 * (y[1:] + y[:-1])
    there = np.where(np.isfinite(middle), np.diff(x), 0.0)
    area, length = (
        np.diff(np.interp(edges, x, np.append(0.0, np.cumsum(part))))
        for part in (there * np.nan_to_num(middle), there)
    )
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.where(np.isfinite(high), area / length, np.nan)
    return low, high, np.clip(mean, low, high)  # a difference of sums is rounded


DOTS = 150  # per inch
PACKED = {"compress_level": 1}  # a quarter larger than the smallest file, in half the time
Data = TypeVar("Data")


def save_figures(
    figures: Mapping[str, Callable[[Data], Figure]], data: Data, folder: Path
) -> list[Path]:
    """Draw every figure from the same data; the names are those of the files."""
    return [save_figure(make(data), folder / f"{name}.png") for name, make in figures.items()]


def save_figure(figure: Figure, path: Path) -> Path:
    """Write one figure; the file appears whole."""
    return _save(image(figure), path)


def _save(content: bytes, path: Path) -> Path:
    return write(path, lambda temporary: temporary.write_bytes(content))


def image(figure: Figure) -> bytes:
    """Content of a figure's PNG file.

    It is drawn once; `savefig` lays it out in a drawing of its own before.
    """
    figure.set_dpi(DOTS)
    content = io.BytesIO()
    FigureCanvasAgg(figure).print_png(content, pil_kwargs=PACKED)
    return content.getvalue()


@contextmanager
def drawn_beside(figures: Mapping[Path, Figure]) -> Iterator[None]:
    """Write figures while the block runs; they are written when it ends.

    Args:
        figures: by their files.
    """
    with Beside() as process:
        drawn = {path: process.submit(image, figure) for path, figure in figures.items()}
        yield
        for path, content in drawn.items():
            _save(content(), path)
