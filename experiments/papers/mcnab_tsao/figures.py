"""The figures of McNab & Tsao, drawn from the numbers of a run."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from experiments.papers.mcnab_tsao.claims import (
    FIGURE_2_ALPHA,
    FIGURE_9,
    FIGURE_10,
    nominal,
    run_of,
    scan,
)
from experiments.reports.png import save_figures

TERMINALS = {"output": "output terminal C'QC", "dare": "terminal H_s(Q_max)"}
COLOURS = {"output": "tab:blue", "dare": "tab:orange"}
SHADES = ("#c6dbef", "#9ecae1", "#6baed6", "#3182bd", "#08519c")  # beta, light to dark
POINT_COLOURS = ("tab:red", "tab:orange", "tab:olive", "tab:green", "tab:blue")


def draw(summary: dict[str, Any], folder: Path) -> list[Path]:
    """All figures, as PNG files in `folder`."""
    figures: dict[str, Callable[[dict[str, Any]], Figure]] = {
        "figure-2": points_along_the_circle,
        "figures-3-and-5": errors_on_the_family,
        "figures-4-and-6": bars_over_the_weights,
        "figures-9-and-10": errors_over_the_preview,
        "theorem-1": radii_over_the_horizon,
    }
    return save_figures(figures, summary, folder)


def points_along_the_circle(summary: dict[str, Any]) -> Figure:
    """Fig. 2: output samples approach the circle as contour weight is added."""
    figure = Figure(figsize=(6.5, 6.0), layout="constrained")
    axes = figure.subplots()
    desired = 1e6 * np.array(summary["points"]["desired_m"])
    middle = desired[len(desired) // 2]
    angle = np.linspace(0.0, 2 * np.pi, 20_001)
    axes.plot(
        *(1e3 * np.array([np.cos(angle), np.sin(angle)]) - middle[:, None]),
        color="0.6",
        linewidth=1.0,
        label="circle",
    )
    axes.plot(*(desired - middle).T, "o", color="0.2", mfc="none", markersize=8, label="desired")
    for colour, (beta, output) in zip(
        POINT_COLOURS, summary["points"]["output_m"].items(), strict=False
    ):
        axes.plot(
            *(1e6 * np.array(output) - middle).T,
            "x",
            color=colour,
            markersize=7,
            label=f"beta {beta}",
        )
    reach = 60.0  # [um] five samples: the points of one sample stay apart
    axes.set(
        xlim=(-reach, reach), ylim=(-reach, reach), aspect="equal", xlabel="x [um]", ylabel="y [um]"
    )
    axes.set_title(
        f"Fig. 2: samples on the 1 mm circle, motion to the lower left\nalpha {FIGURE_2_ALPHA:g}, output terminal"
    )
    axes.grid(color="0.92")
    axes.legend(frameon=False)
    return figure


def bars_over_the_weights(summary: dict[str, Any]) -> Figure:
    """Figs 4 and 6, and the same with H_s: nominal machine."""
    figure = Figure(figsize=(11.0, 7.5), layout="constrained")
    grid = figure.subplots(2, 2, sharex=True, sharey="row")
    alphas, betas = summary["weights"]["alpha"], summary["weights"]["beta"]
    for row, (error, name) in enumerate((("te_um", "tracking"), ("ce_um", "contour"))):
        for column, terminal in enumerate(TERMINALS):
            axes, table = grid[row, column], nominal(summary, terminal, error)
            for k, beta in enumerate(betas):
                place = np.arange(len(alphas)) + (k - (len(betas) - 1) / 2) * 0.16
                axes.bar(
                    place,
                    [table[alpha, beta] for alpha in alphas],
                    0.15,
                    color=SHADES[k],
                    label=f"beta {beta:g}",
                )
            axes.set_yscale("log")
            axes.set_xticks(np.arange(len(alphas)), [f"{alpha:g}" for alpha in alphas])
            number = (
                {"te_um": "Fig. 4: ", "ce_um": "Fig. 6: "}[error] if terminal == "output" else ""
            )
            axes.set_title(f"{number}RMS {name} error, {TERMINALS[terminal]}")
            axes.grid(axis="y", color="0.92")
            axes.set_axisbelow(True)
    for row in (0, 1):
        grid[row, 0].set_ylabel("[um]")
    for column in (0, 1):
        grid[1, column].set_xlabel("alpha")
    _legend_below(figure, grid[0, 0])
    return figure


def errors_on_the_family(summary: dict[str, Any]) -> Figure:
    """Figs 3 and 5 (and 7 and 8): the nominal machine only improves with alpha, a delayed one improves, then loses stability."""
    figure = Figure(figsize=(11.0, 7.5), layout="constrained")
    grid = figure.subplots(2, 2, sharex=True, sharey="row")
    alphas = [*summary["weights"]["alpha"], summary["weights"]["too_high_alpha"]]
    names = [_machine_name(machine) for machine in summary["family"]]
    numbers = {
        ("output", "te_um"): "Fig. 3",
        ("output", "ce_um"): "Fig. 5",
        ("dare", "te_um"): "Fig. 7",
        ("dare", "ce_um"): "Fig. 8",
    }
    for column, terminal in enumerate(TERMINALS):
        runs = [run_of(summary, terminal, alpha, 0.0)["machines"] for alpha in alphas]
        for row, (error, name) in enumerate((("te_um", "tracking"), ("ce_um", "contour"))):
            axes = grid[row, column]
            for i, machine in enumerate(names):
                _with_unstable(axes, alphas, [run[i] for run in runs], error, f"C{i}", machine)
            axes.set(
                xscale="log",
                yscale="log",
                title=f"{numbers[terminal, error]}: RMS {name} error, {TERMINALS[terminal]}, beta 0",
            )
            axes.set_xticks(alphas, [f"{alpha:g}" for alpha in alphas], minor=False)
            axes.minorticks_off()
            axes.grid(color="0.92")
    for row in (0, 1):
        grid[row, 0].set_ylabel("[um]")
    for column in (0, 1):
        grid[1, column].set_xlabel("alpha")
    marks = [
        Line2D(
            [],
            [],
            color="0.3",
            marker="X",
            markersize=10,
            linestyle="none",
            label="loop unstable (arrow: beyond the scale)",
        )
    ]
    _legend_below(figure, grid[0, 0], marks)
    return figure


def errors_over_the_preview(summary: dict[str, Any]) -> Figure:
    """Figs 9 and 10: errors against the number of preview samples, both terminals."""
    figure = Figure(figsize=(11.0, 4.5), layout="constrained")
    left, right = figure.subplots(1, 2)
    for terminal, name in TERMINALS.items():
        previews, tracking = scan(summary, terminal, *FIGURE_9, "te_um")
        left.plot(previews, tracking, "+-", color=COLOURS[terminal], label=name)
        previews, contour = scan(summary, terminal, *FIGURE_10, "ce_um")
        right.plot(previews, np.square(contour), "+-", color=COLOURS[terminal], label=name)
    left.set(title="Fig. 9: RMS tracking error, alpha 4, beta 0", ylabel="[um]")
    right.set(title="Fig. 10: mean square contour error, alpha 0.25, beta 15", ylabel="[um^2]")
    for axes in (left, right):
        axes.set(xlabel="preview [samples]", yscale="log")
        axes.grid(color="0.92")
    _legend_below(figure, left)
    return figure


def radii_over_the_horizon(summary: dict[str, Any]) -> Figure:
    """Theorem 1: largest spectral radius over all directions, per weight set and horizon."""
    figure = Figure(figsize=(11.0, 4.5), layout="constrained")
    row = figure.subplots(1, 2, sharey=True)
    theorem = summary["theorem_1"]
    rhos = sorted({one["rho"] for one in theorem["sets"]}, reverse=True)
    horizons = np.arange(1, theorem["longest"] + 1)
    for axes, (terminal, name) in zip(row, TERMINALS.items(), strict=True):
        for one in sorted(theorem["sets"], key=lambda one: -one["rho"]):
            axes.plot(
                horizons,
                one[terminal],
                ".-",
                color=f"C{rhos.index(one['rho'])}",
                linewidth=0.7,
                markersize=3,
            )
        axes.axhline(1.0, color="0.2", linestyle="--", linewidth=1.0)
        axes.set(
            xlabel="horizon N_p",
            xscale="log",
            yscale="log",
            title=f"{name}, {len(theorem['sets'])} weight sets",
        )
        axes.grid(color="0.92", which="both")
    row[0].set_ylabel("largest spectral radius over all directions")
    rho_lines = [
        Line2D([], [], color=f"C{k}", label=f"rho {rho:.0e}") for k, rho in enumerate(rhos)
    ]
    limit = Line2D([], [], color="0.2", linestyle="--", label="limit of stability")
    figure.legend(handles=[*rho_lines, limit], loc="outside lower center", ncols=4, frameon=False)
    return figure


def _with_unstable(
    axes: Axes, alphas: list[float], runs: list[dict[str, Any]], error: str, colour: str, label: str
) -> None:
    """A line through the stable points; crosses where the loop is unstable, at the top edge where it ran away."""
    values = np.array([np.nan if run["diverged"] else run[error] for run in runs], float)
    stable = np.array([run["spectral_radius"] < 1 for run in runs])
    axes.plot(alphas, values, ":", color=colour, linewidth=1.0)
    axes.plot(alphas, np.where(stable, values, np.nan), ".-", color=colour, label=label)
    for alpha, value in zip(np.array(alphas)[~stable], values[~stable], strict=True):
        if np.isfinite(value):
            axes.plot(alpha, value, "X", color=colour, markersize=10)
        else:
            axes.plot(
                alpha, 0.97, "^", color=colour, markersize=10, transform=axes.get_xaxis_transform()
            )


def _machine_name(machine: dict[str, Any]) -> str:
    if machine["delay"]:
        return f"delay {machine['delay']}"
    return (
        "nominal"
        if machine["gain_x"] == machine["gain_y"] == 1
        else f"gains x {machine['gain_x']:g}, y {machine['gain_y']:g}"
    )


def _legend_below(figure: Figure, axes: Axes, more: list[Line2D] | None = None) -> None:
    handles, _ = axes.get_legend_handles_labels()
    figure.legend(
        handles=[*handles, *(more or [])], loc="outside lower center", ncols=6, frameon=False
    )
