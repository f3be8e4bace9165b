"""Figure of `jcontour feed`: error against cycle time, a point for every feed."""

from matplotlib.figure import Figure

from jcontour.app.files.results.feed_result import FeedResult
from jcontour.app.reports.figures.shared.axes import TUNED, grid, legend_below, logarithmic


def feeds_figure(result: FeedResult) -> Figure:
    """Peak and RMS of the family's worst, and the nominal RMS; the recommended feed is ringed."""
    figure = Figure(figsize=(7.0, 4.8), layout="constrained")
    axes = figure.subplots()
    points = [point for point in result.points if not point.diverged]
    time = [point.cycle_time for point in points]
    for label, plant, name, style in (
        ("peak, worst of the family", "worst", "peak", "o-"),
        ("RMS, worst of the family", "worst", "rms", "s-"),
        ("RMS, nominal", "nominal", "rms", "^--"),
    ):
        metric = f"{name}_{result.error}_error"
        error = [1e6 * getattr(getattr(point.metrics, plant), metric) for point in points]
        axes.plot(time, error, style, markersize=4, linewidth=1.0, label=label)
        if label.startswith("peak"):
            for point, at, height in zip(points, time, error, strict=True):
                words = f"{point.override:g} %" + ("" if point.sound else ", beyond limits")
                place = {"xytext": (2, 4), "textcoords": "offset points"}
                axes.annotate(words, (at, height), rotation=50, fontsize=8, **place)
                if point.override == result.recommended:
                    ring = {"markersize": 12, "mfc": "none", "color": TUNED}
                    axes.plot([at], [height], "o", label="recommended", **ring)
    if result.tolerance is not None:
        tolerance = 1e6 * result.tolerance
        axes.axhline(tolerance, color="0.3", linestyle="--", label=f"tolerance {tolerance:g} um")
    logarithmic(axes)
    axes.margins(x=0.08, y=0.15 if all(point.sound for point in points) else 0.4)  # for the words
    title = f"{result.contour} on {result.machine.name}, {result.controller}"
    grid(axes, title, "cycle time [s]", f"{result.error} error [um]")
    legend_below(figure)
    return figure
