"""Commissioning data: what a drive recorded, as a CSV file.

One row for every sample, SI units, a header line with these names in any order, `.` in numbers and
`,` between them; each may end in its unit as `time_s` and `current_q_A`:

    test             name of the test that the row belongs to; one test when there is no such column
    time             [s], at a constant rate within a test
    motor_position   [m]
    current_q        i_q [A]: what acts until the next row, a command that is held or the mean; in
    an electrical test its value at the row
    tool_position    optional: end effector [m]
    voltage_q        optional: u_q [V], held until the next row; makes the test an electrical one
    current_d        optional: i_d [A], which should be near zero

A column that one test has and another has not stays empty there. `jcontour identify --demo` writes
such a file.
"""

import csv
import io
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from jcontour._regular_files import content_of
from jcontour.app.files.clock import even_period, likely_unit
from jcontour.app.files.run_folder import write
from tuning.identification.flexible_axis.records import Record

SIGNALS = {
    "motor_position": "motor",
    "current_q": "current",
    "tool_position": "tool",
    "voltage_q": "voltage",
    "current_d": "current_d",
}
UNITS = {  # that the names of a written file end in
    "time": "s",
    "motor_position": "m",
    "current_q": "A",
    "tool_position": "m",
    "voltage_q": "V",
    "current_d": "A",
}
REQUIRED = ("time", "motor_position", "current_q")
COLUMNS = ("test", "time", *SIGNALS)
ONLY_TEST = "data"  # its name where there is no column for it
LEAST_ROWS, MOST_ROWS = 100, 2_000_000
MOST_BYTES = 512 * 2**20


class RecordError(ValueError):
    """A file that cannot be used; one line: place, what was received, what is needed."""


def load_records(path: str | Path) -> list[Record]:
    """The tests of a file, in the order in which they begin; the module's docstring is the format.

    Raises:
        RecordError: the file cannot be read, a column is missing, a value is no number, or a clock
            is not uniform.
    """
    try:
        text = content_of(Path(path), MOST_BYTES).decode("utf-8-sig")
        columns = _columns(csv.reader(io.StringIO(text, newline="")))
        names = columns.pop("test")
        tests = list(dict.fromkeys(names))
        number = np.array([tests.index(name) for name in names])
        table = {name: _numbers(name, cells) for name, cells in columns.items()}
        return [_record(test, np.flatnonzero(number == k), table) for k, test in enumerate(tests)]
    except OSError as error:
        raise RecordError(f"{path}: cannot be read ({error.strerror or error})") from None
    except (UnicodeDecodeError, csv.Error):
        raise RecordError(f"{path}: is not a CSV file in UTF-8") from None
    except RecordError as error:
        raise RecordError(f"{path}: {error}") from None


def save_records(records: Sequence[Record], path: Path) -> Path:
    """Write the file that `load_records` reads."""

    def fill(temporary: Path) -> None:
        with temporary.open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow(["test", *(f"{name}_{unit}" for name, unit in UNITS.items())])
            for record in records:
                signals = [getattr(record, field) for field in SIGNALS.values()]
                for k in range(record.rows):
                    cells = ("" if values is None else f"{values[k]:.9g}" for values in signals)
                    writer.writerow([record.name, f"{k * record.dt:.9g}", *cells])

    return write(path, fill)


def _columns(rows) -> dict[str, list[str]]:
    """Cells by column, the one of the tests among them."""
    named = {f"{name}_{unit}": name for name, unit in UNITS.items()}
    received: list[str] = [name.strip() for name in next(rows, [])]
    header = [named.get(name, name) for name in received]
    missing = [name for name in REQUIRED if name not in header]
    unknown = [name for name in header if name not in COLUMNS]
    if missing:
        raise RecordError(
            f"columns: {', '.join(missing)} missing; needed are {', '.join(REQUIRED)}, "
            f"received {', '.join(header) or 'nothing'}; a log of commands and positions is read "
            "with --machine linear"
        )
    if unknown or len(set(header)) < len(header):
        raise RecordError(
            f"columns: needs {', '.join(COLUMNS)}, each at most once, received {', '.join(header)}"
        )
    found: list[list[str]] = []
    for line, row in enumerate(rows, 2):
        if not row:
            continue
        if len(row) != len(header):
            raise RecordError(f"line {line}: needs {len(header)} cells, received {len(row)}")
        if len(found) == MOST_ROWS:
            raise RecordError(f"rows: needs at most {MOST_ROWS}")
        found.append(row)
    columns = (
        dict(zip(header, (list(cells) for cells in zip(*found, strict=True)), strict=False))
        if found
        else {}
    )
    if not columns:
        raise RecordError("rows: there are none below the header")
    return {"test": [ONLY_TEST] * len(found)} | columns


def _numbers(name: str, cells: list[str]) -> np.ndarray:
    """Numbers, NaN where a cell is empty."""
    values = np.full(len(cells), np.nan)
    for k, cell in enumerate(cells):
        if cell and not cell.isspace():
            try:
                values[k] = float(cell)
            except ValueError:
                raise RecordError(
                    f"{name}: row {k + 1} needs a number, received {cell[:40]!r}"
                ) from None
            if not np.isfinite(values[k]):
                raise RecordError(
                    f"{name}: row {k + 1} needs a finite number, received {cell.strip()!r}"
                )
    return values


def _record(test: str, rows: np.ndarray, table: dict[str, np.ndarray]) -> Record:
    if len(rows) < LEAST_ROWS:
        raise RecordError(f"test {test!r}: needs at least {LEAST_ROWS} rows, received {len(rows)}")
    for name, values in table.items():
        empty = np.isnan(values[rows])
        if empty.any() and (name in REQUIRED or not empty.all()):
            raise RecordError(
                f"{name}: row {rows[np.argmax(empty)] + 1}, of test {test!r}, is empty"
            )
    signals = {
        field: table[name][rows]
        for name, field in SIGNALS.items()
        if name in table and not np.isnan(table[name][rows[0]])
    }
    return Record(test, _period(test, table["time"][rows]), **signals)


def _period(test: str, time: np.ndarray) -> float:
    """Time between rows [s]."""
    if (unit := likely_unit(time)) != "s":
        raise RecordError(f"time: needs s, rows of test {test!r} look like {unit}")
    try:
        return even_period(time)
    except ValueError as error:
        raise RecordError(
            f"test {test!r}: {error}; resample the data, or make what follows a test of its own"
        ) from None
