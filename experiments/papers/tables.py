"""Tables of a paper: rows of its result, and for every heading what of a row stands below it."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import isfinite
from operator import attrgetter
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.markup import escape
from rich.table import Table as Printed

from experiments.papers.verdicts import Claim
from jcontour.app.reports.tables import say

STATEMENTS = {
    "where": "item",
    "the paper": "claim",
    "the simulation": "finding",
    "verdict": "verdict",
}

Column = str | Callable[[Any], str]  # "attribute", "attribute:format", or a function of a row


@dataclass(frozen=True)
class Table:
    """Rows of a result under headings; a dash stands for None and for what is not finite.

    Attributes:
        title: above the table.
        rows: any objects.
        columns: by heading.
        words: number of first columns that are text and wrap; one headed "verdict" does as well.
    """

    title: str
    rows: Sequence[Any]
    columns: Mapping[str, Column]
    words: int = 1


def show(console: Console, parts: Sequence[Table | str], claims: Sequence[Claim]) -> None:
    """Print tables and lines of text, then the table of the statements."""
    for part in (*parts, Table("Statements", claims, STATEMENTS, words=4)):
        if isinstance(part, str):
            say(console, part)
        elif part.rows:
            console.print(_printed(part))


def stored(parts: Sequence[Table | str]) -> list[dict[str, Any]]:
    """The same tables, cell by cell as they are printed."""
    return [
        {"title": one.title, "headings": list(one.columns), "cells": _cells(one)}
        for one in parts
        if isinstance(one, Table)
    ]


def _printed(table: Table) -> Printed:
    printed = Printed(
        title=escape(table.title),
        title_justify="left",
        title_style="bold",
        box=SIMPLE_HEAD,
        show_edge=False,
        padding=(0, 1, 0, 0),
    )
    for k, heading in enumerate(table.columns):
        words = k < table.words or heading == "verdict"
        printed.add_column(heading, justify="left" if words else "right", no_wrap=not words)
    for row in _cells(table):
        printed.add_row(*map(escape, row))
    return printed


def _cells(table: Table) -> list[list[str]]:
    return [[_cell(row, column) for column in table.columns.values()] for row in table.rows]


def _cell(row: Any, column: Column) -> str:
    if callable(column):
        return column(row)
    name, _, form = column.partition(":")
    value = attrgetter(name)(row)
    if value is None or (isinstance(value, float) and not isfinite(value)):
        return "-"
    return format(value, form)
