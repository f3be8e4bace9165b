"""The figure of a ranking: held-out error of every tuned controller, contour by contour."""

from matplotlib.figure import Figure

from jcontour.app.files.results.ranked_result import RankedResult
from jcontour.app.reports.figures.shared.axes import OTHER, TUNED, grid, legend_below, plain_ticks

ROW = 0.32  # [inch]


def ranking_figure(result: RankedResult) -> Figure:
    """A bar to the geometric mean over held-out contours, a dot for each of them.

    An open bar is a controller beyond a limit; those that failed are not drawn.
    """
    rows = [row for row in result.rows if row.failure is None and row.held_out][::-1]
    figure = Figure(figsize=(7.5, 1.8 + ROW * max(len(rows), 1)), layout="constrained")
    axes = figure.subplots()
    kinds = {
        "geometric mean": (TUNED, [k for k, row in enumerate(rows) if row.feasible]),
        "beyond a limit": ("none", [k for k, row in enumerate(rows) if not row.feasible]),
    }
    for label, (face, places) in kinds.items():
        if places:
            typical = [1e6 * (rows[k].held_out or 0.0) for k in places]
            axes.barh(places, typical, 0.6, color=face, edgecolor=TUNED, label=label)
    errors = [
        (1e6 * e, k) for k, row in enumerate(rows) for e in (row.held_out_errors or {}).values()
    ]
    if errors:
        axes.plot(*zip(*errors, strict=True), "o", ms=4, mfc=OTHER, mec="0.25", label="one contour")
    axes.set_yticks(range(len(rows)), [row.label for row in rows])
    grid(
        axes,
        title=f"{result.machine.name}: held-out contours after {result.evaluations} evaluations",
        x=f"worst RMS {result.error} error of the family [um]",
        y="",
    )
    if rows:
        axes.set_xscale("log")
        smallest = min(error for error, _ in errors)
        axes.set_xlim(left=0.7 * smallest)
        plain_ticks(axes.xaxis)
        legend_below(figure)
    return figure
