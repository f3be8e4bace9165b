"""Tables, figures and verdicts of papers, and printed digits."""

from io import StringIO
from typing import NamedTuple

import numpy as np
import pytest
from rich.console import Console

from experiments.papers.panels import Curve, Panel, drawn
from experiments.papers.verdicts import (
    Claim,
    Verdict,
    missed,
    rounds_to,
    statements,
    tally,
    undecided,
    verdict,
)
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


@pytest.mark.parametrize(
    ("value", "printed", "same"),
    [
        (1.1705, "1.171", True),
        (1.1704, "1.171", False),
        (0.0025145, "2.515e-3", True),
        (0.00251449, "2.515e-3", False),
        (-11.30996, "-11.3100", True),
        (-11.3099, "-11.3100", False),
        (816.6, "817", True),
        (0.0, "0.00", True),
        (float("nan"), "1.0", False),
        (float("inf"), "1.0", False),
    ],
)
def test_rounding_to_the_print(value, printed, same):
    assert rounds_to(value, printed) is same


@pytest.mark.parametrize("printed", ["", "lost", "1.0e"])
def test_what_is_no_number_is_refused(printed):
    with pytest.raises(ValueError, match=r"invalid literal|could not convert|printed"):
        rounds_to(1.0, printed)


def test_a_verdict_holds_in_full_in_part_or_not():
    assert verdict(True) is verdict(True, partly=True) is Verdict.REPRODUCED
    assert verdict(False, partly=True) is Verdict.IN_PART
    assert verdict(False) is Verdict.NOT_REPRODUCED


def test_a_quick_run_takes_the_verdicts_back():
    rows = (Claim("1", "a", "b", Verdict.REPRODUCED), Claim("2", "c", "d", Verdict.EXPERIMENTAL))
    taken_back = undecided(rows)
    assert {row.verdict for row in taken_back} == {Verdict.UNDECIDED}
    assert [row.claim for row in taken_back] == ["a", "c"]
    assert tally(rows) == (
        "Verdicts on 2 statements: 1 reproduced; 1 experimental: shown, not matched."
    )


def test_what_is_missed_ends_in_a_line_each_the_worst_first():
    rows = (
        Claim("1", "a", "b", Verdict.REPRODUCED),
        Claim("Table 2", "20 numbers", "12 of 20", Verdict.IN_PART),
        Claim("Fig. 3", "it falls", "it rises", Verdict.NOT_REPRODUCED),
    )
    assert missed(rows)[1:] == [
        "  not reproduced: Fig. 3: it falls: here it rises",
        "  in part: Table 2: 20 numbers: here 12 of 20",
    ]
    assert missed(rows[:1]) == []
