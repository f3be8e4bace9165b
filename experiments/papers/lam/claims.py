"""Statements of Lam, Manzie & Good about the X-Y table: verdicts and figures."""

from collections.abc import Iterator
from itertools import product

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from experiments.papers.lam.experiment import (
    CONTROLLERS,
    MPCC_4MS,
    MPTC_4MS,
    PI_1MS,
    PI_4MS,
    Result,
)
from experiments.papers.panels import Curve, Panel, drawn
from experiments.papers.verdicts import Claim, verdict
from experiments.tables import where

SIMILAR = 1.25  # ratio of errors up to which two controllers perform similarly
MUCH_BETTER = 2.0  # ratio of errors from which one is much better
SLOWS = -0.3  # correlation of speed and curvature below which the speed clearly falls
FEW = 4  # curves that may break a rule which holds on the whole


def claims(result: Result) -> Iterator[Claim]:
    """Every statement of section 5 with what is found on all the plants."""
    correlations = []
    for trace in result.traces:
        start = len(trace.speed_mm_s) // 20  # the tool starts from rest
        curvature = np.abs(trace.curvature_per_mm)[start:]
        correlations.append(float(np.corrcoef(trace.speed_mm_s[start:], curvature)[0, 1]))
    pairs = zip(correlations, result.traces, strict=True)
    words = ", ".join(f"{value:.2f} at q_theta = {trace.q_theta:g}" for value, trace in pairs)
    yield Claim(
        "Fig. 10",
        "the path speed falls around the tight curves",
        f"correlation of speed and curvature {words}",
        verdict(max(correlations) < SLOWS, max(correlations) < 0),
    )
    speeds = [float(np.mean(trace.speed_mm_s)) for trace in result.traces]
    errors = [float(np.sqrt(np.mean(np.square(trace.contour_error_um)))) for trace in result.traces]
    yield Claim(
        "Figs 10, 11",
        "q_theta = 0.03 traces more slowly and more accurately than q_theta = 5",
        f"mean speed {speeds[0]:.0f} against {speeds[1]:.0f} mm/s, "
        f"RMS contour error {errors[0]:.1f} against {errors[1]:.1f} um",
        verdict(speeds[0] < speeds[1] and errors[0] < errors[1]),
    )
    broken = [
        f"{controller} on {plant}"
        for controller, plant in product(CONTROLLERS, result.plants)
        if np.any(np.diff(curve(result, controller, plant)[1]) > 0)
    ]
    yield Claim(
        "Fig. 13",
        "every controller is more accurate the longer it takes",
        f"fails for {'; '.join(broken)}" if broken else "holds for every controller and plant",
        verdict(not broken, len(broken) < FEW),
    )
    slow, words = _over_mpcc(result, -1)
    similar = [1 / SIMILAR <= ratio <= SIMILAR for ratio in slow]
    yield Claim(
        "Fig. 13",
        "MPCC performs similarly to PI at 1 ms at low speed",
        words,
        verdict(bool(slow) and all(similar), any(similar)),
    )
    fast, words = _over_mpcc(result, 0)
    least = min(fast, default=0.0)
    yield Claim(
        "Fig. 13",
        "MPCC is much more accurate than PI at 1 ms at high speed",
        words,
        verdict(least >= MUCH_BETTER, least > 1),
    )
    lost, won = [], 0
    for other, plant in product((MPTC_4MS, PI_4MS), result.plants):
        for time, ratio in _against(result, other, plant).T:
            if ratio > 1:
                won += 1
            else:
                lost.append(f"{other} on {plant} at {time:.2f} s ({ratio:.2f} x MPCC's error)")
    words = f"MPCC is ahead in {won} of {won + len(lost)} comparisons"
    yield Claim(
        "Fig. 13",
        "at the same sample rate MPCC outperforms the others over the whole range of times",
        f"{words}; behind {', '.join(lost)}" if lost else words,
        verdict(not lost and won > 0, won > len(lost)),
    )


def curve(result: Result, controller: str, plant: str) -> Float[np.ndarray, "two runs"]:
    """Curve of Fig. 13: times [s], from short to long, and RMS errors [% of the largest radius].

    Runs that do not reach the end are left out.
    """
    runs = where(result.trade_off, controller=controller, plant=plant, finished=True)
    points = sorted((run.time_s, run.rms_percent) for run in runs)
    return np.reshape(points, (-1, 2)).T


