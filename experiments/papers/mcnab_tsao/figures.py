"""Figures of McNab & Tsao, drawn from a result."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from experiments.papers.mcnab_tsao.experiment import (
    ALPHAS,
    BETAS,
    FIGURE_2_ALPHA,
    FIGURE_9,
    FIGURE_10,
    THEOREM_HORIZON,
    TOO_HIGH_ALPHA,
    MachineRun,
    Result,
)
from experiments.papers.mcnab_tsao.runs import Member
from experiments.papers.panels import Curve, Panel, drawn
from jcontour.app.reports.figures.axes import legend_below

NAMES = {"output": "output terminal C'QC", "dare": "terminal H_s(Q_max)"}
COLOURS = {"output": "tab:blue", "dare": "tab:orange"}
ERRORS = {"te_um": "tracking", "ce_um": "contour"}  # rows of a figure
SHADES = ("#c6dbef", "#9ecae1", "#6baed6", "#3182bd", "#08519c")  # beta, light to dark
POINT_COLOURS = ("tab:red", "tab:orange", "tab:olive", "tab:green", "tab:blue")
REACH = 60.0  # [um] of Fig. 2: five samples, the points of one sample stay apart
BAR = 0.16  # of the distance between groups
MEASURED = {
    ("output", "te_um"): "Fig. 3",
    ("output", "ce_um"): "Fig. 5",
    ("dare", "te_um"): "Fig. 7",
    ("dare", "ce_um"): "Fig. 8",
}
SIMULATED = {("output", "te_um"): "Fig. 4: ", ("output", "ce_um"): "Fig. 6: "}


def points_along_the_circle(result: Result) -> Figure:
    """Fig. 2: output samples approach the circle as contour weight is added."""
    desired = 1e6 * result.desired_m
    middle = desired[len(desired) // 2]
    angle = np.linspace(0.0, 2 * np.pi, 20_001)
    circle = 1e3 * np.column_stack([np.cos(angle), np.sin(angle)]) - middle
    ring = {"marker": "o", "linestyle": "", "color": "0.2", "mfc": "none", "markersize": 8}
    curves = [
        Curve(*circle.T, "circle", {"color": "0.6", "linewidth": 1.0}),
        Curve(*(desired - middle).T, "desired", ring),
    ]
    for colour, (beta, output) in zip(POINT_COLOURS, result.output_m.items(), strict=False):
        cross = {"marker": "x", "linestyle": "", "color": colour, "markersize": 7}
        curves.append(Curve(*(1e6 * output - middle).T, f"beta {beta}", cross))
    title = (
        "Fig. 2: samples on the 1 mm circle, motion to the lower left\n"
        f"alpha {FIGURE_2_ALPHA:g}, output terminal"
    )
    limits = (-REACH, REACH)
    axes = {"xlim": limits, "ylim": limits, "aspect": "equal"}
    return drawn([Panel(title, "x [um]", "y [um]", curves, axes)], (6.5, 6.0), legend=4)


def bars_over_the_weights(result: Result) -> Figure:
    """Figs 4 and 6, and the same with H_s: nominal machine.

    A group for each alpha, in it a bar for each beta.
    """
    figure = Figure(figsize=(11.0, 7.5), layout="constrained")
    grid = figure.subplots(2, 2, sharex=True, sharey="row")
    groups = np.arange(len(ALPHAS))
    for row, error in enumerate(ERRORS):
        for column, terminal in enumerate(NAMES):
            axes, heights = grid[row, column], result.over_weights(terminal, error)
            for k, beta in enumerate(BETAS):
                place = groups + (k - (len(BETAS) - 1) / 2) * BAR
                style = {"color": SHADES[k], "label": f"beta {beta:g}"}
                axes.bar(place, heights[:, k], BAR - 0.01, **style)
            number = SIMULATED.get((terminal, error), "")
            axes.set_title(f"{number}RMS {ERRORS[error]} error, {NAMES[terminal]}")
            axes.set_xticks(groups, [f"{alpha:g}" for alpha in ALPHAS])
            axes.set_yscale("log")
            axes.grid(axis="y", color="0.92")
            axes.set_axisbelow(True)
    _label(grid)
    legend_below(figure, grid[0, 0], columns=6)
    return figure


def errors_on_the_family(result: Result) -> Figure:
    """Figs 3, 5, 7 and 8: errors over alpha on every machine.

    The nominal machine only improves with alpha; a delayed one improves, then loses stability.
    """
    figure = Figure(figsize=(11.0, 7.5), layout="constrained")
    grid = figure.subplots(2, 2, sharex=True, sharey="row")
    alphas = (*ALPHAS, TOO_HIGH_ALPHA)
    for column, terminal in enumerate(NAMES):
        runs = [result.on_family(terminal, alpha, 0.0) for alpha in alphas]
        for row, error in enumerate(ERRORS):
            axes = grid[row, column]
            for i, member in enumerate(result.family):
                on_member = [machines[i] for machines in runs]
                _with_unstable(axes, alphas, on_member, error, f"C{i}", _machine_name(member))
            number = MEASURED[terminal, error]
            axes.set(xscale="log", yscale="log")
            axes.set_title(f"{number}: RMS {ERRORS[error]} error, {NAMES[terminal]}, beta 0")
            axes.set_xticks(alphas, [f"{alpha:g}" for alpha in alphas], minor=False)
            axes.minorticks_off()
            axes.grid(color="0.92")
    _label(grid)
    unstable = Line2D([], [], color="0.3", marker="X", markersize=10, linestyle="none")
    unstable.set_label("loop unstable (arrow: beyond the scale)")
    legend_below(figure, grid[0, 0], columns=6, more=[unstable])
    return figure


def errors_over_the_preview(result: Result) -> Figure:
    """Figs 9 and 10: errors against the number of preview samples, both terminals."""
    tracking, square = [], []
    for terminal, name in NAMES.items():
        style = {"marker": "+", "color": COLOURS[terminal]}
        te = result.over_previews(terminal, FIGURE_9, "te_um")
        ce = result.over_previews(terminal, FIGURE_10, "ce_um")
        tracking.append(Curve(list(te), list(te.values()), name, style))
        square.append(Curve(list(ce), np.square(list(ce.values())), name, style))
    titles = (
        "Fig. 9: RMS tracking error, alpha 4, beta 0",
        "Fig. 10: mean square contour error, alpha 0.25, beta 15",
    )
    x, axes = "preview [samples]", {"yscale": "log"}
    panels = [
        Panel(titles[0], x, "[um]", tracking, axes),
        Panel(titles[1], x, "[um^2]", square, axes),
    ]
    return drawn(panels, (11.0, 4.5), columns=2, legend=2)


def radii_over_the_horizon(result: Result) -> Figure:
    """Theorem 1: largest spectral radius over all directions, per weight set and horizon."""
    rhos = sorted({one.rho for one in result.sets}, reverse=True)
    horizons = np.arange(1, THEOREM_HORIZON + 1)
    panels = []
    for terminal, name in NAMES.items():
        curves = []
        for one in sorted(result.sets, key=lambda one: -one.rho):
            style = {"color": f"C{rhos.index(one.rho)}", "linewidth": 0.7, "markersize": 3}
            radii = getattr(one, terminal)
            curves.append(Curve(horizons, radii, f"rho {one.rho:.0e}", {"marker": ".", **style}))
        limit = {"color": "0.2", "linestyle": "--", "linewidth": 1.0}
        curves.append(Curve(None, 1.0, "limit of stability", limit))
        title = f"{name}, {len(result.sets)} weight sets"
        axes = {"xscale": "log", "yscale": "log"}
        panels.append(Panel(title, "horizon N_p", "largest spectral radius", curves, axes))
    title = "Theorem 1: largest spectral radius over all directions"
    return drawn(panels, (11.0, 4.8), title, columns=2, legend=4, sharey=True)


def _label(grid: np.ndarray) -> None:
    """Labels at the left and below."""
    for axes in grid[:, 0]:
        axes.set_ylabel("[um]")
    for axes in grid[-1]:
        axes.set_xlabel("alpha")


def _with_unstable(
    axes: Axes,
    alphas: Sequence[float],
    runs: Sequence[MachineRun],
    error: str,
    colour: str,
    label: str,
) -> None:
    """A line through the stable points; crosses where the loop is unstable.

    A cross is at the top edge where the run diverged.
    """
    values = np.array([getattr(run, error) for run in runs])
    stable = np.array([run.stable for run in runs])
    axes.plot(alphas, values, ":", color=colour, linewidth=1.0)
    axes.plot(alphas, np.where(stable, values, np.nan), ".-", color=colour, label=label)
    for alpha, value in zip(np.array(alphas)[~stable], values[~stable], strict=True):
        style = {"color": colour, "markersize": 10}
        if np.isfinite(value):
            axes.plot(alpha, value, "X", **style)
        else:
            axes.plot(alpha, 0.97, "^", transform=axes.get_xaxis_transform(), **style)


def _machine_name(machine: Member) -> str:
    if machine.delay:
        return f"delay {machine.delay}"
    if machine.gain_x == machine.gain_y == 1:
        return "nominal"
    return f"gains x {machine.gain_x:g}, y {machine.gain_y:g}"


FIGURES = {
    "figure-2": points_along_the_circle,
    "figures-3-and-5": errors_on_the_family,
    "figures-4-and-6": bars_over_the_weights,
    "figures-9-and-10": errors_over_the_preview,
    "theorem-1": radii_over_the_horizon,
}
