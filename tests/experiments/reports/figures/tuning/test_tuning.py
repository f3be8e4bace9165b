"""Data of the figures of a search."""

import math
from types import SimpleNamespace

import numpy as np

from experiments.files.results.tuned_result import HistoryPoint
from experiments.reports.figures.tuning.tuning import (
    DIVERGED,
    Search,
    history_figure,
    lower_left_edge,
    trade_off_figure,
)


def point(alpha, objective, increment=1.0, violation=0.0, diverged=False):
    return HistoryPoint(0, {"alpha": alpha}, objective, violation, diverged, objective, increment)


POINTS = [
    point(1.0, 4e-6, 2.0),
    point(2.0, math.nan, diverged=True, violation=math.inf),
    point(3.0, 1e-6, 3.0, violation=0.5),
    point(4.0, 2e-6, 1.0),
]
RESULT = SimpleNamespace(
    error="contour",
    machine=SimpleNamespace(control_unit="A"),
    start={"alpha": 1.0},
    weights={"alpha": 4.0},
)


def lines_of(figure):
    return {line.get_label(): line.get_xydata() for line in figure.axes[0].get_lines()}


def test_points_that_diverged_stand_above_all_others():
    lines = lines_of(history_figure(Search(POINTS, RESULT)))
    np.testing.assert_array_equal(lines[DIVERGED][:, 0], [2])
    assert lines[DIVERGED][0, 1] > np.nanmax(lines["descent 1"][:, 1]) == 4.0
    np.testing.assert_allclose(lines["best feasible so far"][:, 1], [4.0, 4.0, 4.0, 2.0])


def test_points_beyond_a_limit_are_hollow():
    figure = history_figure(Search(POINTS, RESULT))
    hollow = [line for line in figure.axes[0].get_lines() if line.get_markerfacecolor() == "none"]
    drawn = [line.get_xydata() for line in hollow if line.get_xydata().size]
    np.testing.assert_allclose(drawn[0][~np.isnan(drawn[0][:, 1])], [[3.0, 1.0]])
    assert "limit exceeded" in [line.get_label() for line in hollow]


def test_the_trade_off_shows_start_and_tuned_among_the_points():
    lines = lines_of(trade_off_figure(Search(POINTS, RESULT)))
    np.testing.assert_allclose(lines["start"], [[2.0, 4.0]])
    np.testing.assert_allclose(lines["tuned"], [[1.0, 2.0]])
    np.testing.assert_allclose(lines["evaluated, limit exceeded"], [[3.0, 1.0]])
    np.testing.assert_allclose(lines["front of these"], [[1.0, 2.0]])


def test_the_edge_holds_the_points_that_no_other_beats():
    x, y = lower_left_edge(np.array([1.0, 2.0, 3.0, 1.0]), np.array([5.0, 6.0, 1.0, 4.0]))
    np.testing.assert_array_equal(x, [1.0, 3.0])
    np.testing.assert_array_equal(y, [4.0, 1.0])