def _against(result: Result, other: str, plant: str) -> Float[np.ndarray, "two runs"]:
    """Times of the other controller within MPCC's range, and its error over MPCC's there."""
    times, errors = curve(result, other, plant)
    mpcc_times, mpcc_errors = curve(result, MPCC_4MS, plant)
    if mpcc_times.size == 0:
        return np.zeros((2, 0))
    inside = (times >= mpcc_times[0]) & (times <= mpcc_times[-1])
    mpcc_there = np.interp(times[inside], mpcc_times, mpcc_errors)
    return np.stack([times[inside], errors[inside] / mpcc_there])


def _over_mpcc(result: Result, place: int) -> tuple[list[float], str]:
    """Ratio of the errors at the longest or shortest time in MPCC's range, plant by plant."""
    ratios, words = [], []
    for plant in result.plants:
        pairs = _against(result, PI_1MS, plant)
        if pairs.size:
            time, ratio = pairs[:, place]
            ratios.append(float(ratio))
            words.append(f"{ratio:.2f} at {time:.2f} s ({plant})")
    if not ratios:
        return [], f"no run of {PI_1MS} within the range of MPCC's times"
    return ratios, f"error of {PI_1MS} over MPCC's: {', '.join(words)}"


COLOURS = dict(zip(CONTROLLERS, ("tab:blue", "tab:green", "tab:orange", "tab:red"), strict=True))
TRACE_COLOURS = ("tab:blue", "tab:orange")
MAGNIFIED = 50.0  # contour error in Fig. 8, which else could not be seen


def contour(result: Result) -> Figure:
    """Fig. 8: the path and the tool, the distance between them enlarged."""
    dashed = {"color": "0.3", "linestyle": "--", "linewidth": 0.8}
    curves = [Curve(*result.points_mm.T, "path", dashed)]
    for colour, trace in zip(TRACE_COLOURS, result.traces, strict=True):
        enlarged = trace.foot_mm + MAGNIFIED * (trace.tool_mm - trace.foot_mm)
        style = {"color": colour, "linewidth": 1.0}
        curves.append(Curve(*enlarged.T, f"q_theta = {trace.q_theta:g}", style))
    title = f"Fig. 8: MPCC, contour error x {MAGNIFIED:g}, friction plant"
    return drawn([Panel(title, "x [mm]", "y [mm]", curves, {"aspect": "equal"})], (6.5, 6.5))


def along_the_path(result: Result) -> Figure:
    """Figs 9 to 11: currents, path speed and contour error over the path parameter."""
    x, margin = "path parameter theta [mm]", {"xmargin": 0.01}
    labels = ("i_x [A]", "i_y [A]", "path speed [mm/s]", "contour error [um]")
    panels = [Panel("", x, label, [], margin) for label in labels]
    for colour, trace in zip(TRACE_COLOURS, result.traces, strict=True):
        name, style = f"q_theta = {trace.q_theta:g}", {"color": colour, "linewidth": 0.9}
        signals = (*trace.control_a.T, trace.speed_mm_s, trace.contour_error_um)
        for panel, values in zip(panels, signals, strict=True):
            panel.curves.append(Curve(trace.theta_mm, values, name, style))
    title = "Figs 9, 10, 11: MPCC on the friction plant"
    return drawn(panels, (8.0, 9.0), title, legend=2, sharex=True)


def trade_off(result: Result) -> Figure:
    """Fig. 13: RMS contour error over traversal time, one panel for each plant."""
    panels = []
    for plant in result.plants:
        curves = []
        for controller, colour in COLOURS.items():
            style = {"color": colour, "marker": "o", "markersize": 4, "linewidth": 1.0}
            curves.append(Curve(*curve(result, controller, plant), controller, style))
        y, log = "RMS contour error [% of the largest radius]", {"yscale": "log"}
        panels.append(Panel(f"{plant} plant", "traversal time [s]", y, curves, log))
    count, title = len(panels), "Fig. 13: accuracy against traversal time"
    size = (max(5.5, 4.2 * count), 4.6)
    return drawn(panels, size, title, columns=count, legend=4, sharey=True)


FIGURES = {"figure-8": contour, "figures-9-to-11": along_the_path, "figure-13": trade_off}
