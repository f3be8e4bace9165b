"""Figures of runs along one contour: where the tool goes, and its errors over time.

Draw your own runs with them:

    from experiments.reports.figures.loops.contours import ContourRuns, contour_figure, error_figure
    from jcontour.simulation.closed_loop import simulate

    rollout = simulate(plant, controller, reference)
    runs = ContourRuns.of(reference, {"mine": rollout}, name="circle")
    contour_figure(runs).savefig("contour.png")
    error_figure(runs).savefig("errors.png")

Signals are in SI units, figures in mm and um.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import chain

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.reports.figures.shared.axes import (
    DESIRED,
    OTHER,
    colours_of,
    grid,
    legend_below,
)
from jcontour.motion.references import Reference
from jcontour.simulation.closed_loop import Rollout
from jcontour.simulation.metrics import contour_error

MAGNIFIED = 0.06  # of the contour's size: how large the largest error is drawn
PANEL = 4.2  # inches: width of one contour
TITLES = 1.2  # inches: height of titles and legend
FLATTEST_AND_TALLEST = (0.4, 1.2)  # height to width of one contour's panel
ARROWS = np.array([0.2, 0.5, 0.8])  # of the way: where arrows show its direction
ARROW = 0.005  # of the way: length of one
ARROW_STYLE = {"arrowstyle": "-|>", "color": DESIRED}
NOMINAL = "nominal plant"


@dataclass(frozen=True)
class DrawnRun:
    """Signals of one run.

    Attributes:
        label: of the controller or its weights; it chooses the colour.
        plant: it ran on, in words.
        output: (T, m) [m].
        control: (T, p) [control unit].
        contour_error: (T, m) [m], from the nearest point of the contour to the tool.
        diverged: its error means nothing.
    """

    label: str
    plant: str
    output: np.ndarray
    control: np.ndarray
    contour_error: np.ndarray
    diverged: bool = False


@dataclass(frozen=True)
class ContourRuns:
    """Runs along one contour.

    Attributes:
        name: of the contour.
        time: (T,) [s].
        scored: (T,) which samples count.
        reference: (T, m) [m].
        axes: names of the m axes.
        control_unit: for labels.
        rows: runs to compare with each other, such as those on the nominal plant.
    """

    name: str
    time: np.ndarray
    scored: np.ndarray
    reference: np.ndarray
    axes: tuple[str, ...]
    control_unit: str
    rows: tuple[tuple[DrawnRun, ...], ...]

    @classmethod
    def of(
        cls,
        reference: Reference,
        rollouts: Mapping[str, Rollout],
        name: str = "contour",
        axes: Sequence[str] = "XYZ",
        control_unit: str = "control unit",
    ) -> "ContourRuns":
        """Rollouts by their labels, along one reference."""
        steps = reference.steps
        runs = []
        for label, rollout in rollouts.items():
            error = np.asarray(contour_error(rollout.output, reference))
            output, control = np.asarray(rollout.output), np.asarray(rollout.control)
            runs.append(DrawnRun(label, NOMINAL, output, control, error))
        position = np.asarray(reference.position)[:steps]
        return cls(
            name,
            reference.dt * np.arange(steps),
            np.asarray(reference.mask)[:steps],
            position,
            tuple(axes)[: position.shape[1]],
            control_unit,
            (tuple(runs),),
        )

    @property
    def runs(self) -> list[DrawnRun]:
        """All of them."""
        return [run for row in self.rows for run in row]

    @property
    def rapids(self) -> bool:
        """Whether moves between scored ones do not count."""
        first, last = np.flatnonzero(self.scored)[[0, -1]]
        return not self.scored[first : last + 1].all()

    def shown(self, signal: np.ndarray) -> np.ndarray:
        """A signal (T, ...) with NaN where samples do not count."""
        scored = self.scored.reshape(-1, *(1,) * (signal.ndim - 1))
        return np.where(scored, signal, np.nan)


def figures_of(runs: ContourRuns) -> dict[str, Figure]:
    """Both figures by their names, after the contour; a single axis has no plane to draw."""
    made = {f"errors-{runs.name}": error_figure(runs)}
    if len(runs.axes) > 1:
        made[f"contour-{runs.name}"] = contour_figure(runs)
    return made


def contour_figure(runs: ContourRuns) -> Figure:
    """The contour in the plane of its first two axes, with the error drawn larger than it is.

    Every run has a panel. Runs of one plant have one magnification, so that they compare; the title
    says how large it is.
    """
    panels = [[(run, row) for run in row] for row in runs.rows]
    if all(len(row) == 1 for row in panels):
        panels = [[one for row in panels for one in row]]
    height, width = len(panels), len(panels[0])
    size = (PANEL * width, PANEL * height * _height_to_width(runs) + TITLES)
    figure = Figure(figsize=size, layout="constrained")
    places = figure.subplots(height, width, sharex=True, sharey=True, squeeze=False)
    colours = colours_of([run.label for run in runs.rows[0]])
    for place, (run, row) in zip(places.ravel(), chain.from_iterable(panels), strict=True):
        _draw_contour(place, runs, run, colours[run.label], _magnification(runs, row))
        place.label_outer(remove_inner_ticks=True)
    figure.suptitle(f"{runs.name}: contour and tool, contour error magnified")
    legend_below(figure, columns=4)
    return figure


def _height_to_width(runs: ContourRuns) -> float:
    """Of a panel: that of the contour, within what a page can show."""
    contour = runs.shown(runs.reference)[:, :2]
    width, height = np.nanmax(contour, axis=0) - np.nanmin(contour, axis=0)
    return float(np.clip(height / width, *FLATTEST_AND_TALLEST)) if width > 0 else 1.0


def _magnification(runs: ContourRuns, compared: Sequence[DrawnRun]) -> float:
    """The one at which every one of these runs stays near the contour."""
    desired = runs.shown(runs.reference)[:, :2]
    errors = [runs.shown(run.contour_error)[:, :2] for run in compared if not run.diverged]
    return min((magnification(desired, error) for error in errors), default=1.0)


def _draw_contour(axes: Axes, runs: ContourRuns, run: DrawnRun, colour: str, factor: float) -> None:
    desired = 1e3 * runs.shown(runs.reference)[:, :2]
    error = 1e3 * runs.shown(run.contour_error)[:, :2]
    x, y = runs.axes[:2]
    axes.plot(*desired.T, color=DESIRED, linewidth=0.8, linestyle="--", label="contour")
    _draw_way(axes, runs)
    if run.diverged:
        grid(axes, f"{run.label}, {run.plant}\ndiverged", f"{x} [mm]", f"{y} [mm]")
    else:
        tool = desired_on_contour(runs, run) + factor * error
        axes.plot(*tool.T, color=colour, linewidth=1.0, label=run.label)
        title = f"{run.label}, {run.plant}\nerror x {factor:g}"
        grid(axes, title, f"{x} [mm]", f"{y} [mm]")
    axes.set_aspect("equal", adjustable="box")


def _draw_way(axes: Axes, runs: ContourRuns) -> None:
    """Where the contour begins, which way it goes, and moves that do not count, as rapid ones."""
    place, counts = 1e3 * runs.reference[:, :2], runs.scored
    between = counts.copy()
    between[1:-1] &= counts[:-2] & counts[2:]  # up to the cuts on both sides
    if runs.rapids:
        beside = np.where(between[:, None], np.nan, place).T
        axes.plot(*beside, color=OTHER, linewidth=0.8, linestyle=":", label="rapid")
    axes.plot(*place[counts.argmax()], "o", color="black", markersize=3.5, label="first point")
    cut = np.flatnonzero(counts)
    begins = np.diff(cut, prepend=cut[0] - 2) > 1  # of every stretch without a rapid move
    steps = np.linalg.norm(np.diff(place[cut], axis=0, prepend=place[cut[:1]]), axis=1)
    way = np.cumsum(np.where(begins, 0.0, steps))
    tips = np.searchsorted(way, way[-1] * ARROWS)
    tails = np.searchsorted(way, way[tips] - ARROW * way[-1], side="right") - 1
    tails = np.maximum(tails, np.maximum.accumulate(np.where(begins, np.arange(cut.size), 0))[tips])
    for tail, tip in zip(cut[tails], cut[tips], strict=True):
        axes.annotate("", tuple(place[tip]), tuple(place[tail]), arrowprops=ARROW_STYLE)


def desired_on_contour(runs: ContourRuns, run: DrawnRun) -> np.ndarray:
    """Nearest points of the contour to the tool [mm], in the plane (T, 2)."""
    return 1e3 * runs.shown(run.output - run.contour_error)[:, :2]


def magnification(desired: np.ndarray, error: np.ndarray) -> float:
    """1, 2, 5, 10, ...: the largest error becomes about `MAGNIFIED` of the contour's size."""
    size = float(np.nanmax(np.nanmax(desired, axis=0) - np.nanmin(desired, axis=0)))
    finite = np.abs(error[np.isfinite(error)])
    largest = float(finite.max()) if finite.size else 0.0
    if not 0 < largest < size:
        return 1.0
    factor = MAGNIFIED * size / largest
    if factor < 1:
        return 1.0
    decade = 10 ** np.floor(np.log10(factor))
    return float(decade * max(step for step in (1, 2, 5) if step <= factor / decade))


