"""Figures of Tomizuka, Hu, Chiu & Kamano, drawn from a result."""

from collections.abc import Sequence
from pathlib import Path

from matplotlib.figure import Figure

from experiments.papers.synchronisation.claims import FAST, SLOW
from experiments.papers.synchronisation.result import CONTINUOUS, Result
from experiments.papers.synchronisation.runs import NOMINAL
from jcontour.app.reports.figures.axes import CYCLE, grid, legend_below
from jcontour.app.reports.figures.png import save_figures

SHOWN = 0.4  # [s] after the load


def draw(result: Result, folder: Path) -> list[Path]:
    """Save all figures as PNG files in `folder`."""
    figures = {"figures-3-to-6": continuous, "figures-9-to-11": fast, "figures-12-to-14": slow}
    return save_figures(figures, result, folder)


def continuous(result: Result) -> Figure:
    """Figs 3, 5 and 6: without coupling, with coupling, and the difference over beta."""
    return _figure(result, CONTINUOUS, (0.0, 5.0), (0.0, 1.0, 2.0, 5.0, 10.0), "continuous time")


def fast(result: Result) -> Figure:
    """Figs 9 to 11: the same, sampled every 2 ms."""
    return _figure(result, FAST, (0.0, 2.0), (0.0, 1.0, 2.0, 5.0, 10.0), "2 ms")


def slow(result: Result) -> Figure:
    """Figs 12 to 14: the same, sampled every 10 ms; at beta = 4 it diverges."""
    return _figure(result, SLOW, (0.0, 3.0), (0.0, 1.0, 2.0, 3.0, 3.5), "10 ms")


def _figure(
    result: Result, period_ms: float, shown: Sequence[float], betas: Sequence[float], title: str
) -> Figure:
    """Both errors at two couplings, and the difference at many."""
    figure = Figure(figsize=(11.0, 4.2), layout="constrained")
    panels = figure.subplots(1, 3)
    for axes, beta in zip(panels[:2], shown, strict=True):
        curve = result.curve(NOMINAL, period_ms, beta)
        time = curve.time_s - curve.time_s[0]
        axes.plot(time, curve.e1, color=CYCLE[0], label="e1, no load")
        axes.plot(time, curve.e2, color=CYCLE[1], label="e2, load")
        grid(axes, f"errors, beta = {beta:g}", "time after the load [s]", "speed [per unit]")
    for k, beta in enumerate(betas):
        curve = result.curve(NOMINAL, period_ms, beta)
        time, colour = curve.time_s - curve.time_s[0], CYCLE[k % len(CYCLE)]
        panels[2].plot(time, curve.apart, color=colour, label=f"e1 - e2, beta = {beta:g}")
    grid(panels[2], "synchronisation error", "time after the load [s]", "")
    low = min(axes.get_ylim()[0] for axes in panels)
    high = max(axes.get_ylim()[1] for axes in panels)
    for axes in panels:
        axes.set(xlim=(0.0, SHOWN), ylim=(low, high))
    figure.suptitle(f"Step of load on axis 2, {title}; the axes are ours")
    legend_below(figure, columns=4)
    return figure
