"""Figures of sweeps: errors over weights and previews."""

from collections.abc import Sequence

import numpy as np
import xarray as xr
from jaxtyping import Bool, Float
from matplotlib.axes import Axes
from matplotlib.collections import Collection
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from jcontour.app.reports.figures.axes import legend_below

LOST, BEST, BEYOND = "tab:red", "white", "0.4"
COLUMNS = 3  # panels side by side
TICKS = 8  # values of a weight that are all written at the axis
LETTERS = 20  # of labels that fit side by side under a panel
LEVELS = 5  # errors written at the colours
MANY, CELLS = 5_000, 100  # designs, beyond which only the best of each cell of the map is drawn


def worst_errors(
    dataset: xr.Dataset, error: str
) -> tuple[Float[np.ndarray, "P D"], Bool[np.ndarray, "P D"]]:
    """Worst RMS error [um] over contours and plants of every preview and design, and what diverged.

    The error of a diverged design is infinite.
    """
    errors = 1e6 * dataset[f"rms_{error}_error"].values.max(axis=(2, 3))
    diverged = dataset.diverged.values.astype(bool).any(axis=(2, 3))
    return np.where(diverged, np.inf, errors), diverged


def sweep_figure(dataset: xr.Dataset, names: Sequence[str], error: str) -> Figure:
    """A map over the first two weights for each preview; a curve where one weight varies.

    Where more weights vary, the other designs lie behind the best at the same place.

    Args:
        dataset: of a sweep, with `within_limits` and the sample that is the `best` (-1 for none).
        names: of the weights that vary.
        error: that counts, "contour" or "tracking".
    """
    if len(names) == 1:
        name = names[0]
        worst, diverged = worst_errors(dataset, error)
        order = np.argsort(dataset[name].values)
        values = dataset[name].values[order]
        figure = Figure(figsize=(7.0, 5.0), layout="constrained")
        axes = figure.subplots()
        for k, preview in enumerate(dataset.preview.values):
            height, lost = worst[k, order], diverged[k, order]
            beyond = ~dataset.within_limits.values[k, order].astype(bool) & ~lost
            label = f"preview {preview}: {_counted(lost, beyond)}"
            (line,) = axes.plot(values, np.where(lost, np.nan, height), ".-", label=label)
            if beyond.any():
                axes.plot(values[beyond], height[beyond], "o", color=BEYOND, zorder=3)
            best = int(dataset.best.values[k])
            if best >= 0:
                star = dataset[name].values[best], worst[k, best]
                axes.plot(*star, "*", color=line.get_color(), markersize=14)
            if lost.any():  # at the upper edge, for they have no height
                edge = axes.get_xaxis_transform()
                axes.plot(values[lost], np.full(lost.sum(), 0.98), "x", color=LOST, transform=edge)
        axes.set(xlabel=named(dataset, name), ylabel=f"worst RMS {error} error [um]", yscale="log")
        if values.min() > 0:
            axes.set_xscale("log")
        axes.set_title(_marks(dataset), fontsize=10)
        axes.grid(color="0.9")
        legend_below(figure)
        return figure
    return _maps(dataset, names, error)


