"""Figures of runs along one contour: where the tool goes, and its errors over time.

Draw your own runs with them:

    from jcontour.app.reports.figures.loops.contour_runs import ContourRuns
    from jcontour.app.reports.figures.loops.contours import contour_figure
    from jcontour.app.reports.figures.loops.errors import error_figure
    from jcontour.simulation.closed_loop import simulate

    rollout = simulate(plant, controller, reference)
    runs = ContourRuns.of(reference, {"mine": rollout}, name="circle")
    contour_figure(runs).savefig("contour.png")
    error_figure(runs).savefig("errors.png")

Signals are in SI units, figures in mm and um.
"""

from collections.abc import Sequence
from itertools import chain

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from jcontour.app.reports.figures.loops.coloured_error import detailed, draw_coloured
from jcontour.app.reports.figures.loops.contour_runs import ContourRuns, DrawnRun
from jcontour.app.reports.figures.loops.errors import error_figure
from jcontour.app.reports.figures.loops.magnified_error import TRUE, draw_magnified
from jcontour.app.reports.figures.loops.way import draw_way
from jcontour.app.reports.figures.shared.axes import colours_of, grid, legend_below, short

PANEL = 4.2  # inches: width of one contour
BAR = 0.9  # inches: width of a scale of colours
TITLE = 0.5  # inches: height of a panel's title
TITLES = 0.9  # inches: height of the figure's title and legend
DIVERGED = "diverged"
FLAT = 0.3  # height to width of a contour: below it panels lie above each other
FLATTEST_AND_TALLEST = (0.17, 1.2)  # height to width of one contour's panel: room for ticks
NARROWEST = 0.7  # width to height of what a panel shows: a title of 45 letters fits above


def figures_of(runs: ContourRuns) -> dict[str, Figure]:
    """Both figures by their names, after the contour; a single axis has no plane to draw."""
    made = {f"errors-{runs.name}": error_figure(runs)}
    if len(runs.axes) > 1:
        made[f"contour-{runs.name}"] = contour_figure(runs)
    return made


def contour_figure(runs: ContourRuns) -> Figure:
    """The contour in the plane of its first two axes, with the error drawn larger than it is.

    Every run has a panel. Runs of one plant have one magnification, so that they compare; the title
    says how large it is. Where there are many details or passes, colours of the tool's line tell
    its error instead.
    """
    panels = [[(run, row) for run in row] for row in runs.rows]
    shape, wide = _height_to_width(runs), PANEL
    if shape < FLAT:
        panels, wide = [[one] for row in panels for one in row], 2 * PANEL
    elif all(len(row) == 1 for row in panels):
        panels = [[one for row in panels for one in row]]
    height, width = len(panels), len(panels[0])
    size = ((wide + BAR * detailed(runs)) * width, (wide * shape + TITLE) * height + TITLES)
    figure = Figure(figsize=size, layout="compressed")
    places = figure.subplots(height, width, sharex=True, sharey=True, squeeze=False)
    colours = colours_of([run.label for run in runs.rows[0]])
    words = []
    for place, (run, row) in zip(places.ravel(), chain.from_iterable(panels), strict=True):
        words.append(_draw_panel(place, runs, run, row, colours[run.label]))
        place.label_outer(remove_inner_ticks=True)
    _make_room(places[0, 0])
    figure.suptitle(f"{short(runs.name)}: contour and tool{_how(runs, words)}")
    legend_below(figure, columns=4)
    return figure


def _how(runs: ContourRuns, words: Sequence[str]) -> str:
    """How the error is shown, for the title; `words` are those of the panels."""
    if detailed(runs):
        return ", coloured by its error"
    return ", contour error magnified" if {*words} - {TRUE, DIVERGED} else ""


def _height_to_width(runs: ContourRuns) -> float:
    """Of a panel: that of the contour, within what a page can show."""
    contour = runs.shown(runs.reference)[:, :2]
    width, height = np.nanmax(contour, axis=0) - np.nanmin(contour, axis=0)
    return float(np.clip(height / width, *FLATTEST_AND_TALLEST)) if width > 0 else 1.0


def _make_room(axes: Axes) -> None:
    """Room beside a tall contour, so that titles of panels side by side stay apart.

    Likewise above and below a flat one, as a line along X is, for ticks. Scales stay equal.
    """
    (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
    missing = NARROWEST * (high - low) - (right - left)
    if missing > 0:
        axes.set_xlim(left - missing / 2, right + missing / 2)
    missing = FLATTEST_AND_TALLEST[0] * (right - left) - (high - low)
    if missing > 0:
        axes.set_ylim(low - missing / 2, high + missing / 2)


def _draw_panel(
    axes: Axes, runs: ContourRuns, run: DrawnRun, row: Sequence[DrawnRun], colour: str
) -> str:
    """Draw a run; how its error is shown, in words."""
    draw_way(axes, runs)
    draw = draw_coloured if detailed(runs) else draw_magnified
    words = DIVERGED if run.diverged else draw(axes, runs, run, row, colour)
    x, y = runs.axes[:2]
    grid(axes, f"{run.label}, {run.plant}\n{words}", f"{x} [mm]", f"{y} [mm]")
    axes.set_aspect("equal", adjustable="box")
    return words
