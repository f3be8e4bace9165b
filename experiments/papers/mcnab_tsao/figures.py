"""Figures of McNab & Tsao, drawn from a result."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from experiments.papers.mcnab_tsao.claims import (
    FIGURE_2_ALPHA,
    FIGURE_9,
    FIGURE_10,
    over_previews,
    table_over_weights,
)
from experiments.papers.mcnab_tsao.result import Case, MachineRun, Member, Result
from jcontour.app.reports.figures.axes import legend_below
from jcontour.app.reports.figures.png import save_figures

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


def draw(result: Result, folder: Path) -> list[Path]:
    """Save all figures as PNG files in `folder`."""
    figures = {
        "figure-2": points_along_the_circle,
        "figures-3-and-5": errors_on_the_family,
        "figures-4-and-6": bars_over_the_weights,
        "figures-9-and-10": errors_over_the_preview,
        "theorem-1": radii_over_the_horizon,
    }
    return save_figures(figures, result, folder)


def points_along_the_circle(result: Result) -> Figure:
    """Fig. 2: output samples approach the circle as contour weight is added."""
    figure = Figure(figsize=(6.5, 6.0), layout="constrained")
    axes = figure.subplots()
    desired = 1e6 * result.points.desired_m
    middle = desired[len(desired) // 2]
    angle = np.linspace(0.0, 2 * np.pi, 20_001)
    circle = 1e3 * np.column_stack([np.cos(angle), np.sin(angle)]) - middle
    axes.plot(*circle.T, color="0.6", linewidth=1.0, label="circle")
    axes.plot(*(desired - middle).T, "o", color="0.2", mfc="none", markersize=8, label="desired")
    for colour, (beta, output) in zip(POINT_COLOURS, result.points.output_m.items(), strict=False):
        points = 1e6 * output - middle
        axes.plot(*points.T, "x", color=colour, markersize=7, label=f"beta {beta}")
    axes.set(xlim=(-REACH, REACH), ylim=(-REACH, REACH), aspect="equal")
    axes.set(xlabel="x [um]", ylabel="y [um]")
    axes.set_title(
        "Fig. 2: samples on the 1 mm circle, motion to the lower left\n"
        f"alpha {FIGURE_2_ALPHA:g}, output terminal"
    )
    axes.grid(color="0.92")
    axes.legend(frameon=False)
    return figure


def bars_over_the_weights(result: Result) -> Figure:
    """Figs 4 and 6, and the same with H_s: nominal machine."""
    figure = Figure(figsize=(11.0, 7.5), layout="constrained")
    grid = figure.subplots(2, 2, sharex=True, sharey="row")
    alphas = result.weights.alpha
    for row, error in enumerate(ERRORS):
        for column, terminal in enumerate(NAMES):
            axes = grid[row, column]
            _bars(axes, result, terminal, error)
            number = SIMULATED.get((terminal, error), "")
            axes.set_title(f"{number}RMS {ERRORS[error]} error, {NAMES[terminal]}")
            axes.set_xticks(np.arange(len(alphas)), [f"{alpha:g}" for alpha in alphas])
    _label(grid)
    legend_below(figure, grid[0, 0], columns=6)
    return figure


def errors_on_the_family(result: Result) -> Figure:
    """Figs 3, 5, 7 and 8: errors over alpha on every machine.

    The nominal machine only improves with alpha; a delayed one improves, then loses stability.
    """
    figure = Figure(figsize=(11.0, 7.5), layout="constrained")
    grid = figure.subplots(2, 2, sharex=True, sharey="row")
    alphas = result.weights.all_alphas
    for column, terminal in enumerate(NAMES):
        runs = [result.run_of(Case(terminal, alpha, 0.0)).machines for alpha in alphas]
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
    figure = Figure(figsize=(11.0, 4.5), layout="constrained")
    left, right = figure.subplots(1, 2)
    for terminal, name in NAMES.items():
        style = {"color": COLOURS[terminal], "label": name}
        previews, tracking = over_previews(result, terminal, FIGURE_9, "te_um")
        left.plot(previews, tracking, "+-", **style)
        previews, contour = over_previews(result, terminal, FIGURE_10, "ce_um")
        right.plot(previews, np.square(contour), "+-", **style)
    left.set(title="Fig. 9: RMS tracking error, alpha 4, beta 0", ylabel="[um]")
    right.set(title="Fig. 10: mean square contour error, alpha 0.25, beta 15", ylabel="[um^2]")
    for axes in (left, right):
        axes.set(xlabel="preview [samples]", yscale="log")
        axes.grid(color="0.92")
    legend_below(figure, left, columns=2)
    return figure


def radii_over_the_horizon(result: Result) -> Figure:
    """Theorem 1: largest spectral radius over all directions, per weight set and horizon."""
    figure = Figure(figsize=(11.0, 4.5), layout="constrained")
    row = figure.subplots(1, 2, sharey=True)
    theorem = result.theorem_1
    rhos = sorted({one.rho for one in theorem.sets}, reverse=True)
    horizons = np.arange(1, theorem.longest + 1)
    for axes, (terminal, name) in zip(row, NAMES.items(), strict=True):
        for one in sorted(theorem.sets, key=lambda one: -one.rho):
            style = {"color": f"C{rhos.index(one.rho)}", "linewidth": 0.7, "markersize": 3}
            axes.plot(horizons, getattr(one, terminal), ".-", **style)
        axes.axhline(1.0, color="0.2", linestyle="--", linewidth=1.0, label="limit of stability")
        axes.set(xlabel="horizon N_p", xscale="log", yscale="log")
        axes.set(title=f"{name}, {len(theorem.sets)} weight sets")
        axes.grid(color="0.92", which="both")
    row[0].set_ylabel("largest spectral radius over all directions")
    lines = [Line2D([], [], color=f"C{k}", label=f"rho {rho:.0e}") for k, rho in enumerate(rhos)]
    legend_below(figure, row[0], columns=4, more=lines)
    return figure


def _bars(axes: Axes, result: Result, terminal: str, error: str) -> None:
    """A group for each alpha, in it a bar for each beta."""
    alphas, betas = result.weights.alpha, result.weights.beta
    table = table_over_weights(result, terminal, error)
    for k, beta in enumerate(betas):
        place = np.arange(len(alphas)) + (k - (len(betas) - 1) / 2) * BAR
        heights = [table[alpha, beta] for alpha in alphas]
        axes.bar(place, heights, BAR - 0.01, color=SHADES[k], label=f"beta {beta:g}")
    axes.set_yscale("log")
    axes.grid(axis="y", color="0.92")
    axes.set_axisbelow(True)


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
    values = np.array([np.nan if run.diverged else getattr(run, error) for run in runs], float)
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
