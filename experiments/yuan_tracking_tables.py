"""What `jcontour reproduce yuan-tracking` prints."""

from typing import Any

from rich.console import Console
from rich.table import Table

from experiments.tables import digits, plain_table, worded_table
from experiments.yuan_tracking_claims import COLUMNS, row_of

HEADINGS = ("motor\nmax mm", "motor\nmean mm", "tool\nmax mm", "tool\nmean mm", "deformation\nmax mm", "effort\nA")


def show(summary: dict[str, Any], console: Console) -> None:
    """Tables 3.1 and 3.2, the ranking, the gap of the twin, and the verdicts."""
    for task, number in (("A", "3.1"), ("B", "3.2")):
        console.print(_table(summary, task, number))
    console.print(_ranking(summary))
    rows = [[f"{row['sharpness']:g}", *(f"{100 * row[task]:.4f}" for task in "AB")] for row in summary["gap"]]
    title = "Smooth twin against true axis: gap in RMS end-effector error, thesis's cascade"
    console.print(plain_table(title, ["sharpness s/m", "task A %", "task B %"], rows, text_columns=0))
    words = [(row["item"], row["claim"], row["finding"], row["verdict"]) for row in summary["claims"]]
    console.print(worded_table("Statements", ("where", "the claim", "the simulation", "verdict"), words))


def _table(summary: dict[str, Any], task: str, number: str) -> Table:
    rows = []
    for entry in summary["tables"]:
        if entry["task"] != task:
            continue
        paper = [f"{entry['paper'][c]:.3f}" for c in COLUMNS]
        rows.append([entry["name"], *paper, f"{1e3 * entry['paper_time_ms']:.1f}", entry["verdict"]])
        for name, ours in entry["ours"].items():
            rows.append([f"  ours: {name}", *(f"{ours[c]:.3f}" for c in COLUMNS), f"{ours['time_us']:.2f}", ""])
    columns = ["controller", *HEADINGS, "computing\nus", "verdict"]
    return plain_table(f"Table {number}, task {task}: the test bench, and our simulation of its model below", columns, rows)


def _ranking(summary: dict[str, Any]) -> Table:
    """From the smallest mean error of the end effector, both tasks together."""
    pace = row_of(summary["ranking"], "cascade")["time_us"]
    ranked = sorted(summary["ranking"], key=lambda row: row["A"]["ee_mean"] + row["B"]["ee_mean"])
    rows = [
        [row["controller"], row["gains"], *(digits(row[task][c]) for task in "AB" for c in ("em_mean", "ee_mean", "def_max", "u_mean")),
         f"{row['time_us'] / pace:.1f}"]
        for row in ranked
    ]  # fmt: skip
    headings = ("motor\nmm", "tool\nmm", "deform.\nmm", "effort\nA")
    columns = ["controller", "gains", *(f"{task}: {heading}" for task in "AB" for heading in headings)]
    title = f"Ranking: mean errors, largest deformation, mean current; computing per sample against the cascade's ({pace:.2g} us here)"
    return plain_table(title, [*columns, "computing\nx cascade"], rows, text_columns=2)
