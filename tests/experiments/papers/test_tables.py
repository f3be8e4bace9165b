"""Tables and figures of papers."""

from io import StringIO
from typing import NamedTuple

import numpy as np
import pytest
from rich.console import Console

from experiments.papers.panels import Curve, Panel, drawn
from experiments.papers.verdicts import Claim, Verdict, statements
from experiments.tables import Table, show, stored


class Row(NamedTuple):
    name: str
    gain: float | None


ROWS = (Row("first", 1.25), Row("lost", None), Row("diverged", float("inf")))
TABLE = Table(
    "Gains",
    ROWS,
    {"loop": "name", "gain": "gain:.1f", "twice": lambda row: str(row.name * 2)},
)


def test_a_column_is_an_attribute_its_format_or_a_function():
    assert stored(["a line", TABLE]) == [
        {
            "title": "Gains",
            "headings": ["loop", "gain", "twice"],
            "cells": [
                ["first", "1.2", "firstfirst"],
                ["lost", "-", "lostlost"],
                ["diverged", "-", "diverged" * 2],
            ],
        }
    ]


def test_an_attribute_that_no_row_has_is_an_error():
    with pytest.raises(AttributeError, match="phase"):
        stored([Table("", ROWS, {"": "phase"})])


def test_every_part_is_printed_and_then_the_statements():
    console = Console(width=100, record=True, file=StringIO())
    claims = [Claim("Fig. 1", "it falls", "it rises", Verdict.NOT_REPRODUCED)]
    show(console, ["our axes", TABLE, Table("empty", (), {"none": "name"}), statements(claims)])
    text = console.export_text()
    places = [text.index(word) for word in ("our axes", "Gains", "Statements", "it rises")]
    assert places == sorted(places)
    assert "empty" not in text


def test_panels_hold_their_curves_and_one_legend():
    x = np.arange(3.0)
    curves = [Curve(x, x**2, "square"), Curve(None, 2.0, "level")]
    panels = [Panel("a", "t", "y", curves, {"yscale": "log"}), Panel("b", "t", "y", curves)]
    panels.append(Panel("c", "t", "y", [Curve(x, x)]))
    figure = drawn(panels, (4.0, 4.0), columns=2)
    assert [axes.get_title() for axes in figure.axes] == ["a", "b", "c"]
    assert [axes.get_yscale() for axes in figure.axes] == ["log", "linear", "linear"]
    np.testing.assert_array_equal(figure.axes[1].lines[0].get_ydata(), x**2)
    (legend,) = figure.legends
    assert [text.get_text() for text in legend.get_texts()] == ["square", "level"]
