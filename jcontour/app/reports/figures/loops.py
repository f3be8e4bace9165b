"""Figures of one loop: errors over time, and laps."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from jcontour.app.files.results.loop_results import CauseShare, LearnedResult
from jcontour.app.reports.figures.axes import (
    CYCLE,
    DESIRED,
    START,
    TUNED,
    draw_curve,
    grid,
    legend_below,
    plain_ticks,
    short,
)
from jcontour.app.reports.figures.contours import ContourRuns
from jcontour.motion.references import Reference
from tuning.identification.error_causes import Shares

SHIFTS = tuple(colour for colour in CYCLE if colour not in (START, TUNED))  # of axes
SHOWN = 4  # causes, the largest


def bent_figure(
    title: str,
    error: str,
    axes: Sequence[str],
    reference: Reference,
    correction: np.ndarray,
    before: np.ndarray,
    after: np.ndarray,
) -> Figure:
    """Correction of a reference over time, and the errors with and without it.

    Errors of the nominal plant are thick, those of the family thin.

    Args:
        title: contour, machine and controller.
        error: that counts, "contour" or "tracking".
        axes: names of the m axes.
        reference: as it was.
        correction: (T, m) [m].
        before: size of the error of every plant, the nominal one first (P, T) [m].
        after: the same along the bent reference.
    """
    figure = Figure(figsize=(8.0, 6.0), layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True)
    time, scored = _scored(reference)
    for axis, shift, colour in zip(axes, correction.T, SHIFTS, strict=False):
        upper.plot(time, 1e6 * shift, color=colour, linewidth=1.0, label=f"shift of {axis}")
    grid(upper, title, "", "correction [um]")
    shown: Mapping[str, tuple[np.ndarray, str]] = {
        "reference as it is": (before, START),
        "bent reference": (after, TUNED),
    }
    for label, (errors, colour) in shown.items():
        sizes = np.where(scored, 1e6 * errors, np.nan)
        lower.plot(time, sizes[1:].T, color=colour, linewidth=0.4, alpha=0.5)
        lower.plot(time, sizes[0], color=colour, linewidth=1.2, label=f"{label}, nominal")
    counted = np.stack([before, after])[..., scored]
    if (counted > 0).any():  # an exactly followed part has no logarithm
        lower.set_yscale("log")
        lower.set_ylim(bottom=max(1e-3, 1e2 * float(np.nanmax(counted[0]))))
    grid(lower, "thin: the other plants of the family", "time [s]", f"{error} error [um]")
    legend_below(figure)
    return figure


class ErrorCurve(NamedTuple):
    """An error at every sample (T,) [m], with its style."""

    label: str
    error: np.ndarray
    colour: str
    width: float = 1.0


def errors_figure(
    title: str, error: str, reference: Reference, curves: Sequence[ErrorCurve]
) -> Figure:
    """Errors over time where samples count.

    Args:
        title: of the figure.
        error: that counts, "contour" or "tracking".
        reference: of the runs.
        curves: errors of the runs, or bounds on them.
    """
    figure = Figure(figsize=(8.0, 4.6), layout="constrained")
    axes = figure.subplots()
    time, scored = _scored(reference)
    for curve in curves:
        shown = np.where(scored, 1e6 * curve.error, np.nan)
        axes.plot(time, shown, color=curve.colour, linewidth=curve.width, label=curve.label)
    axes.set_ylim(bottom=0.0)
    grid(axes, title, "time [s]", f"{error} error [um]")
    legend_below(figure)
    return figure


def _scored(reference: Reference) -> tuple[np.ndarray, np.ndarray]:
    """Times of the samples [s], and which of them count."""
    steps = reference.steps
    return reference.dt * np.arange(steps), np.asarray(reference.mask)[:steps]


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
    grid(axes, f"Laps on {result.contour}", "lap", f"RMS {result.error} error [um]")
    legend_below(figure, columns=2)
    return figure


def causes_figure(runs: ContourRuns, shares: Shares, causes: Sequence[CauseShare]) -> Figure:
    """The error, below it the part that each of the largest causes has, and what is unexplained."""
    rows = [*range(min(SHOWN, len(causes) - 1)), len(causes) - 1]
    figure = Figure(figsize=(9.0, 2.0 + 1.5 * len(rows)), layout="constrained")
    above, *panels = figure.subplots(1 + len(rows), 1, sharex=True)
    draw_curve(above, runs.time, runs.shown(1e6 * shares.along.sum(axis=0)), DESIRED, 0.8, "error")
    grid(above, f"{short(runs.name)}: measured error and its causes", "", "error [um]")
    for row, axes, colour in zip(rows, panels, CYCLE, strict=False):
        part = runs.shown(1e6 * shares.along[row])
        draw_curve(axes, runs.time, part, colour, 0.8, causes[row].text)
        grid(axes, causes[row].text, "", "um")
    panels[-1].set_xlabel("time [s]")
    return figure
