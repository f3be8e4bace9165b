"""Figures of Yuan's chapter 5, drawn from a result."""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from experiments.papers.yuan_gantry.claims import LARGEST_TWIST, PRINTED_HZ
from experiments.papers.yuan_gantry.result import Response, Result
from jcontour.app.reports.figures.axes import legend_below
from jcontour.app.reports.figures.png import save_figures

STYLES = {  # (head [m], coupling kept) -> colour, line
    (0.0, False): ("tab:blue", "-"),
    (-0.66, False): ("tab:orange", "-"),
    (-0.66, True): ("tab:orange", "--"),
    (0.66, True): ("tab:green", "--"),
}
SHOWN_HZ = (10.0, 120.0)
TICKS_HZ = (10, 20, 30, 40, 50, 60, 80, 100)
HEADS = {  # kind of head -> its line; wide lines show beneath narrow ones that cover them
    "gantry": {"color": "black", "linewidth": 3.0, "alpha": 0.35},
    "at once, no dry friction": {"color": "tab:blue"},
    "at once, no dry friction, undamped": {"color": "tab:orange"},
    "at once, dry friction": {"color": "tab:green", "linewidth": 2.5, "alpha": 0.6},
    "late, no dry friction": {"color": "tab:purple", "linestyle": "--"},
    "late, dry friction": {"color": "tab:red"},
    "late, dry friction, undamped": {"color": "tab:brown"},
}


def draw(result: Result, folder: Path) -> list[Path]:
    """Save all figures as PNG files in `folder`."""
    figures = {
        "figure-5-6": bode,
        "figures-5-11-and-5-13": path,
        "section-5-6": bench,
    }
    return save_figures(figures, result, folder)


def bode(result: Result) -> Figure:
    """Fig. 5.6: gain and phase from the current i_1 to the speed of its drive."""
    figure = Figure(figsize=(8.0, 6.5), layout="constrained")
    gain, phase = figure.subplots(2, 1, sharex=True)
    for row in result.responses:
        if (row.head_m, row.coupling) not in STYLES:
            continue  # as printed, (5.12) does not know the side
        colour, line = STYLES[row.head_m, row.coupling]
        style = {"color": colour, "linestyle": line, "linewidth": 1.1}
        gain.plot(row.frequency_hz, row.gain_db, label=_response_name(row), **style)
        phase.plot(row.frequency_hz, row.phase_deg, **style)
    for head, frequency in PRINTED_HZ.items():
        gain.axvline(frequency, color=STYLES[head, False][0], linewidth=0.6, alpha=0.6)
    gain.set(xscale="log", xlim=SHOWN_HZ, ylabel="gain [dB re 1 m/s per A]")
    gain.set(title="Fig. 5.6: from i_1 to the speed of drive 1")
    phase.set(xlabel="frequency [Hz]", ylabel="phase [deg]")
    phase.set_xticks(TICKS_HZ, [str(tick) for tick in TICKS_HZ])
    phase.minorticks_off()
    for axes in (gain, phase):
        axes.grid(color="0.9")
    legend_below(figure, gain, columns=2)
    return figure


def path(result: Result) -> Figure:
    """Fig. 5.11, and along it the twist (Fig. 5.13) and the contour error."""
    found = result.path
    figure = Figure(figsize=(10.0, 5.0), layout="constrained")
    panels = figure.subplot_mosaic([["plan", "twist"], ["plan", "error"]], width_ratios=(1, 1.4))
    plan, twist, error = (panels[name] for name in ("plan", "twist", "error"))
    plan.plot(*(1e3 * found.wanted_m).T, color="0.5", linewidth=2.5, label="path")
    plan.plot(*(1e3 * found.tool_m).T, color="tab:blue", linewidth=0.9, label="tool")
    plan.set(aspect="equal", xlabel="x [mm]", ylabel="y [mm]")
    plan.set(title="Fig. 5.11: line, circle, line")
    plan.legend(frameon=False, loc="center")
    twist.plot(found.time_s, 1e6 * found.twist_rad, color="tab:blue", linewidth=0.9)
    twist.sharex(error)
    peak, allowed = 1e6 * found.peak_twist_rad, 1e6 * LARGEST_TWIST
    twist.set(ylabel="twist of the beam [urad]", title=f"peak {peak:.3g}, allowed {allowed:g} urad")
    error.plot(found.time_s, 1e6 * found.contour_error_m, color="tab:red", linewidth=0.9)
    error.set(xlabel="time [s]", ylabel="contour error [um]")
    for axes in (twist, error):
        axes.grid(color="0.9")
        axes.margins(x=0.01)
    return figure


def bench(result: Result) -> Figure:
    """Section 5.6: contour error and twist with a bench as the head, damped and undamped.

    A run that loses its contour has no contour error in the figure.
    """
    found = result.emulated
    figure = Figure(figsize=(9.0, 7.0), layout="constrained")
    error, twist = figure.subplots(2, 1, sharex=True)
    for row in found.rows:
        style = {"linewidth": 0.9, **HEADS[row.name], "label": row.name}
        if not row.diverged:
            error.plot(found.time_s, 1e6 * row.contour_error_m, **style)
        twist.plot(found.time_s, 1e6 * np.abs(row.twist_rad), **style)
    allowed = 1e6 * LARGEST_TWIST
    twist.axhline(allowed, color="0.5", linestyle="--", linewidth=0.8, label="allowed twist")
    error.set(yscale="log", ylim=(1e-1, None), ylabel="contour error [um]")
    error.set(title="Section 5.6: a motor bench as the head of the gantry")
    twist.set(yscale="log", ylim=(1e-4, None), xlabel="time [s]", ylabel="twist of the beam [urad]")
    for axes in (error, twist):
        axes.grid(color="0.9")
        axes.margins(x=0.01)
    legend_below(figure, twist, columns=3)
    return figure


def _response_name(row: Response) -> str:
    coupling = "coupling kept" if row.coupling else "as printed"
    return f"head at {row.head_m:g} m, {coupling}: {row.antiresonance_hz:.1f} Hz"
