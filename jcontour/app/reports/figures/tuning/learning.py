"""The figure of learning: error over laps, one curve for each machine."""

from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from jcontour.app.files.results.learned_result import LearnedResult
from jcontour.app.reports.figures.shared.axes import grid, legend_below, plain_ticks


def learning(result: LearnedResult) -> Figure:
    """RMS error of the tool over laps, and what noise alone makes; a cross where one diverges."""
    figure = Figure(figsize=(7.5, 5.5), layout="constrained")
    axes = figure.subplots()
    for one in result.machines:
        laps = range(1, len(one.tool_um) + 1)
        (line,) = axes.plot(laps, one.tool_um, marker=".", linewidth=1.0, label=one.name)
        if one.diverged is not None:
            axes.plot(laps[-1], one.tool_um[-1], "x", color=line.get_color())
    if result.noise_um > 0:
        axes.axhline(result.noise_um, color="0.5", linestyle=":", label="noise without learning")
    axes.set(yscale="log")
    plain_ticks(axes.yaxis)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    grid(axes, f"{result.law} on {result.contour}", "lap", f"RMS {result.error} error [um]")
    legend_below(figure, columns=2)
    return figure
