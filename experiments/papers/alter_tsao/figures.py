"""Figures of Alter & Tsao, drawn from a result."""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from experiments.papers.alter_tsao.result import Result
from jcontour.app.reports.figures.axes import grid, legend_below, logarithmic
from jcontour.app.reports.figures.png import save_figures
from jcontour.linear.transfer_functions import transfer_function
from jcontour.plants.linear_motor_drive import PERIOD, linear_motor_drive

STEP_SAMPLES = 12  # a few time constants of the current loop


def draw(result: Result, folder: Path) -> list[Path]:
    """Save all figures as PNG files in `folder`."""
    figures = {
        "drive": drive,
        "figure-2": figure_2,
        "figures-3-4": figures_3_and_4,
        "table-1": errors,
    }
    if result.perturbed:
        figures["perturbed"] = perturbed
    return save_figures(figures, result, folder)


def drive(result: Result) -> Figure:
    """Response of the example drive: over frequency, and to a step of its control."""
    plant = linear_motor_drive()
    hertz = np.geomspace(1.0, 0.5 / PERIOD, 400)
    response = transfer_function(plant).response(np.exp(-2j * np.pi * hertz * PERIOD))
    figure = Figure(figsize=(7.2, 4.4), layout="constrained")
    panels = figure.subplot_mosaic([["gain", "steps"], ["phase", "steps"]])
    panels["gain"].loglog(hertz, np.abs(response))
    panels["phase"].semilogx(hertz, np.rad2deg(np.unwrap(np.angle(-response))) - 180)
    grid(panels["gain"], "Example drive, its zero at -0.3075", y="gain [m per m/s^2]")
    grid(panels["phase"], "", "frequency [Hz]", "phase [degrees]")
    state, samples = np.zeros(3), [0.0]
    A, B, C = (np.asarray(matrix) for matrix in (plant.A, plant.B, plant.C))
    for _ in range(STEP_SAMPLES):
        state = A @ state + B[:, 0]
        samples.append(float(C[0] @ state))
    time = 1e3 * PERIOD * np.arange(STEP_SAMPLES + 1)
    panels["steps"].plot(time, 1e6 * np.array(samples), ".-", label="drive")
    free = (1e-3 * time) ** 2 / 2
    panels["steps"].plot(time, 1e6 * free, "--", color="0.4", label="without the current's lag")
    grid(panels["steps"], "Step of 1 m/s^2", "time [ms]", "position [um]")
    legend_below(figure)
    return figure


def figure_2(result: Result) -> Figure:
    """Trajectory of one period."""
    figure = Figure(figsize=(6.4, 3.2), layout="constrained")
    axes = figure.subplots()
    axes.plot(PERIOD * np.arange(result.trajectory.size), 1e3 * result.trajectory)
    grid(axes, "Fig. 2: trajectory", "time [s]", "position [mm]")
    return figure


def figures_3_and_4(result: Result) -> Figure:
    """Errors of (0, 9, 0), simulated; the paper's figures were measured."""
    figure = Figure(figsize=(6.4, 2.4 * len(result.errors)), layout="constrained")
    panels = np.atleast_1d(figure.subplots(len(result.errors), 1, sharex=True))
    for axes, (name, error) in zip(panels, result.errors.items(), strict=True):
        axes.plot(PERIOD * np.arange(error.size), 1e6 * error)
        grid(axes, name, y="error [um]")
    panels[-1].set(xlabel="time [s]")
    return figure


def errors(result: Result) -> Figure:
    """Largest errors of Table 1: in print, ours, and measured."""
    figure = Figure(figsize=(7.2, 4.0), layout="constrained")
    axes = figure.subplots()
    lines = [line.line for line in result.table_1]
    printed = [1e6 * float(line.printed_max) for line in result.table_1]
    measured = [1e6 * float(line.measured_max) for line in result.table_1]
    ours = [1e6 * line.max_error for line in result.table_1]
    axes.semilogy(lines, measured, "^", color="0.6", label="measured")
    axes.semilogy(lines, printed, "o", markersize=8, fillstyle="none", label="simulated, print")
    axes.semilogy(lines, ours, ".", color="tab:orange", label="simulated, ours")
    grid(axes, "Table 1: largest tracking error", "line", "error [um]")
    legend_below(figure, axes)
    return figure


def perturbed(result: Result) -> Figure:
    """Costs over eps, and the limits of Table 2."""
    figure = Figure(figsize=(6.0, 4.0), layout="constrained")
    axes = figure.subplots()
    eps = [row.eps for row in result.perturbed]
    axes.plot(eps, [row.l1 for row in result.perturbed], "o-", label="l1 cost")
    axes.plot(eps, [row.hinf for row in result.perturbed], "s-", label="H-infinity cost")
    axes.axhline(result.table_2[0].limit, color="0.4", linestyle="--", label="limit")
    axes.axhline(result.table_2[0].attainable, color="0.4", linestyle=":", label="attainable")
    logarithmic(axes)
    grid(axes, "(0, 9, 0) with integral action", "eps", "cost")
    legend_below(figure, axes, columns=4)
    return figure
