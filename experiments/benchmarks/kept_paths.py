"""Random toolpaths that were planned and checked, kept in a CSV file: one line for each seed."""

import csv
from collections.abc import Iterable
from pathlib import Path
from typing import TextIO, get_type_hints

from experiments.benchmarks.random_paths import Checked

TYPES = get_type_hints(Checked)


def opened(path: Path) -> tuple[list[Checked], TextIO]:
    """Rows of a file, and the file to append to; it is made where there is none.

    A last line without its end is dropped: the run before was ended while it was written.

    Raises:
        ValueError: the file cannot be read or written, or holds something else.
    """
    try:
        text = path.read_text() if path.exists() else ""
        whole = text[: text.rfind("\n") + 1]
        rows = _rows(path, whole.splitlines())
        if whole != text:
            path.write_text(whole)
        file = path.open("a")
    except (OSError, UnicodeDecodeError) as error:
        raise ValueError(f"keep: {error}") from None
    if not whole:
        write(file, [list(TYPES)])
    return rows, file


def write(file: TextIO, rows: Iterable[Iterable]) -> None:
    """Add rows, at once."""
    csv.writer(file, lineterminator="\n").writerows(rows)
    file.flush()


def _rows(path: Path, lines: list[str]) -> list[Checked]:
    head, *cells = csv.reader(lines or [",".join(TYPES)])
    if head != list(TYPES):
        raise ValueError(f"keep: {path} holds no random toolpaths")
    rows = []
    for number, row in enumerate(cells, start=2):
        try:
            named = zip(TYPES.values(), row, strict=True)
            rows.append(Checked(*(kind(cell) for kind, cell in named)))
        except ValueError:
            raise ValueError(f"keep: {path}, line {number}: needs numbers of a path") from None
    return rows