def error_figure(runs: ContourRuns) -> Figure:
    """Contour error (of a single axis: its tool), tracking error and control increment over time.

    Every row of runs has a column of its own.
    """
    width = len(runs.rows)
    figure = Figure(figsize=(1.5 + 6.0 * width, 7.0), layout="constrained")
    columns = figure.subplots(3, width, sharex=True, squeeze=False).T
    for column, row in zip(columns, runs.rows, strict=True):
        _draw_errors(column, runs, row)
    left_out = ", without rapid moves" if runs.rapids else ""
    figure.suptitle(f"{runs.name}: scored samples{left_out}")
    return figure


def _draw_errors(column: Sequence[Axes], runs: ContourRuns, row: Sequence[DrawnRun]) -> None:
    alone = len(runs.axes) == 1
    first = "tool [mm]" if alone else "contour error [um]"
    labels = (first, "tracking error [um]", f"increment [{runs.control_unit}]")
    colours = colours_of([run.label for run in row])
    for run in row:
        legend = f"{run.label}, {run.plant}{', diverged' if run.diverged else ''}"
        for axes, signal in zip(column, _errors(runs, run, alone), strict=True):
            shown = runs.shown(signal)
            axes.plot(runs.time, shown, color=colours[run.label], linewidth=0.8, label=legend)
    if alone:
        desired = 1e3 * runs.shown(runs.reference)[:, 0]
        column[0].plot(runs.time, desired, color=DESIRED, linewidth=0.8, linestyle="--")
    for axes, label in zip(column, labels, strict=True):
        grid(axes, y=label)
    used = runs.time[runs.scored]
    column[-1].set(xlabel="time [s]", xlim=(used[0], used[-1]))
    column[0].legend(frameon=False, loc="lower left", bbox_to_anchor=(0.0, 1.0))


def _errors(runs: ContourRuns, run: DrawnRun, alone: bool) -> tuple[np.ndarray, ...]:
    """Signals drawn over time: contour error or tool, tracking error, increment."""
    contour = 1e6 * np.linalg.norm(run.contour_error, axis=-1)
    tracking = 1e6 * np.linalg.norm(run.output - runs.reference, axis=-1)
    increment = np.linalg.norm(np.diff(run.control, axis=0), axis=-1)
    return 1e3 * run.output[:, 0] if alone else contour, tracking, np.append(increment, np.nan)
