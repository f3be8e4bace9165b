"""Tables that `jcontour reproduce lam` prints."""

from rich.console import Console

from experiments.papers.lam.result import Point, Result
from experiments.papers.verdicts import claims_table
from jcontour.app.reports.tables import digits, plain_table

COLUMNS = (
    "controller",
    "plant",
    "setting",
    "time s",
    "RMS contour\nerror %",
    "RMS\num",
    "peak\num",
    "at a limit\n% of steps",
)


def show(result: Result, console: Console) -> None:
    """Fig. 13 in numbers, then the verdicts."""
    title = f"Fig. 13: errors are in % of the largest radius, {result.path.max_radius_mm:g} mm"
    rows = [_cells(point) for point in result.trade_off]
    console.print(plain_table(title, COLUMNS, rows, text_columns=3))
    console.print(claims_table(result.claims))


def _cells(point: Point) -> list[str]:
    time = digits(point.time_s) if point.finished else "did not arrive"
    errors = (point.rms_percent, point.rms_um, point.peak_um, point.limited_percent)
    return [point.controller, point.plant, point.setting, time, *map(digits, errors)]
