"""Figure of a machine: step response and frequency response of every axis."""

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from jcontour.app.machines.machine import Machine
from jcontour.app.machines.machine_behaviour import AxisBehaviour, response
from jcontour.app.reports.figures.shared.axes import CYCLE, grid, legend_below, plain_ticks

POINTS = 300
SHOWN = 8.0  # rise times of the step response that are drawn


def machine_figure(machine: Machine, found: Sequence[AxisBehaviour]) -> Figure:
    """Speed after a step of the control; magnitude and phase from control to position."""
    figure = Figure(figsize=(9.0, 6.0), layout="constrained")
    panels = figure.subplot_mosaic([["step", "size"], ["step", "phase"]])
    step, size, phase = panels["step"], panels["size"], panels["phase"]
    dt, unit = machine.model.dt, machine.control_unit
    frequency = np.geomspace(1e-3 / dt, 0.499 / dt, POINTS)
    for k, one in enumerate(found):
        colour = CYCLE[k % len(CYCLE)]
        rise = one.rise if np.isfinite(one.rise) and one.rise > 0 else 100 * dt
        last = min(int((SHOWN * rise) / dt) + one.delay + 3, len(one.step) - 2)
        speed = np.diff(one.step)[:last] / dt
        shown = 1e3 * one.step[:last] if one.kind == "position" else 1e3 * speed
        step.plot(1e3 * one.time[:last], shown, color=colour, label=one.name)
        values = response(machine.model, k, frequency)
        size.plot(frequency, 1e3 * np.abs(values), color=colour)
        phase.plot(frequency, np.degrees(np.unwrap(np.angle(values))), color=colour)
    what = "position [mm]" if all(one.kind == "position" for one in found) else "speed [mm/s]"
    grid(step, f"{machine.name}: after a step of one {unit}", "time [ms]", what)
    size.set(xscale="log", yscale="log")
    phase.set(xscale="log")
    for axes in (size, phase):
        plain_ticks(axes.xaxis)
    grid(size, "control to position", "", f"mm per {unit}")
    grid(phase, "", "frequency [Hz]", "phase [degrees]")
    legend_below(figure)
    return figure
