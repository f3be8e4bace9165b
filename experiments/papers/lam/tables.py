"""What `jcontour reproduce lam` prints."""

from typing import Any

from rich.console import Console

from experiments.reports.tables import digits, plain_table, worded_table


def show(summary: dict[str, Any], console: Console) -> None:
    """Fig. 13 in numbers, then the verdicts."""
    columns = (
        "controller",
        "plant",
        "setting",
        "time s",
        "RMS contour\nerror %",
        "RMS\num",
        "peak\num",
        "at a limit\n% of steps",
    )
    rows = [
        [
            row["controller"],
            row["plant"],
            row["setting"],
            digits(row["time_s"]) if row["finished"] else "did not arrive",
            *(
                digits(row[name])
                for name in ("rms_percent", "rms_um", "peak_um", "limited_percent")
            ),
        ]
        for row in summary["trade_off"]
    ]
    radius = summary["path"]["max_radius_mm"]
    console.print(
        plain_table(
            f"Fig. 13: errors are in % of the largest radius, {radius:g} mm",
            columns,
            rows,
            text_columns=3,
        )
    )
    words = [
        (row["item"], row["claim"], row["finding"], row["verdict"]) for row in summary["claims"]
    ]
    console.print(
        worded_table("Statements", ("where", "the paper", "the simulation", "verdict"), words)
    )
