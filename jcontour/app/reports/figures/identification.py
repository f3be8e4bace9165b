"""Figures to trust an identified machine by: residuals, predictions, responses."""

from collections.abc import Callable, Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from jcontour.app.files.response_file import MeasuredResponse
from jcontour.app.reports.figures.axes import (
    CYCLE,
    DESIRED,
    START,
    TUNED,
    grid,
    legend_below,
    plain_ticks,
)
from tuning.identification.flexible_axis.axis import IdentifiedAxis
from tuning.identification.linear import evidence
from tuning.identification.linear.found import LinearMachineFound
from tuning.identification.linear.output_error import TRAINING
from tuning.response_loop import ResponseLoop, sensitivity

POINT = {"marker": ".", "linestyle": "none", "markersize": 2.0, "alpha": 0.5}
HARMONICS_SHOWN = 10


def residuals(found: IdentifiedAxis) -> Figure:
    """Residuals of current, end effector and force. Where only noise is left they have no shape."""
    figure = Figure(figsize=(9.0, 7.5), layout="constrained")
    (current, tool), (position, speed) = figure.subplots(2, 2)
    if found.winding is not None:
        current.plot(np.concatenate(found.winding.residuals), linewidth=0.4)
    grid(current, "winding: simulated - recorded i_q", "row of the electrical tests", "A")
    if found.link is not None:
        tool.plot(1e6 * np.concatenate(found.link.residuals), linewidth=0.4)
    grid(tool, "link: simulated - recorded end effector", "row of the motion tests", "um")
    for slide, left in zip(found.forces.slides, found.forces.residuals, strict=True):
        colour = "tab:blue" if slide.direction > 0 else "tab:orange"
        position.plot(slide.position @ slide.weights, left, color=colour, **POINT)
        speed.plot(slide.speed @ slide.weights, left, color=colour, **POINT)
    grid(position, "balance of forces, one way blue, the other orange", "motor position [m]", "N")
    grid(speed, "balance of forces", "speed [m/s]", "N")
    return figure


def model(found: IdentifiedAxis) -> Figure:
    """Friction over speed, cogging over position, and the spectrum of cogging.

    Grey: what the other terms leave of the data. Blue: the fit.
    """
    figure = Figure(figsize=(9.0, 8.0), layout="constrained")
    friction, cogging, lines = figure.subplots(3, 1)
    value = _values(found)
    for slide, left in zip(found.forces.slides, found.forces.residuals, strict=True):
        speed = slide.speed @ slide.weights
        friction.plot(speed, _friction(value, speed) - left, color="0.6", **POINT)
    for sign in (-1, 1):
        speed = sign * np.linspace(1e-3, found.forces.fastest, 200)
        friction.plot(speed, _friction(value, speed), color="tab:blue")
    title = "friction: the fit, and what inertia and cogging leave of the current"
    grid(friction, title, "speed [m/s]", "N")
    _draw_cogging(cogging, found)
    _draw_spectrum(lines, found)
    return figure


def _draw_cogging(axes: Axes, found: IdentifiedAxis) -> None:
    value, slides = _values(found), found.forces.slides
    for slide, left in zip(slides, found.forces.residuals, strict=True):
        place = slide.position @ slide.weights
        axes.plot(place, _cogging(value, found, place) - left, color="0.6", **POINT)
    low = min(slide.position.min() for slide in slides)
    high = max(slide.position.max() for slide in slides)
    place = np.linspace(low, high, 800)
    axes.plot(place, _cogging(value, found, place), color="tab:blue")
    title = "cogging: the fit, and what inertia and friction leave of the current"
    grid(axes, title, "motor position [m]", "N")


def _draw_spectrum(axes: Axes, found: IdentifiedAxis) -> None:
    spectrum, cogging = found.forces.spectrum, found.forces.cogging
    axes.plot(spectrum.wavenumber, spectrum.amplitude, linewidth=0.9)
    for j in range(1, cogging.highest + 1):
        axes.axvline(j / cogging.pole_pitch, color="tab:orange", linewidth=0.6)
    axes.set_xlim(0, HARMONICS_SHOWN / cogging.pole_pitch)
    grid(axes, "spectrum over position, harmonics in the fit orange", "1/m", "N")


def _values(found: IdentifiedAxis) -> dict[str, float]:
    return dict(zip(found.estimate.names, found.estimate.values, strict=True))


FIGURES = {"residuals": residuals, "model": model}


def _friction(value: dict[str, float], speed: np.ndarray) -> np.ndarray:
    fall = value["drop"] * speed**2 / (1 + value.get("curvature", 0.0) * speed**2)
    return np.sign(speed) * (value["break_away"] - fall) + value["viscous"] * speed


def _cogging(value: dict[str, float], found: IdentifiedAxis, position: np.ndarray) -> np.ndarray:
    angle = 2 * np.pi / value.get("pole_pitch", found.forces.cogging.pole_pitch) * position
    orders = range(1, found.forces.cogging.highest + 1)
    return sum(
        (
            value[f"sine_{j}"] * np.sin(j * angle) + value[f"cosine_{j}"] * np.cos(j * angle)
            for j in orders
        ),
        np.zeros_like(position),
    )


SHOWN = 4000  # samples of the prediction: more is a solid block
WIDTH, HEIGHT = 4.6, 3.4  # of one axes [inch]


def prediction(found: LinearMachineFound) -> Figure:
    """Position on data that the model was not fitted to, simulated from the command alone."""
    figure, panels = _panels(found, 2)
    cut, dt = int(TRAINING * len(found.record.position)), found.record.dt
    for (above, below), axis, measured in zip(
        panels, found.axes, found.record.position.T, strict=True
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


def bode(found: LinearMachineFound, control_unit: str) -> Figure:
    """Frequency response with its 95 % interval; grey where it is wider than 10 %."""
    figure, panels = _panels(found, 2)
    for (magnitude, phase), axis in zip(panels, found.axes, strict=True):
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
            _grey_out(panel, response)
    return figure


def whiteness(found: LinearMachineFound) -> Figure:
    """Correlation of neighbouring errors, inside the band if only noise is left."""
    figure, panels = _panels(found, 1)
    for (white,), axis in zip(panels, found.axes, strict=True):
        values = evidence.correlations(axis.fit)
        band = 1.96 / np.sqrt(len(axis.fit.errors))
        white.axhspan(-band, band, color="0.85")
        white.bar(np.arange(1, len(values) + 1), values, color=TUNED)
        top = max(0.15, 1.1 * float(np.abs(values).max()))
        white.set_ylim(-top, top)
        grid(white, f"{axis.name}: correlation of the errors", "lag [samples]", "")
    return figure


def _panels(found: LinearMachineFound, rows: int) -> tuple[Figure, list]:
    count = len(found.axes)
    figure = Figure(figsize=(WIDTH * count, HEIGHT * rows), layout="constrained")
    return figure, list(figure.subplots(rows, count, squeeze=False).T)


def _grey_out(panel: Axes, response: evidence.Response) -> None:
    low, high = response.band
    first, last = response.frequency[0], response.frequency[-1]
    panel.set_xlim(first, last)
    if not np.isfinite(high):
        panel.axvspan(first, last, color="0.9", zorder=0)
        return
    if low > first:
        panel.axvspan(first, low, color="0.9", zorder=0)
    if high < last:
        panel.axvspan(high, last, color="0.9", zorder=0)


def figures(control_unit: str) -> dict[str, Callable[[LinearMachineFound], Figure]]:
    """Figures by name, with the unit of the commands."""
    return {
        "prediction": prediction,
        "bode": lambda found: bode(found, control_unit),
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
