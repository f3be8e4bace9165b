"""Figures of Alter & Tsao, drawn from a result."""

import numpy as np
from matplotlib.figure import Figure

from experiments.papers.alter_tsao.experiment import Result
from experiments.papers.panels import Curve, Panel, drawn
from jcontour.app.reports.figures.axes import grid, legend_below
from jcontour.linear.transfer_functions import transfer_function
from jcontour.plants.linear_motor_drive import PERIOD, linear_motor_drive

STEP_SAMPLES = 12  # a few time constants of the current loop


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
    trajectory = Curve(PERIOD * np.arange(result.trajectory.size), 1e3 * result.trajectory)
    panel = Panel("Fig. 2: trajectory", "time [s]", "position [mm]", [trajectory])
    return drawn([panel], (6.4, 3.2))


def figures_3_and_4(result: Result) -> Figure:
    """Errors of (0, 9, 0), simulated; the paper's figures were measured."""
    panels = []
    for name, error in result.errors.items():
        curve = Curve(PERIOD * np.arange(error.size), 1e6 * error)
        x = "time [s]" if len(panels) == len(result.errors) - 1 else ""
        panels.append(Panel(name, x, "error [um]", [curve]))
    return drawn(panels, (6.4, 2.4 * len(panels)), sharex=True)


def errors(result: Result) -> Figure:
    """Largest errors of Table 1: in print, ours, and measured."""
    lines = [line.line for line in result.table_1]
    measured = [1e6 * float(line.measured_max) for line in result.table_1]
    printed = [1e6 * float(line.printed_max) for line in result.table_1]
    ours = [1e6 * line.max_error for line in result.table_1]
    ring = {"marker": "o", "linestyle": "", "markersize": 8, "fillstyle": "none"}
    curves = [
        Curve(lines, measured, "measured", {"marker": "^", "linestyle": "", "color": "0.6"}),
        Curve(lines, printed, "simulated, print", ring),
        Curve(lines, ours, "simulated, ours", {"marker": ".", "linestyle": "", "color": "C1"}),
    ]
    title, log = "Table 1: largest tracking error", {"yscale": "log"}
    return drawn([Panel(title, "line", "error [um]", curves, log)], (7.2, 4.0))


def perturbed(result: Result) -> Figure:
    """Costs over eps, and the limits of Table 2."""
    eps, costs = [row.eps for row in result.perturbed], result.table_2[0]
    curves = [
        Curve(eps, [row.l1 for row in result.perturbed], "l1 cost", {"marker": "o"}),
        Curve(eps, [row.hinf for row in result.perturbed], "H-infinity cost", {"marker": "s"}),
        Curve(None, costs.limit, "limit", {"color": "0.4", "linestyle": "--"}),
        Curve(None, costs.attainable, "attainable", {"color": "0.4", "linestyle": ":"}),
    ]
    title, log = "(0, 9, 0) with integral action", {"xscale": "log", "yscale": "log"}
    return drawn([Panel(title, "eps", "cost", curves, log)], (6.0, 4.0), legend=4)


FIGURES = {
    "drive": drive,
    "figure-2": figure_2,
    "figures-3-4": figures_3_and_4,
    "table-1": errors,
    "perturbed": perturbed,
}
