"""Figures of one loop: errors over time, feeds, laps, and a run that chose its own speed."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from jcontour.app.files.results.bound_results import LearnedResult, ToleranceResult
from jcontour.app.files.results.loop_results import FeedResult
from jcontour.app.reports.figures.axes import (
    CYCLE,
    DESIRED,
    START,
    TUNED,
    grid,
    legend_below,
    logarithmic,
    plain_ticks,
)
from jcontour.motion.references import Reference

SHIFTS = tuple(colour for colour in CYCLE if colour not in (START, TUNED))  # of axes
MAGNIFIED = 0.06  # of the path's size: how large the largest error is drawn


@dataclass(frozen=True)
class BentRuns:
    """A correction, and errors with and without it.

    Attributes:
        name: of contour, machine and controller, in words.
        error: the error that counts, "contour" or "tracking".
        axes: names of the m axes.
        time: (T,) [s].
        scored: (T,) which samples count.
        correction: (T, m) [m].
        before, after: size of the error of every plant, the nominal one first (P, T) [m].
    """

    name: str
    error: str
    axes: Sequence[str]
    time: np.ndarray
    scored: np.ndarray
    correction: np.ndarray
    before: np.ndarray
    after: np.ndarray


def bent_figure(runs: BentRuns) -> Figure:
    """Errors of the nominal plant thick, of the family thin."""
    figure = Figure(figsize=(8.0, 6.0), layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True)
    for axis, shift, colour in zip(runs.axes, runs.correction.T, SHIFTS, strict=False):
        label = f"shift of {axis}"
        upper.plot(runs.time, 1e6 * shift, color=colour, linewidth=1.0, label=label)
    grid(upper, runs.name, "", "correction [um]")
    shown: Mapping[str, tuple[np.ndarray, str]] = {
        "reference as it is": (runs.before, START),
        "bent reference": (runs.after, TUNED),
    }
    for label, (errors, colour) in shown.items():
        sizes = np.where(runs.scored, 1e6 * errors, np.nan)
        lower.plot(runs.time, sizes[1:].T, color=colour, linewidth=0.4, alpha=0.5)
        lower.plot(runs.time, sizes[0], color=colour, linewidth=1.2, label=f"{label}, nominal")
    counted = np.stack([runs.before, runs.after])[..., runs.scored]
    if (counted > 0).any():  # an exactly followed part has no logarithm
        lower.set_yscale("log")
        lower.set_ylim(bottom=max(1e-3, 1e2 * float(np.nanmax(counted[0]))))
    grid(lower, "thin: the other plants of the family", "time [s]", f"{runs.error} error [um]")
    legend_below(figure)
    return figure


@dataclass(frozen=True)
class CertifiedErrors:
    """Errors of one contour on one plant.

    Attributes:
        name: of contour and plant, in words.
        error: the error that counts, "contour" or "tracking".
        time: [s].
        bound: proven at every sample [m].
        reached: under the attack on the worst sample [m].
        nominal: without disturbance [m].
        scored: which samples count.
    """

    name: str
    error: str
    time: np.ndarray
    bound: np.ndarray
    reached: np.ndarray
    nominal: np.ndarray
    scored: np.ndarray


def certificate_figure(errors: CertifiedErrors) -> Figure:
    """Bound above, attacked error below it: they meet at the sample that is attacked."""
    figure = Figure(figsize=(8.0, 4.2), layout="constrained")
    axes = figure.subplots()
    for label, values, colour in (
        ("bound, proven", errors.bound, START),
        ("reached under attack", errors.reached, TUNED),
        ("undisturbed", errors.nominal, DESIRED),
    ):
        shown = np.where(errors.scored, 1e6 * values, np.nan)
        axes.plot(errors.time, shown, color=colour, label=label, linewidth=1.0)
    axes.set_ylim(bottom=0.0)
    grid(axes, errors.name, "time [s]", f"{errors.error} error [um]")
    legend_below(figure)
    return figure


def kept_figure(
    result: ToleranceResult, reference: Reference, errors: Sequence[np.ndarray]
) -> Figure:
    """Runs within the bounds thick, those of other plants thin; the tolerance dashed."""
    figure = Figure(figsize=(8.0, 4.6), layout="constrained")
    axes = figure.subplots()
    scored = np.asarray(reference.mask)[: reference.steps]
    time = reference.dt * np.arange(reference.steps)
    for number, (run, error) in enumerate(zip(result.runs, errors, strict=True)):
        shown = np.where(scored, 1e6 * error, np.nan)
        label = f"{run.plant}, {run.disturbance}"
        axes.plot(
            time, shown, color=f"C{number}", linewidth=1.0 if run.within else 0.5, label=label
        )
    promised = 1e6 * result.promised
    axes.axhline(promised, color="0.2", linestyle="--", linewidth=1.0, label="promised")
    axes.set_ylim(bottom=0.0)
    title = f"{result.contour} on {result.machine.name}: promised {promised:.4g} um"
    grid(axes, title, "time [s]", f"{result.error} error [um]")
    legend_below(figure)
    return figure


def feeds_figure(result: FeedResult) -> Figure:
    """Peak and RMS of the family's worst, and the nominal RMS; the recommended feed is ringed."""
    figure = Figure(figsize=(7.0, 4.8), layout="constrained")
    axes = figure.subplots()
    points = [point for point in result.points if not point.diverged]
    time = [point.cycle_time for point in points]
    for label, plant, name, style in (
        ("peak, worst of the family", "worst", "peak", "o-"),
        ("RMS, worst of the family", "worst", "rms", "s-"),
        ("RMS, nominal", "nominal", "rms", "^--"),
    ):
        metric = f"{name}_{result.error}_error"
        error = [1e6 * getattr(getattr(point.metrics, plant), metric) for point in points]
        axes.plot(time, error, style, markersize=4, linewidth=1.0, label=label)
        if label.startswith("peak"):
            for point, at, height in zip(points, time, error, strict=True):
                words = f"{point.override:g} %" + ("" if point.sound else ", beyond limits")
                place = {"xytext": (2, 4), "textcoords": "offset points"}
                axes.annotate(words, (at, height), rotation=50, fontsize=8, **place)
                if point.override == result.recommended:
                    ring = {"markersize": 12, "mfc": "none", "color": TUNED}
                    axes.plot([at], [height], "o", label="recommended", **ring)
    if result.tolerance is not None:
        tolerance = 1e6 * result.tolerance
        axes.axhline(tolerance, color="0.3", linestyle="--", label=f"tolerance {tolerance:g} um")
    logarithmic(axes)
    axes.margins(x=0.08, y=0.15 if all(point.sound for point in points) else 0.4)  # for the words
    title = f"{result.contour} on {result.machine.name}, {result.controller}"
    grid(axes, title, "cycle time [s]", f"{result.error} error [um]")
    legend_below(figure)
    return figure


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


def learning(result: LearnedResult) -> Figure:
    """RMS error of the tool over laps, and what noise alone makes; a cross where one diverges."""
    figure = Figure(figsize=(7.5, 5.5), layout="constrained")
    axes = figure.subplots()
    for one in result.machines:
        laps = range(1, len(one.tool_um) + 1)
        (line,) = axes.plot(laps, one.tool_um, marker=".", linewidth=1.0, label=one.name)
        if one.diverged is not None:
            axes.plot(laps[-1], one.tool_um[-1], "x", color=line.get_color())
    if result.noise_um > 0:
        axes.axhline(result.noise_um, color="0.5", linestyle=":", label="noise without learning")
    axes.set(yscale="log")
    plain_ticks(axes.yaxis)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    grid(axes, f"{result.law} on {result.contour}", "lap", f"RMS {result.error} error [um]")
    legend_below(figure, columns=2)
    return figure
