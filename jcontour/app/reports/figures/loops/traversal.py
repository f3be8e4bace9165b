"""Figures of a run that chose its own speed: signals along the path, and the path itself."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from jcontour.app.reports.figures.shared.axes import DESIRED, grid

MAGNIFIED = 0.06  # of the path's size: how large the largest error is drawn


def signals_figure(signals: Any, control_unit: str, title: str) -> Figure:
    """Speed, contour error and controls along the path."""
    figure = Figure(figsize=(8.0, 7.0), layout="constrained")
    rows = figure.subplots(3, 1, sharex=True)
    drawn = (
        (signals.speed_mm_s, "path speed [mm/s]"),
        (signals.contour_error_um, "contour error [um]"),
        (signals.control, f"control [{control_unit}]"),
    )
    for axes, (values, label) in zip(rows, drawn, strict=True):
        axes.plot(signals.arc_mm, values, linewidth=0.9)
        axes.set(ylabel=label)
        axes.grid(color="0.9")
        axes.margins(x=0.01)
    rows[0].set(title=title)
    rows[-1].set(xlabel="along the path [mm]")
    return figure


def path_figure(signals: Any, path_mm: np.ndarray, foot_mm: np.ndarray, title: str) -> Figure:
    """The path in the plane of its first two axes: the tool magnified beside it, and its speed.

    Args:
        signals: of the run.
        path_mm: (K, m) points of the whole path.
        foot_mm: (T, m) point of the path nearest to the tool.
        title: of the figure.
    """
    figure = Figure(figsize=(10.0, 5.0), layout="constrained")
    left, right = figure.subplots(1, 2)
    _draw_tool(left, signals.tool_mm, path_mm, foot_mm)
    right.plot(*_plane(path_mm), color=DESIRED, linewidth=0.8, linestyle="--")
    x, y = _plane(foot_mm)
    shown = right.scatter(x, y, c=signals.speed_mm_s, s=4, cmap="viridis")
    figure.colorbar(shown, ax=right, label="path speed [mm/s]")
    grid(right, "speed along the path", "X [mm]", "Y [mm]")
    for axes in (left, right):
        axes.set_aspect("equal", adjustable="datalim")
    figure.suptitle(title)
    return figure


def magnification(tool_mm: np.ndarray, path_mm: np.ndarray, foot_mm: np.ndarray) -> float:
    """Round factor that draws the largest error as a small part of the path's size."""
    size = float(np.ptp(path_mm, axis=0).max())
    error = float(np.linalg.norm(tool_mm - foot_mm, axis=1).max())
    if not (error > 0 and size > 0):
        return 1.0
    factor = max(MAGNIFIED * size / error, 1.0)
    step = 10.0 ** np.floor(np.log10(factor))
    return float(np.floor(factor / step) * step)


def _draw_tool(axes: Axes, tool_mm: np.ndarray, path_mm: np.ndarray, foot_mm: np.ndarray) -> None:
    factor = magnification(tool_mm, path_mm, foot_mm)
    axes.plot(*_plane(path_mm), color=DESIRED, linewidth=0.8, linestyle="--", label="path")
    axes.plot(*_plane(foot_mm + factor * (tool_mm - foot_mm)), linewidth=1.0, label="tool")
    how = "true to scale" if factor == 1 else f"drawn {factor:g} times larger"
    grid(axes, f"contour error {how}", "X [mm]", "Y [mm]")
    axes.legend(loc="best", frameon=False)


def _plane(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The first two axes; a single axis over zero."""
    return points[:, 0], points[:, 1] if points.shape[1] > 1 else np.zeros(len(points))
