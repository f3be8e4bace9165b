"""Curves with more points than dots keep their peaks, their mean and their gaps."""

import numpy as np
import pytest
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure

from jcontour.app.reports.figures.shared.curve import COLUMNS, MOST, draw_curve


def drawn(x, y):
    axes = Figure().subplots()
    draw_curve(axes, x, y, "blue", 1.0, "mine")
    (line,) = axes.get_lines()
    bands = [one for one in axes.collections if isinstance(one, PolyCollection)]
    return line.get_xydata().T, [path.vertices for band in bands for path in band.get_paths()]


def test_a_short_curve_is_a_line():
    x = np.linspace(0.0, 1.0, MOST)
    (_, y), band = drawn(x, np.sin(x))
    np.testing.assert_array_equal(y, np.sin(x))
    assert not band


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
