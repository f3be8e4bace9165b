"""Figures of searches: points tried, fronts, ranks, sensitivity of the family."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from jcontour.app.files.results.search_results import BudgetPoint, FrontResult, RankedResult
from jcontour.app.reports.figures.axes import (
    COLOURS,
    OTHER,
    TUNED,
    grid,
    legend_below,
    logarithmic,
    plain_ticks,
)

ROW = 0.32  # [inch]


def front(result: FrontResult) -> Figure:
    """Least worst error of every budget; or the largest of the family at every feed.

    A filled marker is a budget that is used up, a square one that is slack, an open marker one that
    no weights met.
    """
    figure = Figure(figsize=(7.0, 5.0), layout="constrained")
    axes, feeds = figure.subplots(), result.against == "feed"
    # a loop that is not stable has no finite peak, and no place here
    points = [point for point in result.points if (point.spent(result.against) < float("inf"))]
    met = [point for point in points if point.feasible]
    kept, beyond = "tuned for this budget", "budget not met"
    if feeds:
        kept, beyond = "within every limit", "beyond a limit"
    kinds = {
        kept: ("o", TUNED, [point for point in met if not point.slack]),
        "budget is slack": ("s", TUNED, [point for point in met if point.slack]),
        beyond: ("o", "none", [point for point in points if not point.feasible]),
    }
    axes.plot(*_places(met, result), color=TUNED, linewidth=1.0)
    for label, (marker, face, shown) in kinds.items():
        if shown:
            axes.plot(*_places(shown, result), marker, color=TUNED, mfc=face, label=label)
    unit = result.machine.control_unit
    against = {
        "increment": f"worst RMS control increment [{unit} per sample]",
        "sensitivity": "largest peak sensitivity Ms",
        "feed": "cycle time [s]",
    }
    plants = "the nominal plant" if result.nominal_only else "contours and family"
    title = f"Front over {plants} (smooth machine)"
    if feeds:
        title = f"{result.contour} on {result.machine.name}, {result.controller}"
        for point, x, y in zip(points, *_places(points, result), strict=True):
            place = {"xytext": (2, 4), "textcoords": "offset points"}
            axes.annotate(f"{point.budget:g} %", (x, y), fontsize=8, **place)
    measure = "peak" if feeds else "RMS"
    grid(axes, title, against[result.against], f"worst {measure} {result.error} error [um]")
    logarithmic(axes)
    legend_below(figure)
    return figure


def _places(points: Sequence[BudgetPoint], result: FrontResult) -> tuple[list[float], list[float]]:
    spent = [point.spent(result.against) for point in points]
    return spent, [1e6 * result.height(point) for point in points]


def ranking_figure(result: RankedResult) -> Figure:
    """A bar to the geometric mean over held-out contours, a dot for each of them.

    An open bar is a controller beyond a limit; those that failed are not drawn.
    """
    rows = [row for row in result.rows if row.failure is None and row.held_out][::-1]
    figure = Figure(figsize=(7.5, 1.8 + ROW * max(len(rows), 1)), layout="constrained")
    axes = figure.subplots()
    kinds = {
        "geometric mean": (TUNED, [k for k, row in enumerate(rows) if row.feasible]),
        "beyond a limit": ("none", [k for k, row in enumerate(rows) if not row.feasible]),
    }
    for label, (face, places) in kinds.items():
        if places:
            typical = [1e6 * (rows[k].held_out or 0.0) for k in places]
            axes.barh(places, typical, 0.6, color=face, edgecolor=TUNED, label=label)
    errors = [
        (1e6 * e, k) for k, row in enumerate(rows) for e in (row.held_out_errors or {}).values()
    ]
    if errors:
        axes.plot(*zip(*errors, strict=True), "o", ms=4, mfc=OTHER, mec="0.25", label="one contour")
    axes.set_yticks(range(len(rows)), [row.label for row in rows])
    grid(
        axes,
        title=f"{result.machine.name}: held-out contours after {result.evaluations} evaluations",
        x=f"worst RMS {result.error} error of the family [um]",
        y="",
    )
    if rows:
        axes.set_xscale("log")
        smallest = min(error for error, _ in errors)
        axes.set_xlim(left=0.7 * smallest)
        plain_ticks(axes.xaxis)
        legend_below(figure)
    return figure


class FamilyCurves(NamedTuple):
    """Sensitivity over frequency."""

    frequency: Float[np.ndarray, " F"]  # [Hz]
    # of every plant, the largest of all probes; NaN for a plant with a loop that is not stable
    sensitivity: Float[np.ndarray, "P F"]


def sensitivity_figure(curves: Mapping[str, FamilyCurves], bound: float | None) -> Figure:
    """One thin line for each plant, a thick one for the largest of all.

    Args:
        curves: by the name of the design.
        bound: that the tuner kept; None without.
    """
    figure = Figure(figsize=(7.0, 4.2), layout="constrained")
    axes = figure.subplots()
    for design, (frequency, sensitivity) in curves.items():
        colour, stable = COLOURS[design], np.isfinite(sensitivity).all(axis=1)
        axes.plot(frequency, sensitivity[stable].T, color=colour, linewidth=0.5, alpha=0.4)
        if stable.any():
            label = f"{design}, largest of the family"
            axes.plot(frequency, sensitivity[stable].max(axis=0), color=colour, label=label)
        if not stable.all():
            count = f"{(~stable).sum()} of {stable.size}"
            axes.plot([], [], color=colour, label=f"{design}: {count} plants not stable, not drawn")
    if bound is not None:
        axes.axhline(bound, color="0.3", linestyle="--", linewidth=1.0, label=f"limit {bound:g}")
    logarithmic(axes)
    title = "Sensitivity to disturbances, smooth family; below 1 the loop reduces them"
    grid(axes, title, "frequency [Hz]", "largest singular value of S")
    legend_below(figure)
    return figure
