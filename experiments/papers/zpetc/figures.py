"""Figures of Smith & Lee, drawn from a result."""

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from experiments.papers.panels import Curve, Panel, drawn
from experiments.papers.zpetc.experiment import Result
from experiments.papers.zpetc.runs import FAST, FRICTIONS
from jcontour.app.reports.figures.axes import CYCLE, DESIRED, grid, legend_below
from jcontour.plants.three_link import PATH_DURATION, ThreeLink, manipulator_path

INSTANTS = (0.5, 2.0, 3.5)  # [s]: level, high, and low
TICKS = (-0.2, 0.0, 0.2)  # [m]


def manipulator(result: Result) -> Figure:
    """Base joints, legs and platform at three instants; height and tilt of the path."""
    figure = Figure(figsize=(7.6, 4.4), layout="constrained")
    solid: Any = figure.add_subplot(1, 2, 1, projection="3d")
    for colour, instant in zip(CYCLE, INSTANTS, strict=False):
        _draw_legs(solid, instant, colour)
    solid.set_title("Three-link manipulator, radii of ours", fontsize=10)
    solid.set(zlim=(0.0, 0.5), xticks=TICKS, yticks=TICKS)
    for axis in (solid.xaxis, solid.yaxis, solid.zaxis):
        axis.set_tick_params(labelsize=7)
        axis.set_label_text(f"{axis.axis_name} [m]")
    solid.set_box_aspect((1, 1, 1.1), zoom=0.82)
    height, turn = figure.add_subplot(2, 2, 2), figure.add_subplot(2, 2, 4)
    time = FAST * np.arange(len(result.path_mm))
    poses = manipulator_path(time)
    height.plot(time, 1e3 * poses[:, 0], color=DESIRED)
    turn.plot(time, np.rad2deg(poses[:, 1]), color=DESIRED, label="towards leg 0 (x)")
    turn.plot(time, np.rad2deg(poses[:, 2]), color=DESIRED, linestyle="--", label="towards y")
    for axes in (height, turn):
        for colour, instant in zip(CYCLE, INSTANTS, strict=False):
            axes.axvline(instant, color=colour, linewidth=1)
    grid(height, "Path of the platform", y="height [mm]")
    grid(turn, "", "time [s]", "tilt [degrees]")
    legend_below(figure)
    return figure


def _draw_legs(axes: Any, instant: float, colour: str) -> None:
    """The manipulator at an instant of its path."""
    links = ThreeLink()
    pose = manipulator_path(np.array([instant]))[0]
    balls, pins = np.asarray(links.balls(pose)), links.pins()
    around = [0, 1, 2, 0]
    axes.plot(*pins[around].T, color="0.4", linewidth=1)
    axes.plot(*balls[around].T, color=colour, linewidth=2, label=f"at {instant:g} s")
    for pin, ball in zip(pins, balls, strict=True):
        axes.plot(*np.stack([pin, ball]).T, color=colour, linewidth=1)
    axes.scatter(*pins.T, color="0.4", s=16, depthshade=False)
    axes.scatter(*balls.T, color=colour, s=10, depthshade=False)


def figure_7(result: Result) -> Figure:
    """Legs of the manipulator along the path."""
    time = FAST * np.arange(len(result.path_mm))
    curves = [Curve(time, leg, f"link {k}") for k, leg in enumerate(result.path_mm.T)]
    title = "Fig. 7: desired length from the start, on a path of ours"
    return drawn([Panel(title, "time [s]", "[mm]", curves)], (6.4, 3.6))


def errors(result: Result) -> Figure:
    """Errors over time, Figs 8 and 9 and the adaptive run."""
    panels = []
    for name, error in result.errors_um.items():
        curve = Curve(np.linspace(0, PATH_DURATION, error.size), error, None, {"linewidth": 0.8})
        x = "time [s]" if len(panels) == len(result.errors_um) - 1 else ""
        panels.append(Panel(name, x, "error [um]", [curve]))
    return drawn(panels, (6.4, 1.9 * len(panels)), sharex=True)


def integral_time(result: Result) -> Figure:
    """Mean error over the integral time, as modelled and as built."""
    rubbed = [row for row in result.limited if row.friction == FRICTIONS[-1]]
    titles = ("the linear servo", f"current limited, friction {FRICTIONS[-1]:g} A")
    panels, log = [], {"xscale": "log", "yscale": "log"}
    for title, runs in zip(titles, (result.integral, rubbed), strict=True):
        curves = []
        for truth in dict.fromkeys(row.truth for row in runs):
            rows = [row for row in runs if row.truth == truth and row.integral_time]
            times = [row.integral_time for row in rows]
            curves.append(Curve(times, [row.mean_um for row in rows], truth, {"marker": "o"}))
        panels.append(Panel(title, "integral time [s]", "mean error [um]", curves, log))
    title = "Zero phase tracking with an integrator"
    return drawn(panels, (9.0, 4.0), title, columns=2, legend=4)


def gain_error(result: Result) -> Figure:
    """Gain that zero phase tracking leaves."""
    left, log = result.gain_error, {"xscale": "log", "yscale": "log"}
    curves = [Curve(left.hertz, 100 * np.abs(left.error))]
    panel = Panel("Gain error, no phase error", "frequency [Hz]", "gain error [%]", curves, log)
    return drawn([panel], (6.4, 3.6))


FIGURES = {
    "manipulator": manipulator,
    "figure-7": figure_7,
    "errors": errors,
    "integral-time": integral_time,
    "gain-error": gain_error,
}
