"""The legend of a figure is below its panels."""

from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from experiments.reports.axes import legend_below


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
