"""Figures of a sweep of predictive control: error and time over weights, horizon and speed."""

from collections.abc import Iterator

import numpy as np
import xarray as xr
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

from jcontour.app.reports.figures.shared.axes import grid, legend_below, plain_ticks
from jcontour.app.reports.figures.tuning.sweep import LOST, named, scaled

NARROW = 10  # ratio of the ends of a scale within which all its ticks are written
MARK = 220  # area of a design [points^2]
PLACE = ("speed", "horizon", "sample")  # of a design, whatever the contour


def design_numbers(
    dataset: xr.Dataset,
) -> tuple[Float[np.ndarray, "V H D"], Float[np.ndarray, "V H D"]]:
    """Time of all contours [s] and the worst RMS contour error [um] of every design.

    NaN where it has not arrived along one of them.
    """
    arrived = (dataset.ending.values == 0).all(axis=0)
    time = np.where(arrived, dataset.time.values.sum(axis=0), np.nan)
    error = np.where(arrived, 1e6 * dataset.rms_contour_error.values.max(axis=0), np.nan)
    return time, error


def on_the_front(dataset: xr.Dataset) -> Iterator[dict[str, int]]:
    """Places of the designs with less error than every quicker one, the quickest first."""
    time, error = design_numbers(dataset)
    least = np.inf
    for flat in np.lexsort((error.ravel(), time.ravel())):
        if error.flat[flat] < least:  # NaN is never less
            least = error.flat[flat]
            place = np.unravel_index(flat, error.shape)
            yield {name: int(index) for name, index in zip(PLACE, place, strict=True)}


def surface_figure(dataset: xr.Dataset) -> Figure:
    """Maps over the first weight and the horizon for each speed: error above, time below.

    Where more weights vary, the other designs lie behind the one of least error at their place.
    """
    time, error = design_numbers(dataset)
    count = len(dataset.speed)
    figure = Figure(figsize=(1.8 + 3.4 * count, 6.8), layout="constrained")
    rows = figure.subplots(2, count, squeeze=False)
    labels = ("RMS contour error [um]", "traversal time [s]")
    for panels, values, label in zip(rows, (error, time), labels, strict=True):
        low, high = _ends(values)
        norm = LogNorm(low, high)
        for axes, heights, errors, speed in zip(
            panels, values, error, dataset.speed.values, strict=True
        ):
            _map(axes, dataset, heights, errors, norm)
            axes.set_title(f"{speed:g} mm/s", fontsize=10)
        colours = ScalarMappable(norm)
        bar = figure.colorbar(colours, ax=list(panels), label=label, format="{x:.3g}")
        bar.ax.yaxis.set_minor_formatter("{x:.3g}" if high < NARROW * low else NullFormatter())
    figure.suptitle(f"{dataset.attrs['title']}; red cross: has not arrived", fontsize=10)
    return figure


def front_figure(dataset: xr.Dataset) -> Figure:
    """RMS contour error over traversal time, a colour for each horizon; the front is a line."""
    time, error = design_numbers(dataset)
    figure = Figure(figsize=(7.0, 5.4), layout="constrained")
    axes = figure.subplots()
    for h, horizon in enumerate(dataset.horizon.values):
        axes.plot(time[:, h].ravel(), error[:, h].ravel(), ".", label=f"horizon {horizon}")
    front = [tuple(place.values()) for place in on_the_front(dataset)]
    if front:
        index = tuple(np.transpose(front))
        axes.plot(time[index], error[index], color="black", linewidth=0.8, label="front")
        axes.set_yscale("log")
        plain_ticks(axes.yaxis)
    grid(axes, dataset.attrs["title"], "traversal time [s]", "RMS contour error [um]")
    legend_below(figure)
    return figure


def _ends(values: np.ndarray) -> tuple[float, float]:
    """Ends of a scale for all values; of one that is the same everywhere too."""
    finite = values[np.isfinite(values)]
    low, high = (finite.min(), finite.max()) if finite.size else (1.0, 10.0)
    return float(low), float(max(high, 1.01 * low))


def _map(
    axes: Axes,
    dataset: xr.Dataset,
    values: Float[np.ndarray, "H D"],
    errors: Float[np.ndarray, "H D"],
    norm: LogNorm,
) -> None:
    """One speed: every design a coloured mark, the one of least error above the others."""
    name = next(name for name in dataset.coords if dataset[name].dims == ("sample",))
    x, y = np.meshgrid(dataset[name].values, dataset.horizon.values.astype(float))
    lost = ~np.isfinite(errors)
    above = np.argsort(-errors[~lost], kind="stable")
    x_shown, y_shown, shown = (column[~lost][above] for column in (x, y, values))
    axes.scatter(x_shown, y_shown, c=shown, norm=norm, s=MARK, marker="s")
    axes.plot(x[lost], y[lost], "x", color=LOST)
    axes.set(xlabel=named(dataset, str(name)), ylabel="horizon [steps]")
    scaled(axes, x.ravel(), y.ravel())
    axes.margins(0.12)
