"""Results of `jcontour bench` in files: those stored with the code, and rows of long runs.

A part with a function `rates(result)`, names to quantities per second, is compared with the last
results that were stored for the same device. `--keep results.json` adds the present ones.
"""

import json
from collections.abc import Callable, Hashable, Iterable
from pathlib import Path
from typing import Any, TypeVar

from rich.table import Table

from jcontour.app.reports import tables

STORED = Path(__file__).with_name("results.json")
SLOWER = 0.95  # of the stored rate: below, a row is marked

Row = TypeVar("Row")  # a dataclass of numbers, words and lists of them


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

    A row that is slower says so.
    """
    alike = [one for one in read().get(part, []) if one["devices"] == machine["devices"]]
    if not alike:
        return None
    last, lines = alike[-1], []
    for name, before in last["rates"].items():
        if name in rates:
            ratio = rates[name] / before
            numbers = f"{before:,.4g}", f"{rates[name]:,.4g}", f"{ratio:.2f}"
            lines.append([name, *numbers, "slower" if ratio < SLOWER else ""])
    title = f"Since {last['date']}, {last['devices']}, {last['versions']}"
    columns = ["per second", "stored", "now", "ratio", ""]
    return tables.plain_table(title, columns, lines, text_columns=1)


def kept(
    path: Path | None,
    kind: type[Row],
    keys: Iterable[Hashable],
    run: Callable[..., list[Row]],
) -> list[Row]:
    """Rows of all keys, in their order; `run(*key)` makes those that no file holds.

    Every line of the file is a key with its rows, as JSON: a second run goes on. A last line
    without its end is dropped: the run before was ended while it was written.

    Raises:
        ValueError: the file cannot be read or written, or holds something else.
    """
    keys = [key if isinstance(key, tuple) else (key,) for key in keys]
    done: dict[tuple, list[Row]] = {}
    if path is not None:
        try:
            text = path.read_text() if path.exists() else ""
            whole = text[: text.rfind("\n") + 1]
            lines = [json.loads(line) for line in whole.splitlines()]
            done = {tuple(key): [kind(**row) for row in rows] for key, rows in lines}
            path.write_text(whole)
        except (OSError, ValueError, TypeError, KeyError) as error:
            raise ValueError(f"keep: {path} is of no such benchmark: {error}") from None
    for key in keys:
        if key not in done:
            done[key] = run(*key)
            if path is not None:
                with path.open("a") as file:
                    line = [list(key), [vars(row) for row in done[key]]]
                    file.write(json.dumps(line) + "\n")
    return [row for key in keys for row in done[key]]
