"""Figures are written whole, also by a process of their own."""

import io
import sys

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.image import imread

from jcontour.app.reports.figures.axes import DOTS, drawn_beside, save_figure


def made(title="a curve"):
    figure = Figure(figsize=(3.0, 2.0), layout="constrained")
    axes = figure.subplots()
    axes.plot([0.0, 1.0, 4.0], label="curve")
    axes.set(title=title, xlabel="x", ylabel="a long\nname")
    axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0))
    return figure


def test_the_picture_is_that_of_savefig(tmp_path):
    own = io.BytesIO()
    made().savefig(own, dpi=DOTS)
    own.seek(0)
    found = imread(save_figure(made(), tmp_path / "curve.png"))
    assert found.shape == (300, 450, 4)
    np.testing.assert_array_equal(found, imread(own))


def test_a_figure_is_drawn_once(tmp_path, monkeypatch):
    drawn, draw = [], Figure.draw
    monkeypatch.setattr(Figure, "draw", lambda self, *args: drawn.append(self) or draw(self, *args))
    save_figure(made(), tmp_path / "curve.png")
    assert len(drawn) == 1


def test_nothing_is_left_where_a_figure_cannot_be_drawn(tmp_path):
    with pytest.raises(ValueError, match="hopeless"):
        save_figure(made(r"$\hopeless$"), tmp_path / "curve.png")
    assert list(tmp_path.iterdir()) == []


def figure_of(title="a curve"):
    figure = Figure(figsize=(3.0, 2.0), layout="constrained")
    axes = figure.subplots()
    axes.plot([0.0, 1.0, 4.0], label="curve")
    axes.set(title=title)
    return figure


def test_files_are_those_that_are_drawn_here(tmp_path):
    own = save_figure(figure_of(), tmp_path / "own.png")
    first, second = tmp_path / "first.png", tmp_path / "second.png"
    with drawn_beside({first: figure_of(), second: figure_of("another")}):
        pass
    assert first.read_bytes() == own.read_bytes() != second.read_bytes()
    assert len(list(tmp_path.iterdir())) == 3


def test_what_cannot_be_drawn_is_raised_here(tmp_path):
    with (
        pytest.raises(ValueError, match="hopeless"),
        drawn_beside({tmp_path / "curve.png": figure_of(r"$\hopeless$")}),
    ):
        pass
    assert list(tmp_path.iterdir()) == []


def test_figures_are_drawn_here_where_no_process_can(tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "executable", "/bin/false")
    with drawn_beside({tmp_path / "curve.png": figure_of()}):
        pass
    assert (tmp_path / "curve.png").stat().st_size > 0
