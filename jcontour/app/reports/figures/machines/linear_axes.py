"""Figures to trust an identified machine by: prediction, whiteness, Bode plot, coupling."""

from collections.abc import Callable

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from jcontour.app.reports.figures.shared.axes import DESIRED, START, TUNED, grid, plain_ticks
from tuning.identification.linear import evidence
from tuning.identification.linear.found import LinearMachineFound
from tuning.identification.linear.order_search import TRAINING

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


def residuals(found: LinearMachineFound) -> Figure:
    """Correlation of neighbouring errors, inside the band if only noise is left; the orders."""
    figure, panels = _panels(found, 2)
    for (white, orders), axis in zip(panels, found.axes, strict=True):
        values = evidence.correlations(axis.fit)
        band = 1.96 / np.sqrt(len(axis.fit.errors))
        white.axhspan(-band, band, color="0.85")
        white.bar(np.arange(1, len(values) + 1), values, color=TUNED)
        top = max(0.15, 1.1 * float(np.abs(values).max()))
        white.set_ylim(-top, top)
        grid(white, f"{axis.name}: correlation of the errors", "lag [samples]", "")
        best = axis.choice.all[0].loss
        for one in axis.choice.all:
            chosen = one.structure == axis.choice.best.structure
            orders.semilogy(
                one.structure.poles + one.structure.integrators,
                np.sqrt(one.loss / best),
                "o" if chosen else ".",
                color=TUNED if chosen else "0.5",
            )
        plain_ticks(orders.yaxis)
        orders.xaxis.set_major_locator(MaxNLocator(integer=True))
        grid(orders, "held-out error of every order tried (blue: taken)", "order", "over the best")
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
        "residuals": residuals,
    }
