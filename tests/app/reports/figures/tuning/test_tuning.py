"""Data of the figures of a search."""

import math
from typing import get_args, get_type_hints

import numpy as np
import pytest

from jcontour.app.files.results.tuned_result import HistoryPoint
from jcontour.app.flags.tuning import Tune
from jcontour.app.reports.figures.tuning.tuning import (
    DIVERGED,
    MEASURES,
    Search,
    history_figure,
    lower_left_edge,
    trade_off_figure,
)
from tests.app import small_runs


def point(alpha, objective, increment=1.0, violation=0.0, diverged=False):
    """Its worst error grows where the objective falls: figures that show it are wrong."""
    worst = 1e-10 / objective
    return HistoryPoint(0, {"alpha": alpha}, objective, violation, diverged, worst, increment)


POINTS = [
    point(1.0, 4e-6, 2.0),
    point(2.0, math.nan, diverged=True, violation=math.inf),
    point(3.0, 1e-6, 3.0, violation=0.5),
    point(4.0, 2e-6, 1.0),
]
RESULT = small_runs.tuned_result(start={"alpha": 1.0}, weights={"alpha": 4.0})


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


def test_the_tuned_point_is_on_the_front_of_what_the_search_makes_small():
    """Its worst error is the largest, its increment too: by the worst error it would be beaten."""
    points = [point(1.0, 4e-6, 1.0), point(2.0, 3e-6, 2.0), point(4.0, 2e-6, 3.0)]
    front = lines_of(trade_off_figure(Search(points, RESULT)))["front of these"]
    np.testing.assert_allclose(front, [[1.0, 4.0], [2.0, 3.0], [3.0, 2.0]])


@pytest.mark.parametrize("draw", [history_figure, trade_off_figure])
@pytest.mark.parametrize(
    ("objective", "says", "least"),
    [
        ("typical", "geometric mean over contours\nof the worst RMS contour error [um]", 2.0),
        ("worst", "worst RMS contour error [um]", 2.0),
        ("regret", "largest RMS contour error\nover the best of its contour", 2e-6),
    ],
)
def test_figures_say_what_the_search_makes_small(draw, objective, says, least):
    figure = draw(Search(POINTS, RESULT, objective))
    assert figure.axes[0].get_ylabel() == says
    shown = lines_of(figure)
    line = shown["tuned"] if "tuned" in shown else shown["best feasible so far"]
    assert np.nanmin(line[:, 1]) == pytest.approx(least)


def test_every_objective_is_in_words():
    assert set(get_args(get_type_hints(Tune)["objective"])) == set(MEASURES)


def test_the_edge_holds_the_points_that_no_other_beats():
    x, y = lower_left_edge(np.array([1.0, 2.0, 3.0, 1.0]), np.array([5.0, 6.0, 1.0, 4.0]))
    np.testing.assert_array_equal(x, [1.0, 3.0])
    np.testing.assert_array_equal(y, [4.0, 1.0])
