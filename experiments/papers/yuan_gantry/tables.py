"""What `jcontour reproduce yuan-gantry` prints."""

from typing import Any

from rich.console import Console
from rich.table import Table

from experiments.benchmarks.gantry_engines import EngineRate, show_engines
from experiments.reports.tables import digits, plain_table, worded_table


def show(summary: dict[str, Any], console: Console) -> None:
    """Frequencies, what is identified, the emulated head, engines, statements."""
    rows = [
        [
            f"{row['head_m']:g}",
            "kept" if row["coupling"] else "as printed",
            f"{row['antiresonance_hz']:.2f}",
            f"{row['resonance_hz']:.2f}",
        ]
        for row in summary["responses"]
    ]
    columns = ("head m", "coupling M_e x_h", "anti-resonance Hz", "resonance Hz")
    console.print(
        plain_table(
            "Fig. 5.6: from the current of a drive to its speed", columns, rows, text_columns=2
        )
    )
    found = [
        [r["name"], *(f"{v:.6g}" for v in (r["true"], r["found"], *r["interval"]))]
        for r in summary["identified"]
    ]
    columns = ("", "true", "found", "95 % from", "to")
    console.print(
        plain_table("Section 5.2.2: identified from chirps at two head positions", columns, found)
    )
    console.print(_emulated(summary["emulated"]["rows"]))
    show_engines([EngineRate(**row) for row in summary["engines"]], console)
    words = [
        (row["item"], row["claim"], row["finding"], row["verdict"]) for row in summary["claims"]
    ]
    console.print(
        worded_table("Statements", ("where", "the paper", "the simulation", "verdict"), words)
    )


def _emulated(rows: list[dict[str, Any]]) -> Table:
    shown = [
        [row["name"], *(["diverged", *["-"] * 6] if row["diverged"] else _numbers(row))]
        for row in rows
    ]
    columns = (
        "head",
        "X\num",
        "Y\num",
        "contour\num",
        "from the\ngantry um",
        "twist\nurad",
        "load\nA",
        "F_Nx\nmm/s",
    )
    return plain_table(
        "Section 5.6: a motor bench for the head, at once or one sample late, along Fig. 5.11; largest errors of the tool",
        columns,
        shown,
    )


def _numbers(row: dict[str, Any]) -> list[str]:
    names = (
        "peak_x_error_m",
        "peak_y_error_m",
        "peak_contour_error_m",
        "distance_m",
        "peak_twist_rad",
    )
    load, remainder = row.get("peak_load_a"), row.get("peak_remainder_m_per_s")
    return [
        *(digits(1e6 * row[name]) for name in names),
        digits(load),
        digits(None if remainder is None else 1e3 * remainder),
    ]
