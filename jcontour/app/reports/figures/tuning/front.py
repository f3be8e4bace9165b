"""The figure of a front: error against what is spent of the budgets."""

from collections.abc import Sequence

from matplotlib.figure import Figure

from jcontour.app.files.results.front_result import BudgetPoint, FrontResult
from jcontour.app.reports.figures.shared.axes import TUNED, grid, legend_below, logarithmic


def front(result: FrontResult) -> Figure:
    """Least worst error of every budget.

    A filled marker is a budget that is used up, a square one that is slack, an open marker one that
    no weights met.
    """
    figure = Figure(figsize=(7.0, 5.0), layout="constrained")
    axes = figure.subplots()
    # a loop that is not stable has no finite peak, and no place here
    points = [point for point in result.points if _finite(point, result)]
    met = [point for point in points if point.feasible]
    kinds = {
        "tuned for this budget": ("o", TUNED, [point for point in met if not point.slack]),
        "budget is slack": ("s", TUNED, [point for point in met if point.slack]),
        "budget not met": ("o", "none", [point for point in points if not point.feasible]),
    }
    axes.plot(*_places(met, result), color=TUNED, linewidth=1.0)
    for label, (marker, face, shown) in kinds.items():
        if shown:
            axes.plot(*_places(shown, result), marker, color=TUNED, mfc=face, label=label)
    unit = result.machine.control_unit
    against = {
        "increment": f"worst RMS control increment [{unit} per sample]",
        "sensitivity": "largest peak sensitivity Ms",
    }
    plants = "the nominal plant" if result.nominal_only else "contours and family"
    grid(
        axes,
        title=f"Front over {plants} (smooth machine)",
        x=against[result.against],
        y=f"worst RMS {result.error} error [um]",
    )
    logarithmic(axes)
    legend_below(figure)
    return figure


def _finite(point: BudgetPoint, result: FrontResult) -> bool:
    return point.spent(result.against) < float("inf")


def _places(points: Sequence[BudgetPoint], result: FrontResult) -> tuple[list[float], list[float]]:
    spent = [point.spent(result.against) for point in points]
    return spent, [1e6 * point.error(result.error) for point in points]
