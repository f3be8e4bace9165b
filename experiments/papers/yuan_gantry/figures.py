"""The figures of Yuan's chapter 5, drawn from the numbers of a run."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from experiments.papers.yuan_gantry.claims import LARGEST_TWIST, PRINTED_HZ
from experiments.reports.png import save_figures

STYLES = {  # (head, coupling kept) -> colour, line
    (0.0, False): ("tab:blue", "-"),
    (-0.66, False): ("tab:orange", "-"),
    (-0.66, True): ("tab:orange", "--"),
    (0.66, True): ("tab:green", "--"),
}
BENCH_COLOURS = (
    "black",
    "tab:blue",
    "tab:orange",
    "tab:green",
    "tab:purple",
    "tab:red",
    "tab:brown",
)  # gantry and cases in their order
SHOWN_HZ = (10.0, 120.0)


def draw(summary: dict[str, Any], folder: Path) -> list[Path]:
    """All figures, as PNG files in `folder`."""
    figures: dict[str, Callable[[dict[str, Any]], Figure]] = {
        "figure-5-6": bode,
        "figures-5-11-and-5-13": path,
        "section-5-6": bench,
    }
    return save_figures(figures, summary, folder)


def bode(summary: dict[str, Any]) -> Figure:
    """Fig. 5.6: gain and phase from the current i_1 to the speed of its drive."""
    figure = Figure(figsize=(8.0, 6.5), layout="constrained")
    gain, phase = figure.subplots(2, 1, sharex=True)
    for row in summary["responses"]:
        key = (row["head_m"], row["coupling"])
        if key not in STYLES:
            continue  # as printed, (5.12) does not know the side
        colour, style = STYLES[key]
        label = f"head at {row['head_m']:g} m, {'coupling kept' if row['coupling'] else 'as printed'}: {row['antiresonance_hz']:.1f} Hz"
        gain.plot(
            row["frequency_hz"],
            row["gain_db"],
            color=colour,
            linestyle=style,
            linewidth=1.1,
            label=label,
        )
        phase.plot(
            row["frequency_hz"], row["phase_deg"], color=colour, linestyle=style, linewidth=1.1
        )
    for head, frequency in PRINTED_HZ.items():
        gain.axvline(frequency, color=STYLES[head, False][0], linewidth=0.6, alpha=0.6)
    gain.set(
        xscale="log",
        xlim=SHOWN_HZ,
        ylabel="gain [dB re 1 m/s per A]",
        title="Fig. 5.6: from i_1 to the speed of drive 1",
    )
    gain.legend(frameon=False, loc="lower left")
    phase.set(xlabel="frequency [Hz]", ylabel="phase [deg]")
    ticks = (10, 20, 30, 40, 50, 60, 80, 100)
    phase.set_xticks(ticks, [str(tick) for tick in ticks])
    phase.minorticks_off()
    for axes in (gain, phase):
        axes.grid(color="0.9")
    return figure


def path(summary: dict[str, Any]) -> Figure:
    """Fig. 5.11, and along it the twist (Fig. 5.13) and the contour error."""
    found = summary["path"]
    figure = Figure(figsize=(10.0, 5.0), layout="constrained")
    panels = figure.subplot_mosaic([["plan", "twist"], ["plan", "error"]], width_ratios=(1, 1.4))
    plan, twist, error = (panels[name] for name in ("plan", "twist", "error"))
    plan.plot(*(1e3 * np.array(found["wanted_m"])).T, color="0.5", linewidth=2.5, label="path")
    plan.plot(*(1e3 * np.array(found["tool_m"])).T, color="tab:blue", linewidth=0.9, label="tool")
    plan.set(
        aspect="equal", xlabel="x [mm]", ylabel="y [mm]", title="Fig. 5.11: line, circle, line"
    )
    plan.legend(frameon=False, loc="upper left")
    twist.plot(found["time_s"], 1e6 * np.array(found["twist_rad"]), color="tab:blue", linewidth=0.9)
    twist.sharex(error)
    twist.set(
        ylabel="twist of the beam [urad]",
        title=f"peak {1e6 * found['peak_twist_rad']:.3g}, allowed {1e6 * LARGEST_TWIST:g} urad",
    )
    error.plot(
        found["time_s"], 1e6 * np.array(found["contour_error_m"]), color="tab:red", linewidth=0.9
    )
    error.set(xlabel="time [s]", ylabel="contour error [um]")
    for axes in (twist, error):
        axes.grid(color="0.9")
        axes.margins(x=0.01)
    return figure


def bench(summary: dict[str, Any]) -> Figure:
    """Section 5.6: contour error with a bench as the head, and the twist with and without a controller that damps it."""
    found = summary["emulated"]
    figure = Figure(figsize=(9.0, 6.0), layout="constrained")
    error, twist = figure.subplots(2, 1, sharex=True)
    for row, colour in zip(found["rows"], BENCH_COLOURS, strict=True):
        style = {"color": colour, "linewidth": 0.9, "label": row["name"]}
        if not row["diverged"]:
            error.plot(found["time_s"], 1e6 * np.array(row["contour_error_m"]), **style)
        twist.plot(found["time_s"], 1e6 * np.abs(row["twist_rad"]), **style)
    twist.axhline(1e6 * LARGEST_TWIST, color="0.5", linestyle="--", linewidth=0.8, label="allowed")
    error.set(
        yscale="log",
        ylim=(1e-1, None),
        ylabel="contour error [um]",
        title="Section 5.6: a motor bench as the head of the gantry",
    )
    twist.set(yscale="log", ylim=(1e-4, None), xlabel="time [s]", ylabel="twist of the beam [urad]")
    error.legend(
        *twist.get_legend_handles_labels(),
        frameon=False,
        loc="lower center",
        ncols=2,
        fontsize="small",
    )
    for axes in (error, twist):
        axes.grid(color="0.9")
        axes.margins(x=0.01)
    return figure
