"""Tables that `jcontour reproduce yuan-contouring-bounded` prints."""

from rich.console import Console

from experiments.papers.verdicts import claims_table
from experiments.papers.yuan_contouring_bounded.result import LoopRow, Result
from jcontour.app.reports.tables import digits, plain_table

KEPT = (
    "controller, models",
    "machine,\nwhat acts",
    "states",
    "promised\num",
    "reached\num",
    "X, Y\npromised",
    "X, Y\nreached",
    "twist\nurad",
    "current\nA",
)
BOXES = (
    "controller, models",
    "machine,\nwhat acts",
    "model\nerror A",
    "needed\nof it",
    "met\nof it",
    "motors\nof 0.5 A",
    "QPs un-\nsolved",
    "step ms\nmedian",
    "step ms\nlargest",
)


def show(result: Result, console: Console) -> None:
    """Print the promises, the boxes of the disturbances, Algorithm 2 and the statements."""
    title = "Fig. 5.11: contour error, the thesis wants 4 mm"
    console.print(plain_table(title, KEPT, [_kept(row) for row in result.loops], 2))
    title = "What the tubes are made for, and what the runs met"
    console.print(plain_table(title, BOXES, [_boxes(row) for row in result.loops], 2))
    one = result.polygons
    rows = [
        ["printed", "10, 10", f"{one.printed_side_mm:.3f}", f"{one.radius_mm:.3f}"],
        ["found", f"{one.inner}, {one.outer}", f"{one.side_mm:.3f}", f"{one.radius_mm:.3f}"],
    ]
    columns = ("Algorithm 2", "sides", "l_side mm", "R mm")
    console.print(plain_table("Polygons in the ring of 4 mm", columns, rows, 2))
    console.print(claims_table(result.claims))


def _kept(row: LoopRow) -> list[str]:
    axes = "-" if row.promised_axes_um is None else _pair(row.promised_axes_um)
    reached = "diverged" if row.diverged else digits(row.reached_um)
    return [
        row.label,
        row.place,
        str(row.states),
        digits(row.promised_um),
        reached,
        axes,
        _pair(row.reached_axes_um),
        digits(row.reached_twist_urad),
        digits(row.current_a),
    ]


def _boxes(row: LoopRow) -> list[str]:
    shares = (row.remainder_a, row.closed, row.remainder_share, row.motor_share)
    return [
        row.label,
        row.place,
        *map(digits, shares),
        str(row.unsolved),
        digits(row.median_ms),
        digits(row.slowest_ms),
    ]


def _pair(values: tuple[float, float]) -> str:
    return ", ".join(f"{value:.3g}" for value in values)
