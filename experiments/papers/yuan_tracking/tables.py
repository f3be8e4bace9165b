"""What `jcontour reproduce yuan-tracking` prints."""

from typing import Any

from rich.console import Console
from rich.table import Table

from experiments.papers.yuan_tracking.claims import row_of
from experiments.reports.tables import plain_table, worded_table

HEADINGS = (
    ("em_max", "motor\nmax"),
    ("em_mean", "motor\nmean"),
    ("ee_max", "tool\nmax"),
    ("ee_mean", "tool\nmean"),
    ("def_max", "deform.\nmax"),
    ("u_mean", "effort"),
)
RANKED = {"em_mean": "motor", "ee_mean": "tool", "def_max": "def.", "u_mean": "effort"}


def show(summary: dict[str, Any], console: Console) -> None:
    """Tables 3.1 and 3.2, the ranking, the gap of the twin, and the verdicts."""
    for task, number in (("A", "3.1"), ("B", "3.2")):
        console.print(_table(summary, task, number))
        console.print()
    console.print(_ranking(summary))
    rows = [
        [f"{row['sharpness']:g}", *(f"{100 * row[task]:.4f}" for task in "AB")]
        for row in summary["gap"]
    ]
    title = "Smooth twin against true axis: gap in RMS end-effector error, thesis's cascade"
    console.print(
        plain_table(title, ["sharpness s/m", "task A %", "task B %"], rows, text_columns=0)
    )
    words = [
        (row["item"], row["claim"], row["finding"], row["verdict"]) for row in summary["claims"]
    ]
    console.print(
        worded_table("Statements", ("where", "the paper", "the simulation", "verdict"), words)
    )


def _table(summary: dict[str, Any], task: str, number: str) -> Table:
    rows = []
    for entry in summary["tables"]:
        if entry["task"] == task:
            rows.append(
                _cells(
                    entry["name"], entry["paper"], 1e3 * entry["paper_time_ms"], entry["verdict"]
                )
            )
            rows += [
                _cells(f"ours: {name}", ours, ours["time_us"], "")
                for name, ours in entry["ours"].items()
            ]
    title = f"Table {number}, task {task}: the test bench, and below each row our simulation of its model [mm, A, us per sample]"
    return worded_table(
        title, ("case", *(heading for _, heading in HEADINGS), "time", "verdict"), rows
    )


def _cells(name: str, numbers: dict[str, float], microseconds: float, verdict: str) -> list[str]:
    return [
        name,
        *(f"{numbers[column]:.3f}" for column, _ in HEADINGS),
        f"{microseconds:.3g}",
        verdict,
    ]


def _ranking(summary: dict[str, Any]) -> Table:
    """From the smallest mean error of the end effector, both tasks together."""
    pace = row_of(summary["ranking"], "cascade")["time_us"]
    ranked = sorted(summary["ranking"], key=lambda row: row["A"]["ee_mean"] + row["B"]["ee_mean"])
    rows = [
        [
            row["controller"],
            row["gains"],
            *(f"{row[task][c]:.3f}" for task in "AB" for c in RANKED),
            f"{row['time_us'] / pace:.1f}",
        ]
        for row in ranked
    ]
    headings = [
        "controller",
        "gains",
        *(f"{task}\n{heading}" for task in "AB" for heading in RANKED.values()),
        "time",
    ]
    title = "Ranking: mean errors of motor and tool, largest deformation (mm), mean current (A); time per sample against the cascade's "
    return plain_table(title + f"({pace:.2g} us on this computer)", headings, rows, text_columns=2)
