"""Results of `jcontour bench` that are stored with the code, and what has changed since.

A part with a function `rates(result)`, names to quantities per second, is compared with the last
results that were stored for the same device. `--keep results.json` adds the present ones.
"""

import json
from pathlib import Path
from typing import Any

from rich.table import Table

from jcontour.app.reports import tables

STORED = Path(__file__).with_name("results.json")
SLOWER = 0.95  # of the stored rate: below, a row is marked


def read(path: Path = STORED) -> dict[str, list[dict[str, Any]]]:
    """Results of every part, the last ones at the end."""
    return json.loads(path.read_text()) if path.exists() else {}


def add(path: Path, part: str, machine: dict[str, str], rates: dict[str, float]) -> None:
    """Add results, with the device, the versions and the date that they belong to."""
    results = read(path)
    results.setdefault(part, []).append({**machine, "rates": rates})
    path.write_text(json.dumps(results, indent=2) + "\n")


def changes(part: str, machine: dict[str, str], rates: dict[str, float]) -> Table | None:
    """Rates beside those stored last for the device; None where there are none.

    A row that is slower is red, and says so.
    """
    alike = [one for one in read().get(part, []) if one["devices"] == machine["devices"]]
    if not alike:
        return None
    last, lines, slower = alike[-1], [], []
    for name, before in last["rates"].items():
        if name in rates:
            ratio = rates[name] / before
            slower.append(ratio < SLOWER)
            numbers = f"{before:,.4g}", f"{rates[name]:,.4g}", f"{ratio:.2f}"
            lines.append([name, *numbers, "slower" if slower[-1] else ""])
    title = f"Since {last['date']}, {last['devices']}, {last['versions']}"
    columns = ["per second", "stored", "now", "ratio", ""]
    table = tables.plain_table(title, columns, lines, text_columns=1)
    for row, is_slower in zip(table.rows, slower, strict=True):
        row.style = "red" if is_slower else None
    return table
