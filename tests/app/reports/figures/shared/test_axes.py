"""The legend of a figure is below its panels, and the numbers of its axes can be read."""

from itertools import pairwise

import pytest
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from jcontour.app.reports.figures.shared.axes import legend_below, plain_ticks, short


def test_legend_holds_all_entries_and_covers_no_panel():
    figure = Figure(figsize=(6.0, 4.0), layout="constrained")
    for axes in figure.subplots(2, 1):
        axes.plot([0.0, 1.0], [0.0, 1.0], label="tool")
    legend_below(figure, figure.axes[0], columns=2, more=[Line2D([], [], label="limit")])
    figure.draw_without_rendering()
    (legend,) = figure.legends
    assert [text.get_text() for text in legend.get_texts()] == ["tool", "limit"]
    box = legend.get_window_extent()
    assert not any(box.overlaps(axes.get_tightbbox()) for axes in figure.axes)
    assert figure.bbox.x0 <= box.x0 and box.x1 <= figure.bbox.x1


@pytest.mark.parametrize(
    ("low", "high"), [(2.7, 5.7), (7.1, 11.0), (2.1, 8.5), (0.9, 8.0), (0.17, 1.3), (5e-4, 100)]
)
def test_numbers_of_a_logarithmic_axis_do_not_overlap(low, high):
    figure = Figure(figsize=(7.0, 4.0), layout="constrained")
    axes = figure.subplots()
    axes.plot([1.0, 2.0], [low, high])
    axes.set(yscale="log")
    plain_ticks(axes.yaxis)
    figure.draw_without_rendering()
    labels = [label for label in axes.get_yticklabels() if label.get_text()]
    bottom, top = axes.get_ylim()
    shown = [one.get_window_extent() for one in labels if bottom <= one.get_position()[1] <= top]
    assert len(shown) >= 3
    assert not any(one.overlaps(other) for one, other in pairwise(shown))


def test_a_long_name_is_cut_in_the_middle():
    assert short("bracket") == "bracket" and short("x" * 40) == "x" * 40
    cut = short("beginning" + 60 * "-" + "end")
    assert len(cut) == 40 and cut.startswith("beginning-") and cut.endswith("-end") and "..." in cut
