"""PNG files: the same picture as Matplotlib's own, drawn once."""

import io

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.image import imread

from jcontour.app.reports.figures.shared.png import DOTS, save_figure, save_figures


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


def test_files_have_the_names_of_the_figures(tmp_path):
    paths = save_figures({"first": made, "second": made}, "data", tmp_path)
    assert [path.name for path in paths] == ["first.png", "second.png"]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["first.png", "second.png"]


def test_nothing_is_left_where_a_figure_cannot_be_drawn(tmp_path):
    with pytest.raises(ValueError, match="hopeless"):
        save_figure(made(r"$\hopeless$"), tmp_path / "curve.png")
    assert list(tmp_path.iterdir()) == []
