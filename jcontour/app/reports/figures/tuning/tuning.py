"""Figures of a tuning run: every point that the tuner tried, and what it trades."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from jcontour.app.files.results.stored import Weight
from jcontour.app.files.results.tuned_result import HistoryPoint, TunedResult
from jcontour.app.reports.figures.shared.axes import (
    COLOURS,
    OTHER,
    grid,
    legend_below,
    logarithmic,
    plain_ticks,
)

DIVERGED = "diverged: rejected, no objective"
MEASURES = {  # objective -> what is made small
    "typical": "geometric mean over contours\nof the worst RMS {error} error [um]",
    "worst": "worst RMS {error} error [um]",
    "mean": "mean RMS {error} error [um]",
    "regret": "largest RMS {error} error\nover the best of its contour",
    "certified": "geometric mean over contours\nof the largest certified {error} error [um]",
}


class Search(NamedTuple):
    """A tuning run as its figures see it.

    Attributes:
        points: that the tuner tried.
        result: of the run.
        objective: its name among the flags.
    """

    points: Sequence[HistoryPoint]
    result: TunedResult
    objective: str = "typical"

    @property
    def measure(self) -> str:
        """What the search makes small, in words with its unit."""
        return MEASURES[self.objective].format(error=self.result.error)

    def measured(self, points: Sequence[HistoryPoint]) -> np.ndarray:
        """Objective of the points, in the unit of `measure`."""
        factor = 1.0 if self.objective == "regret" else 1e6  # a ratio, or [m]
        return factor * np.array([point.objective for point in points], float)


def history_figure(search: Search) -> Figure:
    """Objective of every point tried, and the best feasible one so far.

    Points beyond a limit are hollow. Points that diverged have no objective: they stand above all
    others.
    """
    points = search.points
    figure = Figure(figsize=(7.0, 4.0), layout="constrained")
    axes = figure.subplots()
    index = np.arange(1, len(points) + 1)
    lost = np.array([point.diverged for point in points])
    objective = search.measured(points)
    objective = np.where(lost | ~np.isfinite(objective), np.nan, objective)
    feasible = np.array([point.feasible for point in points], bool)
    for number, descent in enumerate(sorted({point.descent for point in points})):
        chosen = np.array([point.descent == descent for point in points])
        label = "random points" if descent < 0 else f"descent {descent + 1}"
        dots = {"color": f"C{number}", "markersize": 4}
        axes.plot(*_at(chosen & feasible, index, objective), "o", label=label, **dots)
        axes.plot(*_at(chosen & ~feasible, index, objective), "o", mfc="none", **dots)
    if not (feasible | lost).all():
        axes.plot([], [], "o", color=OTHER, mfc="none", markersize=4, label="limit exceeded")
    best = np.fmin.accumulate(np.where(feasible, objective, np.nan))
    axes.plot(index, best, color="0.3", linewidth=1.2, label="best feasible so far")
    if lost.any():
        highest = np.nanmax(objective) if np.isfinite(objective).any() else 1.0
        height = np.full(lost.sum(), 3 * highest)
        axes.plot(index[lost], height, "x", color="tab:red", label=DIVERGED)
    axes.set_yscale("log")
    plain_ticks(axes.yaxis)
    grid(axes, "Points tried (smooth machine)", "evaluated point", search.measure)
    legend_below(figure)
    return figure


def _at(chosen: np.ndarray, *values: np.ndarray) -> list[np.ndarray]:
    return [value[chosen] for value in values]


def trade_off_figure(search: Search) -> Figure:
    """What the search makes small against the worst control increment, of all points that ran.

    The line is the lower left edge of those within the limits; the tuned point is its lowest.
    """
    ran = [one for one in search.points if not one.diverged and np.isfinite(one.objective)]
    points, result = ran, search.result
    figure = Figure(figsize=(7.0, 5.0), layout="constrained")
    axes = figure.subplots()
    increment = np.array([point.rms_increment for point in points])
    error = search.measured(points)
    within = np.array([point.feasible for point in points], bool)
    dots = {"color": OTHER, "markersize": 5}
    label = "evaluated, within the limits"
    axes.plot(increment[within], error[within], "o", label=label, **dots)
    if not within.all():
        label = "evaluated, limit exceeded"
        axes.plot(increment[~within], error[~within], "o", mfc="none", label=label, **dots)
    x, y = lower_left_edge(increment[within], error[within])
    axes.step(x, y, where="post", color="0.3", linewidth=1.0, label="front of these")
    _mark(axes, "start", "s", place_of(points, result.start), increment, error)
    _mark(axes, "tuned", "*", place_of(points, result.weights), increment, error)
    logarithmic(axes)
    unit = result.machine.control_unit
    grid(
        axes,
        "Trade-off over training contours and family (smooth machine)",
        f"worst RMS control increment [{unit} per sample]",
        search.measure,
    )
    legend_below(figure)
    return figure


def _mark(
    axes: Axes, design: str, marker: str, place: int | None, x: np.ndarray, y: np.ndarray
) -> None:
    if place is not None:
        style = {"color": COLOURS[design], "markersize": 10, "linestyle": "none", "zorder": 5}
        axes.plot(x[place], y[place], marker, label=design, **style)


def lower_left_edge(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points that no other beats in both coordinates, by growing x."""
    order = np.lexsort((y, x))
    before = np.minimum.accumulate(np.append(np.inf, y[order]))[:-1]
    edge = order[y[order] < before]
    return x[edge], y[edge]


def place_of(points: Sequence[HistoryPoint], weights: dict[str, Weight]) -> int | None:
    """First point with these weights; None where there is none, as of another controller."""
    wanted = {name: np.asarray(value) for name, value in weights.items() if value is not None}
    for k, point in enumerate(points):
        if not wanted.keys() <= point.weights.keys():
            return None
        tried = {name: np.asarray(point.weights[name]) for name in wanted}
        if all(np.allclose(tried[name], wanted[name], rtol=1e-9) for name in wanted):
            return k
    return None


FIGURES = {"history": history_figure, "trade_off": trade_off_figure}
