"""Tables that `jcontour reproduce yuan-tracking` prints."""

from rich.console import Console
from rich.table import Table

from experiments.papers.verdicts import claims_table
from experiments.papers.yuan_tracking.claims import row_of
from experiments.papers.yuan_tracking.result import TASKS, Columns, RankingRow, Result, TableRow
from jcontour.app.reports.tables import plain_table, worded_table

NUMBERS = {"A": "3.1", "B": "3.2"}  # of the tables
HEADINGS = {
    "em_max": "motor\nmax",
    "em_mean": "motor\nmean",
    "ee_max": "tool\nmax",
    "ee_mean": "tool\nmean",
    "def_max": "deform.\nmax",
    "u_mean": "effort",
}
RANKED = {"em_mean": "motor", "ee_mean": "tool", "def_max": "def.", "u_mean": "effort"}


def show(result: Result, console: Console) -> None:
    """Tables 3.1 and 3.2, the ranking, the gap of the twin, and the verdicts."""
    for task in TASKS:
        console.print(_table(result, task))
        console.print()
    console.print(_ranking(result))
    console.print(_gap(result))
    console.print(claims_table(result.claims))


def _table(result: Result, task: str) -> Table:
    rows = [cells for row in result.tables if row.task == task for cells in _with_ours(row)]
    title = (
        f"Table {NUMBERS[task]}, task {task}: the test bench, and below each row our simulation "
        "of its model [mm, A, us per sample]"
    )
    return worded_table(title, ("case", *HEADINGS.values(), "time", "verdict"), rows)


def _with_ours(row: TableRow) -> list[list[str]]:
    """The row of the paper, then ours."""
    cells = [_cells(row.name, row.paper, 1e3 * row.paper_time_ms, row.verdict.value)]
    ours = [_cells(f"ours: {name}", one, one.time_us, "") for name, one in row.ours.items()]
    return cells + ours


def _cells(name: str, columns: Columns, microseconds: float, verdict: str) -> list[str]:
    numbers = [f"{getattr(columns, column):.3f}" for column in HEADINGS]
    return [name, *numbers, f"{microseconds:.3g}", verdict]


def _ranking(result: Result) -> Table:
    """All controllers, the smallest mean error of the end effector first, both tasks together."""
    pace = row_of(result.ranking, "cascade").time_us
    ranked = sorted(result.ranking, key=lambda row: row.error)
    rows = [_ranked(row, pace) for row in ranked]
    columns = [f"{task}\n{heading}" for task in TASKS for heading in RANKED.values()]
    title = (
        "Ranking: mean errors of motor and tool, largest deformation (mm), mean current (A); "
        f"time per sample against the cascade's ({pace:.2g} us on this computer)"
    )
    return plain_table(title, ["controller", "gains", *columns, "time"], rows, text_columns=2)


def _ranked(row: RankingRow, pace: float) -> list[str]:
    numbers = [getattr(row.on(task), column) for task in TASKS for column in RANKED]
    words = [f"{number:.3f}" for number in numbers]
    return [row.controller, row.gains, *words, f"{row.time_us / pace:.1f}"]


def _gap(result: Result) -> Table:
    rows = [
        [f"{row.sharpness:g}", f"{100 * row.A:.4f}", f"{100 * row.B:.4f}"] for row in result.gap
    ]
    title = "Smooth twin against true axis: gap in RMS end-effector error, thesis's cascade"
    return plain_table(title, ["sharpness s/m", "task A %", "task B %"], rows, text_columns=0)
