"""Tables of papers and benchmarks: rows of a result, and for every heading what stands below it."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import isfinite
from operator import attrgetter
from typing import Any, TypeVar

from rich.console import Console

from jcontour.app.reports.tables import plain_table, say

Row = TypeVar("Row")
Column = str | Callable[[Any], str]  # "attribute", "attribute:format", or a function of a row


@dataclass(frozen=True)
class Table:
    """Rows of a result under headings; a dash stands for None and for what is not finite."""

    title: str  # above the table
    rows: Sequence[Any]  # any objects
    columns: Mapping[str, Column]  # by heading
    # number of first columns that are text and wrap; one headed "verdict" does as well
    words: int = 1

    @property
    def cells(self) -> list[list[str]]:
        """What stands below the headings, row by row."""
        return [[_cell(row, column) for column in self.columns.values()] for row in self.rows]


def where(rows: Iterable[Row], **values: object) -> list[Row]:
    """Rows whose attributes have these values."""
    wanted = values.items()
    return [row for row in rows if all(getattr(row, name) == value for name, value in wanted)]


def show(console: Console, parts: Iterable[Table | str]) -> None:
    """Print tables and lines of text."""
    for part in parts:
        if isinstance(part, str):
            say(console, part)
        elif part.rows:
            table = plain_table(part.title, [*part.columns], part.cells, part.words)
            for column in table.columns:
                if column.header == "verdict":
                    column.justify, column.no_wrap = "left", False
            console.print(table)


def stored(parts: Iterable[Table | str]) -> list[dict[str, Any]]:
    """The same tables, cell by cell as they are printed."""
    return [
        {"title": one.title, "headings": list(one.columns), "cells": one.cells}
        for one in parts
        if isinstance(one, Table)
    ]


def _cell(row: Any, column: Column) -> str:
    if callable(column):
        return column(row)
    name, _, form = column.partition(":")
    value = attrgetter(name)(row)
    if value is None or (isinstance(value, float) and not isfinite(value)):
        return "-"
    return format(value, form)
