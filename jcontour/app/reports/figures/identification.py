"""Figures to trust an identified machine by: residuals, predictions, responses."""

from collections.abc import Callable, Mapping

import numpy as np
from matplotlib.figure import Figure

from jcontour.app.reports.figures.axes import (
    CYCLE,
    DESIRED,
    START,
    TUNED,
    grid,
    legend_below,
    plain_ticks,
)
from tuning.identification.linear import validation
from tuning.identification.linear.identified_axes import IdentifiedMachine
from tuning.identification.linear.output_error import TRAINING
from tuning.identification.vibration import Resonance, Vibration
from tuning.response_loop import MeasuredResponse, ResponseLoop, sensitivity

SHOWN = 4000  # samples of the prediction: more is a solid block
WIDTH, HEIGHT = 4.6, 3.4  # of one axes [inch]


def prediction(machine: IdentifiedMachine) -> Figure:
    """Position on data that the model was not fitted to, simulated from the command alone."""
    figure, panels = _panels(machine, 2)
    cut, dt = int(TRAINING * len(machine.record.position)), machine.record.dt
    for (above, below), axis, measured in zip(
        panels, machine.axes, machine.record.position.T, strict=True
    ):
        rest = measured[cut:]
        some = slice(0, min(SHOWN, len(rest)))
        time = dt * (cut + np.arange(len(rest)))
        above.plot(time[some], 1e3 * rest[some], color=DESIRED, linewidth=2, label="measured")
        above.plot(
            time[some], 1e3 * axis.held_out[some], "--", color=TUNED, linewidth=1, label="model"
        )
        above.legend(fontsize=8)
        grid(above, f"{axis.name}: data that the model has not seen", "time [s]", "position [mm]")
        below.plot(time, 1e6 * (rest - axis.held_out), color=START, linewidth=0.6)
        grid(below, "measured - model, simulated", "time [s]", "um")
    return figure


def bode(machine: IdentifiedMachine, control_unit: str) -> Figure:
    """Frequency response with its 95 % interval; grey where it is wider than 10 %."""
    figure, panels = _panels(machine, 2)
    for (magnitude, phase), axis in zip(panels, machine.axes, strict=True):
        response = axis.response
        half = np.minimum(response.half_width, 3.0)
        size = 1e3 * np.abs(response.value)
        magnitude.fill_between(
            response.frequency, size * np.exp(-half), size * np.exp(half), color=TUNED, alpha=0.25
        )
        magnitude.plot(response.frequency, size, color=TUNED, linewidth=1)
        magnitude.set_yscale("log")
        angle = np.degrees(np.unwrap(np.angle(response.value)))
        wide = np.degrees(np.minimum(half, np.pi))
        phase.fill_between(response.frequency, angle - wide, angle + wide, color=TUNED, alpha=0.25)
        phase.plot(response.frequency, angle, color=TUNED, linewidth=1)
        grid(magnitude, f"{axis.name}: command to position, 95 %", "Hz", f"mm per {control_unit}")
        grid(phase, "", "Hz", "phase [degrees]")
        for panel in (magnitude, phase):
            panel.set_xscale("log")
            plain_ticks(panel.xaxis)
            first, last = response.frequency[0], response.frequency[-1]
            panel.set_xlim(first, last)
            low, high = response.band if np.isfinite(response.band[1]) else (last, last)
            for begin, end in ((first, low), (high, last)):
                if end > begin:
                    panel.axvspan(begin, end, color="0.9", zorder=0)
    return figure


def whiteness(machine: IdentifiedMachine) -> Figure:
    """Correlation of neighbouring errors, inside the band if only noise is left."""
    figure, panels = _panels(machine, 1)
    for (white,), axis in zip(panels, machine.axes, strict=True):
        values = validation.correlations(axis.fit)
        band = 1.96 / np.sqrt(len(axis.fit.errors))
        white.axhspan(-band, band, color="0.85")
        white.bar(np.arange(1, len(values) + 1), values, color=TUNED)
        top = max(0.15, 1.1 * float(np.abs(values).max()))
        white.set_ylim(-top, top)
        grid(white, f"{axis.name}: correlation of the errors", "lag [samples]", "")
    return figure


def _panels(machine: IdentifiedMachine, rows: int) -> tuple[Figure, list]:
    count = len(machine.axes)
    figure = Figure(figsize=(WIDTH * count, HEIGHT * rows), layout="constrained")
    return figure, list(figure.subplots(rows, count, squeeze=False).T)


def figures(control_unit: str) -> dict[str, Callable[[IdentifiedMachine], Figure]]:
    """Figures by name, with the unit of the commands."""
    return {
        "prediction": prediction,
        "bode": lambda machine: bode(machine, control_unit),
        "residuals": whiteness,
    }


def response_figure(lines: MeasuredResponse, loops: Mapping[str, ResponseLoop]) -> Figure:
    """The measured response, the loops with their controls, and their sensitivity."""
    figure = Figure(figsize=(9.0, 8.5), layout="constrained")
    size, phase, sensitive = figure.subplots(3, 1, sharex=True)
    for axes, values in ((size, np.abs), (phase, lambda one: np.degrees(np.unwrap(np.angle(one))))):
        axes.plot(lines.frequency, values(lines.value), color=DESIRED, label="measured response")
    for (name, loop), colour in zip(loops.items(), CYCLE, strict=False):
        L = loop.response(lines.frequency) * lines.value
        S = sensitivity(L)
        size.plot(lines.frequency, np.abs(L), color=colour, label=f"loop: {name}")
        phase.plot(lines.frequency, np.degrees(np.unwrap(np.angle(L))), color=colour)
        sensitive.plot(lines.frequency, S, color=colour, label=f"{name}: Ms {S.max():.3g}")
    size.set(xscale="log", yscale="log")
    grid(size, "measured response and loop", "", "size")
    grid(phase, "", "", "phase [degrees]")
    grid(sensitive, "sensitivity on the lines", "frequency [Hz]", "|S|")
    legend_below(figure)
    return figure


def vibration_figure(axis: str, vibration: Vibration, found: list[Resonance]) -> Figure:
    """Response of the tool in all directions, and the resonances."""
    figure = Figure(figsize=(9.0, HEIGHT), layout="constrained")
    panel = figure.subplots()
    panel.plot(vibration.frequency, 10 * np.log10(vibration.power), label=["X", "Y", "Z"])
    at = [one.frequency[0] for one in found]
    panel.vlines(at, *panel.get_ylim(), colors=DESIRED, linestyles="--", label="resonance")
    grid(panel, f"command of {axis} to acceleration of the tool", "frequency [Hz]", "dB")
    legend_below(figure, 4)
    return figure
