"""The legend of a figure is below its panels, and the numbers of its axes can be read."""

from itertools import pairwise

import numpy as np
import pytest
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure

from jcontour.app.reports.figures.axes import (
    COLUMNS,
    MOST,
    draw_curve,
    legend_below,
    plain_ticks,
)


def test_legend_holds_all_entries_and_covers_no_panel():
    figure = Figure(figsize=(6.0, 4.0), layout="constrained")
    for axes in figure.subplots(2, 1):
        axes.plot([0.0, 1.0], [0.0, 1.0], label="tool")
    axes.axhline(0.5, label="limit")
    legend_below(figure, columns=2)
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


def drawn(x, y):
    axes = Figure().subplots()
    draw_curve(axes, x, y, "blue", 1.0, "mine")
    (line,) = axes.get_lines()
    bands = [one for one in axes.collections if isinstance(one, PolyCollection)]
    return line.get_xydata().T, [path.vertices for band in bands for path in band.get_paths()]


def test_the_band_holds_a_peak_of_one_sample():
    x = np.linspace(0.0, 1.0, 5 * MOST)
    y = np.sin(300 * np.pi * x)
    y[12_345], y[23_456] = 7.0, -9.0
    _, (band,) = drawn(x, y)
    assert band[:, 1].max() == 7.0 and band[:, 1].min() == -9.0
    assert band[band[:, 1].argmax(), 0] == pytest.approx(x[12_345], abs=1 / COLUMNS)


def test_the_mean_is_that_over_x_and_not_over_the_points():
    """Of x itself, with nine tenths of a column's points in its first half: the middle."""
    along = np.arange(500 * COLUMNS) / 500
    share = along % 1
    x = np.floor(along) + np.where(share < 0.9, share / 1.8, 0.5 + 5 * (share - 0.9))
    (sides, mean), _ = drawn(x, x)
    np.testing.assert_allclose(mean[::2], 0.5 * (sides[::2] + sides[1::2]), atol=0.01)


def test_columns_without_a_value_are_gaps():
    x = np.linspace(0.0, 1.0, 2 * MOST)
    (middle, mean), bands = drawn(x, np.where(np.abs(x - 0.5) < 0.1, np.nan, 3.0))
    gap = np.abs(middle - 0.5) < 0.1 - 1 / COLUMNS
    assert np.isnan(mean[gap]).all() and gap.any()
    np.testing.assert_allclose(mean[np.abs(middle - 0.5) > 0.1 + 1 / COLUMNS], 3.0)
    assert len(bands) == 2


def test_few_points_on_a_long_way_are_not_drawn_into_their_neighbours():
    """A step up that is 3 % of x, told by four points among thousands, is as wide as it is."""
    before, after = np.linspace(0.0, 0.5, MOST), np.linspace(0.53, 1.0, MOST)
    edges = np.array([0.5, 0.5 + 1e-9, 0.53 - 1e-9, 0.53])
    x = np.concatenate([before[:-1], edges, after[1:]])
    y = np.concatenate([0 * before[1:], [0.0, 5.0, 5.0, 0.0], 0 * after[1:]])
    (along, mean), (band,) = drawn(x, y)
    high = along[mean > 2.5]
    assert high.min() == pytest.approx(0.5, abs=1 / COLUMNS)
    assert high.max() == pytest.approx(0.53, abs=1 / COLUMNS)
    assert np.all(mean[(along < 0.498) | (along > 0.532)] < 1e-6)
    assert along[0] == 0.0 and along[-1] == 1.0
