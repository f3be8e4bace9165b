"""Figures of Yuan's chapter 5, drawn from a result."""

import numpy as np
from matplotlib.figure import Figure

from experiments.papers.panels import Curve, Panel, drawn
from experiments.papers.yuan_gantry.claims import LARGEST_TWIST, PRINTED_HZ
from experiments.papers.yuan_gantry.experiment import Result

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


def bode(result: Result) -> Figure:
    """Fig. 5.6: gain and phase from the current i_1 to the speed of its drive."""
    gain, phase = [], []
    for row in result.responses:
        if (row.head_m, row.coupling) not in STYLES:
            continue  # as printed, (5.12) does not know the side
        colour, line = STYLES[row.head_m, row.coupling]
        style = {"color": colour, "linestyle": line, "linewidth": 1.1}
        coupling = "coupling kept" if row.coupling else "as printed"
        name = f"head at {row.head_m:g} m, {coupling}: {row.antiresonance_hz:.1f} Hz"
        gain.append(Curve(row.frequency_hz, row.gain_db, name, style))
        phase.append(Curve(row.frequency_hz, row.phase_deg, name, style))
    title, axes = "Fig. 5.6: from i_1 to the speed of drive 1", {"xscale": "log", "xlim": SHOWN_HZ}
    figure = drawn(
        [
            Panel(title, "", "gain [dB re 1 m/s per A]", gain, axes),
            Panel("", "frequency [Hz]", "phase [deg]", phase, axes),
        ],
        (8.0, 6.5),
        legend=2,
        sharex=True,
    )
    upper, lower = figure.axes
    for head, frequency in PRINTED_HZ.items():
        upper.axvline(frequency, color=STYLES[head, False][0], linewidth=0.6, alpha=0.6)
    lower.set_xticks(TICKS_HZ, [str(tick) for tick in TICKS_HZ])
    lower.minorticks_off()
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
    error, twist, time = [], [], result.emulated.time_s
    for row in result.emulated.rows:
        style = {"linewidth": 0.9, **HEADS[row.name]}
        if not row.diverged:
            error.append(Curve(time, 1e6 * row.contour_error_m, row.name, style))
        twist.append(Curve(time, 1e6 * np.abs(row.twist_rad), row.name, style))
    dashed = {"color": "0.5", "linestyle": "--", "linewidth": 0.8}
    twist.append(Curve(None, 1e6 * LARGEST_TWIST, "allowed twist", dashed))
    log = {"yscale": "log", "xmargin": 0.01}
    panels = [
        Panel("", "", "contour error [um]", error, {**log, "ylim": (1e-1, None)}),
        Panel("", "time [s]", "twist of the beam [urad]", twist, {**log, "ylim": (1e-4, None)}),
    ]
    title = "Section 5.6: a motor bench as the head of the gantry"
    return drawn(panels, (9.0, 7.0), title, sharex=True)


FIGURES = {"figure-5-6": bode, "figures-5-11-and-5-13": path, "section-5-6": bench}
