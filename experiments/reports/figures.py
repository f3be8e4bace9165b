"""Figures of a tuning run and of a simulation, drawn from what the run folder stores."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")  # files only: no window, also where there is no screen

import matplotlib.pyplot as plt  # noqa: E402
import numpy as np  # noqa: E402
import xarray as xr  # noqa: E402
from matplotlib.figure import Figure  # noqa: E402
from matplotlib.ticker import LogLocator, StrMethodFormatter  # noqa: E402

from experiments.files.run_folder import write

START, TUNED, DESIRED, OTHER = "tab:orange", "tab:blue", "0.25", "0.7"
COLOURS = {"start": START, "tuned": TUNED}
DOTS = 150  # per inch
MAGNIFIED = 0.06  # of the contour's size: how large the largest error is drawn


def draw_tuned(
    dataset: xr.Dataset, points: list[dict[str, Any]], summary: dict[str, Any], folder: Path
) -> list[Path]:
    """Contours with magnified error, errors over time, loss history, trade-off."""
    made = draw_runs(dataset, folder)
    made.append(_saved(folder / "history.png", lambda: loss_history(points)))
    made.append(_saved(folder / "trade_off.png", lambda: trade_off(points, summary)))
    return made


def draw_runs(dataset: xr.Dataset, folder: Path) -> list[Path]:
    """Every contour in a plane with its magnified error, and the errors over time, on the nominal plant."""
    made = []
    for name in dataset.contour.values:
        runs = dataset.sel(contour=name).isel(plant=0)
        if dataset.sizes["axis"] > 1:
            made.append(
                _saved(
                    folder / f"contour-{name}.png",
                    lambda runs=runs, name=name: contour_with_error(runs, str(name)),
                )
            )
        made.append(
            _saved(
                folder / f"errors-{name}.png",
                lambda runs=runs, name=name: errors_over_time(runs, str(name)),
            )
        )
    return made


def contour_with_error(runs: xr.Dataset, name: str) -> Figure:
    """The contour in the plane of its first two axes; the contour error of every design drawn larger than it is."""
    counted = runs.scored.values.astype(bool)
    desired = 1e3 * np.where(counted[:, None], runs.reference.values, np.nan)[:, :2]
    errors = {
        str(d): 1e3
        * np.where(counted[:, None], runs.contour_error.sel(design=d).values, np.nan)[:, :2]
        for d in runs.design.values
    }
    size = float(np.nanmax(np.nanmax(desired, axis=0) - np.nanmin(desired, axis=0)))
    largest = max(float(np.nanmax(np.abs(np.where(np.isfinite(e), e, 0)))) for e in errors.values())
    factor = _round(MAGNIFIED * size / largest) if 0 < largest < size else 1.0
    figure, axes = plt.subplots(figsize=(7.0, 6.0), layout="constrained")
    axes.plot(*desired.T, color=DESIRED, linewidth=0.8, linestyle="--", label="contour")
    for design, error in errors.items():
        axes.plot(
            *(desired + factor * error).T,
            color=COLOURS.get(design, TUNED),
            linewidth=1.0,
            label=f"{design}, error x {factor:g}",
        )
    axes.set_aspect("equal", adjustable="datalim")
    names = [str(a) for a in runs.axis.values]
    axes.set(
        xlabel=f"{names[0]} [mm]",
        ylabel=f"{names[1]} [mm]",
        title=f"{name}: contour error x {factor:g}, nominal plant",
    )
    figure.legend(loc="outside lower center", ncols=3, frameon=False)
    return figure


def errors_over_time(runs: xr.Dataset, name: str) -> Figure:
    """Contour error (of a single axis: its tool), tracking error and control increment over time."""
    time, counted = runs.time.values, runs.scored.values.astype(bool)
    figure, rows = plt.subplots(3, 1, figsize=(8.0, 7.0), sharex=True, layout="constrained")
    alone = runs.sizes["axis"] == 1
    for design in runs.design.values:
        one = runs.sel(design=design)
        signals = (
            1e3 * one.output.values[:, 0]
            if alone
            else 1e6 * np.linalg.norm(one.contour_error.values, axis=-1),
            1e6 * np.linalg.norm(one.output.values - one.reference.values, axis=-1),
            np.append(np.linalg.norm(np.diff(one.control.values, axis=0), axis=-1), np.nan),
        )
        for axes, signal in zip(rows, signals, strict=True):
            axes.plot(
                time,
                np.where(counted, signal, np.nan),
                color=COLOURS.get(str(design), TUNED),
                linewidth=0.8,
                label=str(design),
            )
    unit = runs.control.attrs.get("units", "control unit")
    if alone:
        rows[0].plot(
            time,
            np.where(counted, 1e3 * runs.reference.values[:, 0], np.nan),
            color=DESIRED,
            linewidth=0.8,
            linestyle="--",
        )
    for axes, label in zip(
        rows,
        (
            "tool [mm]" if alone else "contour error [um]",
            "tracking error [um]",
            f"increment [{unit}]",
        ),
        strict=True,
    ):
        axes.set(ylabel=label)
        axes.grid(color="0.9")
        axes.margins(x=0.01)
    rows[0].set(title=f"{name}: scored samples, nominal plant")
    used = time[counted]
    rows[-1].set(xlabel="time [s]", xlim=(used[0], used[-1]))
    figure.legend(
        *rows[0].get_legend_handles_labels(), loc="outside lower center", ncols=3, frameon=False
    )
    return figure


def loss_history(points: list[dict[str, Any]]) -> Figure:
    """Objective of every point tried, and the best feasible one so far."""
    figure, axes = plt.subplots(figsize=(7.0, 4.0), layout="constrained")
    index = np.arange(1, len(points) + 1)
    objective = np.array(
        [
            np.nan if p["diverged"] or p["objective"] is None else 1e6 * p["objective"]
            for p in points
        ],
        float,
    )
    feasible = np.array(
        [not p["diverged"] and (p["violation"] is None or p["violation"] <= 1e-6) for p in points]
    )
    best = np.fmin.accumulate(np.where(feasible, objective, np.inf))
    for descent in sorted({p["descent"] for p in points}):
        chosen = np.array([p["descent"] == descent for p in points])
        axes.plot(
            index[chosen],
            objective[chosen],
            "o",
            markersize=4,
            label="random points" if descent < 0 else f"descent {descent + 1}",
        )
    axes.plot(
        index,
        np.where(np.isfinite(best), best, np.nan),
        color="0.3",
        linewidth=1.2,
        label="best feasible so far",
    )
    diverged = np.array([p["diverged"] for p in points])
    if diverged.any():
        height = np.nanmin(objective) if np.isfinite(objective).any() else 1.0
        axes.plot(
            index[diverged],
            np.full(diverged.sum(), height),
            "x",
            color="tab:red",
            label="diverged: rejected",
        )
    axes.set(
        xlabel="evaluated point",
        ylabel="objective [um]",
        yscale="log",
        title="Points tried (smooth machine)",
    )
    _plain_ticks(axes.yaxis)
    axes.grid(color="0.9", which="both")
    figure.legend(loc="outside lower center", ncols=3, frameon=False)
    return figure


def trade_off(points: list[dict[str, Any]], summary: dict[str, Any]) -> Figure:
    """Worst contour error against worst control increment of all points, and the lower left edge of those within the limits."""
    figure, axes = plt.subplots(figsize=(7.0, 5.0), layout="constrained")
    sound = [p for p in points if not p["diverged"]]
    within = np.array([p["violation"] is None or p["violation"] <= 1e-6 for p in sound], bool)
    increment = np.array([p["rms_increment"] for p in sound])
    error = 1e6 * np.array([p[f"rms_{summary['error']}_error"] for p in sound])
    axes.plot(
        increment[within],
        error[within],
        "o",
        color=OTHER,
        markersize=5,
        label="evaluated, within the limits",
    )
    if not within.all():
        axes.plot(
            increment[~within],
            error[~within],
            "o",
            mfc="none",
            color=OTHER,
            markersize=5,
            label="evaluated, limit exceeded",
        )
    edge = _edge(increment[within], error[within])
    axes.step(
        increment[within][edge],
        error[within][edge],
        where="post",
        color="0.3",
        linewidth=1.0,
        label="front of these",
    )
    for design, marker in (("start", "s"), ("tuned", "*")):
        found = _place(sound, summary["start" if design == "start" else "weights"])
        if found is not None:
            x, y = increment[found], error[found]
            axes.plot(
                x,
                y,
                marker,
                color=COLOURS[design],
                markersize=13,
                label=design,
                linestyle="none",
                zorder=5,
            )
    axes.set(
        xlabel=f"worst RMS control increment [{summary['machine']['control_unit']} per sample]",
        ylabel=f"worst RMS {summary['error']} error [um]",
        xscale="log",
        yscale="log",
        title="Trade-off over training contours and family (smooth machine)",
    )
    for one in (axes.xaxis, axes.yaxis):
        _plain_ticks(one)
    axes.grid(color="0.9", which="both")
    figure.legend(loc="outside lower center", ncols=3, frameon=False, markerscale=0.6)
    return figure


def _plain_ticks(axis) -> None:
    """1, 2, 5, 10 instead of powers; closer within a decade."""
    low, high = axis.get_view_interval()
    steps = (1.0, 2.0, 5.0) if high > 4 * low else tuple(np.arange(10, 100) / 10)
    axis.set_major_locator(LogLocator(subs=steps, numticks=8))
    axis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axis.set_minor_formatter("")


def _edge(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Indices of the points that no other beats in both, by growing x."""
    order = np.lexsort((y, x))
    before = np.minimum.accumulate(np.append(np.inf, y[order]))[:-1]
    return order[y[order] < before]


def _place(points: list[dict[str, Any]], weights: dict[str, Any]) -> int | None:
    named = {name: value for name, value in weights.items() if value is not None}
    same = [
        k
        for k, p in enumerate(points)
        if all(np.allclose(p[name], value, rtol=1e-9) for name, value in named.items())
    ]
    return same[0] if same else None


def _round(factor: float) -> float:
    """The largest of 1, 2, 5, 10, 20, ... that is not above the factor, and at least 1."""
    if not factor > 1:
        return 1.0
    decade = 10 ** np.floor(np.log10(factor))
    return float(decade * max(step for step in (1, 2, 5) if step <= factor / decade))


def _saved(path: Path, draw: Callable[[], Figure]) -> Path:
    figure = draw()
    try:
        return write(path, lambda temporary: figure.savefig(temporary, dpi=DOTS))
    finally:
        plt.close(figure)
