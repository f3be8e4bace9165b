"""Figures of runs along one contour: where the tool goes, and its errors over time.

Draw your own runs with them:

    from jcontour.app.reports.figures.contours import ContourRuns, contour_figure, error_figure
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

from jcontour.app.reports.figures.axes import (
    DESIRED,
    OTHER,
    WORDS,
    colours_of,
    draw_curve,
    grid,
    legend_below,
    long,
    short,
)
from jcontour.motion.references import Reference
from jcontour.simulation.closed_loop import Rollout
from jcontour.simulation.metrics import contour_error

NOMINAL = "nominal plant"
MAGNIFIED = 0.06  # of the contour's size: how large the largest error is drawn
ROUNDING = 1e-12  # of the largest coordinate: an error below it is none
TRUE = "error true to scale"
PANEL = 4.2  # inches: width of one contour
TITLE = 0.5  # inches: height of a panel's title
TITLES = 0.9  # inches: height of the figure's title and legend
DIVERGED = "diverged"
FLAT = 0.3  # height to width of a contour: below it panels lie above each other
FLATTEST_AND_TALLEST = (0.17, 1.2)  # height to width of one contour's panel: room for ticks
NARROWEST = 0.7  # width to height of what a panel shows: a title of 45 letters fits above


@dataclass(frozen=True)
class DrawnRun:
    """Signals of one run."""

    label: str  # of the controller or its weights; it chooses the colour
    plant: str  # it ran on, in words
    output: np.ndarray  # (T, m) [m]
    control: np.ndarray  # (T, p) [control unit]
    contour_error: np.ndarray  # (T, m) [m], from the nearest point of the contour to the tool
    diverged: bool = False  # its error means nothing


@dataclass(frozen=True)
class ContourRuns:
    """Runs along one contour."""

    name: str  # of the contour
    time: np.ndarray  # (T,) [s]
    scored: np.ndarray  # (T,) which samples count
    reference: np.ndarray  # (T, m) [m]
    axes: tuple[str, ...]  # names of the m axes
    control_unit: str  # for labels
    # runs to compare with each other, such as those on the nominal plant
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


def draw_way(axes: Axes, runs: ContourRuns) -> None:
    """The contour [mm] where it counts, its first point, and rapid moves."""
    desired = 1e3 * runs.shown(runs.reference)[:, :2]
    axes.plot(*desired.T, color=DESIRED, linewidth=0.8, linestyle="--", label="contour")
    place, counts = 1e3 * runs.reference[:, :2], runs.scored
    between = counts.copy()
    between[1:-1] &= counts[:-2] & counts[2:]  # up to the cuts on both sides
    if runs.rapids:
        beside = np.where(between[:, None], np.nan, place).T
        axes.plot(*beside, color=OTHER, linewidth=0.8, linestyle=":", label="rapid")
    axes.plot(*place[counts.argmax()], "o", color="black", markersize=3.5, label="first point")


def draw_magnified(
    axes: Axes, runs: ContourRuns, run: DrawnRun, row: Sequence[DrawnRun], colour: str
) -> str:
    """Draw the tool; the magnification in words, the same for all runs of a row."""
    desired = runs.shown(runs.reference)[:, :2]
    errors = [runs.shown(one.contour_error)[:, :2] for one in row if not one.diverged]
    factor = min((magnification(desired, error) for error in errors), default=1.0)
    # Nearest points of the contour to the tool [mm], in the plane (T, 2)
    tool = (1e3 * runs.shown(run.output - run.contour_error)[:, :2]) + factor * 1e3 * runs.shown(
        run.contour_error
    )[:, :2]
    axes.plot(*tool.T, color=colour, linewidth=1.0, label=run.label)
    return TRUE if factor == 1 else f"error x {factor:g}"


def magnification(desired: np.ndarray, error: np.ndarray) -> float:
    """1, 2, 5, 10, ...: the largest error becomes about `MAGNIFIED` of the contour's size."""
    size = float(np.nanmax(np.nanmax(desired, axis=0) - np.nanmin(desired, axis=0)))
    finite = np.abs(error[np.isfinite(error)])
    largest = float(finite.max()) if finite.size else 0.0
    if not ROUNDING * float(np.nanmax(np.abs(desired))) < largest < size:
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
        alone = len(runs.axes) == 1
        first = "tool [mm]" if alone else "contour error [um]"
        labels = (first, "tracking error [um]", f"increment [{runs.control_unit}]")
        colours = colours_of([run.label for run in row])
        for run in row:
            legend = f"{run.label}, {run.plant}{', diverged' if run.diverged else ''}"
            # Signals drawn over time: contour error or tool, tracking error, increment
            contour = 1e6 * np.linalg.norm(run.contour_error, axis=-1)
            tracking = 1e6 * np.linalg.norm(run.output - runs.reference, axis=-1)
            increment = np.linalg.norm(np.diff(run.control, axis=0), axis=-1)
            for axes, signal in zip(
                column,
                (
                    1e3 * run.output[:, 0] if alone else contour,
                    tracking,
                    np.append(increment, np.nan),
                ),
                strict=True,
            ):
                draw_curve(axes, runs.time, runs.shown(signal), colours[run.label], 0.8, legend)
        if alone:
            desired = 1e3 * runs.shown(runs.reference)[:, 0]
            column[0].plot(runs.time, desired, color=DESIRED, linewidth=0.8, linestyle="--")
        for axes, label in zip(column, labels, strict=True):
            grid(axes, y=label)
        used = runs.time[runs.scored]
        column[-1].set(xlabel="time [s]", xlim=(used[0], used[-1]))
        column[0].legend(frameon=False, loc="lower left", bbox_to_anchor=(0.0, 1.0))
    left_out = ", without rapid moves" if runs.rapids else ""
    words = f" ({WORDS})" if long(runs.time.size) else ""
    figure.suptitle(f"{short(runs.name)}: scored samples{left_out}{words}")
    return figure


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
    # Height to width of a panel: that of the contour, within what a page can show
    contour, wide = runs.shown(runs.reference)[:, :2], PANEL
    across, along = np.nanmax(contour, axis=0) - np.nanmin(contour, axis=0)
    shape = float(np.clip(along / across, *FLATTEST_AND_TALLEST)) if across > 0 else 1.0
    if shape < FLAT:
        panels, wide = [[one] for row in panels for one in row], 2 * PANEL
    elif all(len(row) == 1 for row in panels):
        panels = [[one for row in panels for one in row]]
    height, width = len(panels), len(panels[0])
    size = (wide * width, (wide * shape + TITLE) * height + TITLES)
    figure = Figure(figsize=size, layout="compressed")
    places = figure.subplots(height, width, sharex=True, sharey=True, squeeze=False)
    colours = colours_of([run.label for run in runs.rows[0]])
    words = []
    for place, (run, row) in zip(places.ravel(), chain.from_iterable(panels), strict=True):
        draw_way(place, runs)
        colour = colours[run.label]
        how = DIVERGED if run.diverged else draw_magnified(place, runs, run, row, colour)
        words.append(how)
        x, y = runs.axes[:2]
        grid(place, f"{run.label}, {run.plant}\n{how}", f"{x} [mm]", f"{y} [mm]")
        place.set_aspect("equal", adjustable="box")
        place.label_outer(remove_inner_ticks=True)
    # Room beside a tall contour, so that titles of panels side by side stay apart
    axes = places[0, 0]
    (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
    missing = NARROWEST * (high - low) - (right - left)
    if missing > 0:
        axes.set_xlim(left - missing / 2, right + missing / 2)
    missing = FLATTEST_AND_TALLEST[0] * (right - left) - (high - low)
    if missing > 0:
        axes.set_ylim(low - missing / 2, high + missing / 2)
    how = ", contour error magnified" if {*words} - {TRUE, DIVERGED} else ""
    figure.suptitle(f"{short(runs.name)}: contour and tool{how}")
    legend_below(figure, columns=4)
    return figure
