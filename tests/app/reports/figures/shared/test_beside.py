"""Figures drawn by another process: the same files, there when the block ends."""

import sys

import pytest
from matplotlib.figure import Figure

from jcontour.app.reports.figures.shared.beside import drawn_beside
from jcontour.app.reports.figures.shared.png import save_figure


def made(title="a curve"):
    figure = Figure(figsize=(3.0, 2.0), layout="constrained")
    axes = figure.subplots()
    axes.plot([0.0, 1.0, 4.0], label="curve")
    axes.set(title=title)
    return figure


def test_files_are_those_that_are_drawn_here(tmp_path):
    own = save_figure(made(), tmp_path / "own.png")
    first, second = tmp_path / "first.png", tmp_path / "second.png"
    with drawn_beside({first: made(), second: made("another")}):
        pass
    assert first.read_bytes() == own.read_bytes() != second.read_bytes()
    assert len(list(tmp_path.iterdir())) == 3


def test_what_cannot_be_drawn_is_raised_here(tmp_path):
    with (
        pytest.raises(ValueError, match="hopeless"),
        drawn_beside({tmp_path / "curve.png": made(r"$\hopeless$")}),
    ):
        pass
    assert list(tmp_path.iterdir()) == []


def test_figures_are_drawn_here_where_no_process_can(tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "executable", "/bin/false")
    with drawn_beside({tmp_path / "curve.png": made()}):
        pass
    assert (tmp_path / "curve.png").stat().st_size > 0
