"""Figures of a run along a circle whose tool is outside by 10 um."""

from dataclasses import replace

import numpy as np
import pytest

from jcontour.app.files.results.traversed_result import Signals
from jcontour.app.reports.figures.loops.traversal import magnification, path_figure, signals_figure


@pytest.fixture
def run():
    turn = np.linspace(0, 2 * np.pi, 50)
    foot = 10.0 * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    signals = Signals(
        arc_mm=10.0 * turn,
        contour_error_um=np.full(50, 10.0),
        speed_mm_s=np.linspace(0.0, 100.0, 50),
        tool_mm=1.001 * foot,
        control=np.zeros((50, 2)),
    )
    return signals, foot


def test_the_tool_is_drawn_outside_by_its_magnified_error(run):
    signals, foot = run
    assert magnification(signals.tool_mm, foot, foot) == 100.0  # 6 % of 20 mm over 10 um is 120
    figure = path_figure(signals, foot, foot, "circle")
    path, tool = (np.array(line.get_xydata()) for line in figure.axes[0].lines[:2])
    np.testing.assert_allclose(path, foot)
    np.testing.assert_allclose(np.linalg.norm(tool, axis=1), 11.0)
    assert "100 times" in figure.axes[0].get_title()
    np.testing.assert_allclose(figure.axes[1].collections[0].get_array(), signals.speed_mm_s)


def test_the_whole_path_is_drawn_where_the_tool_came_a_part_of_it(run):
    signals, path = run
    part = Signals(**{name: rows[:5] for name, rows in vars(signals).items()})
    figure = path_figure(part, path, path[:5], "circle")
    for axes in figure.axes[:2]:
        np.testing.assert_allclose(np.array(axes.lines[0].get_xydata()), path)
    assert magnification(part.tool_mm, path, path[:5]) == 100.0


def test_without_an_error_nothing_is_magnified(run):
    signals, foot = run
    assert magnification(foot, foot, foot) == 1.0
    figure = path_figure(replace(signals, tool_mm=foot), foot, foot, "circle")
    assert figure.axes[0].get_title() == "contour error true to scale"


def test_signals_are_drawn_along_the_path(run):
    figure = signals_figure(run[0], "A", "title")
    drawn = [np.array(axes.lines[0].get_ydata()) for axes in figure.axes]
    np.testing.assert_allclose(drawn[0], run[0].speed_mm_s)
    np.testing.assert_allclose(drawn[1], run[0].contour_error_um)
    assert figure.axes[2].get_ylabel() == "control [A]" and len(figure.axes[2].lines) == 2
