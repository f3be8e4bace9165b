"""Results of a benchmark, one row for each seed, kept in a CSV file."""

import csv
from collections.abc import Iterable
from pathlib import Path
from typing import Any, TextIO, TypeVar, get_type_hints

Row = TypeVar("Row")  # a NamedTuple
FLAGS = {"True": True, "False": False}


def opened(path: Path, kind: type[Row], what: str) -> tuple[list[Row], TextIO]:
    """Rows of a file, and the file to append to; it is made where there is none.

    A last line without its end is dropped: the run before was ended while it was written.

    Args:
        path: of the file.
        kind: NamedTuple of a row, its fields numbers, texts and bools.
        what: rows are, for messages.

    Raises:
        ValueError: the file cannot be read or written, or holds something else.
    """
    types = get_type_hints(kind)
    try:
        text = path.read_text() if path.exists() else ""
        whole = text[: text.rfind("\n") + 1]
        cells = _cells(path, whole.splitlines(), types, what)
        if whole != text:
            path.write_text(whole)
        file = path.open("a")
    except (OSError, UnicodeDecodeError) as error:
        raise ValueError(f"keep: {error}") from None
    if not whole:
        write(file, [list(types)])
    return [kind(*row) for row in cells], file


def write(file: TextIO, rows: Iterable[Iterable]) -> None:
    """Add rows, at once."""
    csv.writer(file, lineterminator="\n").writerows(rows)
    file.flush()


def _cells(path: Path, lines: list[str], types: dict[str, type], what: str) -> list[list[Any]]:
    head, *rows = csv.reader(lines or [",".join(types)])
    if head != list(types):
        raise ValueError(f"keep: {path} holds no {what}")
    found = []
    for number, row in enumerate(rows, start=2):
        try:
            named = zip(types.values(), row, strict=True)
            found.append([FLAGS[cell] if kind is bool else kind(cell) for kind, cell in named])
        except (ValueError, KeyError):
            raise ValueError(f"keep: {path}, line {number}: needs the fields of {what}") from None
    return found
