"""Tables that `jcontour reproduce yuan-bounded` prints."""

from rich.console import Console

from experiments.papers.verdicts import claims_table
from experiments.papers.yuan_bounded.result import LeastRow, LoopRow, Result
from jcontour.app.reports.tables import plain_table

NEEDS = ("w mm/s", "speed limit m/s", "any controller needs mm")
LEAST = ("reference", "samples", "tolerance mm", "limited by")
LOOPS = ("reference", "samples", "promised mm", "largest mm", "current A", "speed m/s")


def show(result: Result, console: Console) -> None:
    """Certificates, least tolerances, closed loops, statements."""
    rows = [
        [f"{row.disturbance_mm_s:g}", f"{row.speed_limit:g}", f"{row.bound_mm:.4f}"]
        for row in result.certificates
    ]
    console.print(plain_table("Printed data: the thesis wants 4.5 mm", NEEDS, rows, 0))
    least = [_least(row) for row in result.least]
    title = "Least tolerance of finite responses, speeds relaxed to 0.25 m/s"
    console.print(plain_table(title, LEAST, least, 1))
    console.print(
        plain_table(
            "Bounded MPC under disturbances", LOOPS, [_loop(row) for row in result.loops], 1
        )
    )
    console.print(claims_table(result.claims))


def _least(row: LeastRow) -> list[str]:
    words = "none keeps the limits" if row.tolerance_mm is None else f"{row.tolerance_mm:.4g}"
    return [row.reference, str(row.length), words, ", ".join(row.limiting)]


def _loop(row: LoopRow) -> list[str]:
    numbers = (row.promised_mm, row.largest_mm, row.largest_current, row.largest_speed)
    return [row.reference, str(row.samples), *(f"{value:.4g}" for value in numbers)]