def _maps(dataset: xr.Dataset, names: Sequence[str], error: str) -> Figure:
    worst, diverged = worst_errors(dataset, error)
    count = len(dataset.preview)
    columns = min(count, COLUMNS)
    rows = -(-count // columns)
    size = (0.8 + 4.0 * columns, 0.6 + 3.8 * rows)
    figure = Figure(figsize=size, layout="constrained")
    panels = figure.subplots(rows, columns, squeeze=False).ravel()
    finite = worst[np.isfinite(worst)]
    ends = (finite.min(), finite.max()) if finite.size else (1.0, 10.0)
    ends = (float(ends[0]), float(max(ends[1], 1.01 * ends[0])))
    norm = LogNorm(*ends)
    shown = None
    for k, preview in enumerate(dataset.preview.values):
        beyond = ~dataset.within_limits.values[k].astype(bool) & ~diverged[k]
        best = int(dataset.best.values[k])
        shown = _map(panels[k], dataset, names, worst[k], beyond, best, norm)
        title = f"preview {preview}: {_counted(diverged[k], beyond)}"
        panels[k].set_title(title, fontsize=10)
    for unused in panels[count:]:
        unused.set_axis_off()
    if shown is not None:
        label = f"worst RMS {error} error [um]"
        ticks = np.geomspace(*ends, LEVELS)  # those of a decade would collide
        bar = figure.colorbar(shown, ax=list(panels), label=label, ticks=ticks, format="{x:.3g}")
        bar.ax.yaxis.set_ticks([], minor=True)
    figure.suptitle(_marks(dataset), fontsize=10)
    return figure


def _map(
    axes: Axes,
    dataset: xr.Dataset,
    names: Sequence[str],
    worst: np.ndarray,
    beyond: np.ndarray,
    best: int,
    norm: LogNorm,
) -> Collection:
    """One preview: every design a coloured mark, the best drawn over the others at its place."""
    x, y = (dataset[name].values for name in names[:2])
    star = x[best], y[best]
    if worst.size > MANY:
        cells = np.zeros(worst.size, int)
        for values in (x, y):
            edges = np.quantile(values, np.linspace(0, 1, CELLS + 1)[1:-1])
            cells = CELLS * cells + np.searchsorted(edges, values)
        order = np.lexsort((worst, cells))
        best_of_cells = order[np.unique(cells[order], return_index=True)[1]]
        x, y, worst, beyond = (one[best_of_cells] for one in (x, y, worst, beyond))
    lost = ~np.isfinite(worst)
    above = np.argsort(-worst[~lost], kind="stable")
    marks = axes.scatter(
        x[~lost][above], y[~lost][above], c=worst[~lost][above], norm=norm, s=160, marker="s"
    )
    axes.plot(x[lost], y[lost], "x", color=LOST, label="diverged")
    if beyond.any():
        axes.plot(x[beyond], y[beyond], "o", color=BEYOND, markersize=4, label="beyond a limit")
    if best >= 0:
        axes.plot(*star, "*", color=BEST, mec="black", markersize=15, label="best")
    axes.set(xlabel=named(dataset, names[0]), ylabel=named(dataset, names[1]))
    scaled(axes, x, y)
    return marks


def scaled(axes: Axes, x: np.ndarray, y: np.ndarray) -> None:
    """Logarithmic axes; linear near zero where a weight is zero."""
    for values, scale in ((x, axes.set_xscale), (y, axes.set_yscale)):
        positive = values[values > 0]
        if values.min() > 0:
            scale("log")
        elif positive.size and values.min() == 0:
            scale("symlog", linthresh=float(positive.min()))
    for values, axis in ((x, axes.xaxis), (y, axes.yaxis)):
        ticks = np.unique(values)
        if ticks.size <= TICKS:
            labels = [f"{tick:g}" for tick in ticks]
            axis.set_ticks(ticks, labels=labels)
            axis.set_ticks([], minor=True)
            if axis is axes.xaxis and sum(map(len, labels)) > LETTERS:
                axis.set_tick_params(rotation=45)


def _marks(dataset: xr.Dataset) -> str:
    """What the marks mean."""
    beyond = "" if dataset.within_limits.values.all() else "; grey dot: beyond a limit on its runs"
    return f"Star: best; red cross: diverged{beyond}"


def _counted(lost: np.ndarray, beyond: np.ndarray) -> str:
    more = f", {int(beyond.sum())} beyond a limit" if beyond.any() else ""
    return f"{int(lost.sum())} of {lost.size} diverged{more}"


def named(dataset: xr.Dataset, name: str) -> str:
    """Name of a coordinate with its unit."""
    unit = dataset[name].attrs.get("units", "1")
    return name if unit in ("", "1") else f"{name} [{unit}]"
