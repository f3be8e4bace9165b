"""Figures of one loop show what its runs did."""

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.colors import same_color

from jcontour.app.files.results.loop_results import Signals
from jcontour.app.reports.figures.loops import (
    ErrorCurve,
    bent_figure,
    errors_figure,
    magnification,
    path_figure,
    signals_figure,
)
from jcontour.motion.references import Reference
from tests.app.small_runs import partly


def reference_of(*scored, dt):
    """A reference with these samples that count, as far as a figure reads it."""
    return partly(Reference, dt=dt, steps=len(scored), mask=np.array(scored))


def test_no_two_curves_of_the_legend_have_one_colour():
    """Shifts of three axes above, errors with and without below."""
    random, reference = np.random.default_rng(0), reference_of(*[True] * 20, dt=0.05)
    shift, errors = 1e-6 * random.standard_normal((20, 3)), 1e-5 * random.random((2, 3, 20))
    figure = bent_figure("part", "contour", "XYZ", reference, shift, *errors)
    (legend,) = figure.legends
    entries = zip(legend.get_texts(), legend.get_lines(), strict=True)
    named = {text.get_text(): line for text, line in entries}
    assert list(named) == [
        "shift of X",
        "shift of Y",
        "shift of Z",
        "reference as it is, nominal",
        "bent reference, nominal",
    ]
    colours = [line.get_color() for line in named.values()]
    for k, colour in enumerate(colours):
        assert not any(same_color(colour, other) for other in colours[:k])


def test_errors_are_in_um_where_samples_count():
    reference = reference_of(False, True, True, dt=0.1)
    curves = [
        ErrorCurve("bound", np.array([3e-6, 4e-6, 5e-6]), "C0"),
        ErrorCurve("reached", np.array([1e-6, 2e-6, 4.9e-6]), "C1"),
    ]
    (axes,) = errors_figure("circle, late", "contour", reference, curves, promised=6e-6).axes
    lines = {line.get_label(): line.get_ydata() for line in axes.lines}
    np.testing.assert_allclose(lines["bound"], [np.nan, 4.0, 5.0])
    np.testing.assert_allclose(lines["reached"], [np.nan, 2.0, 4.9])
    np.testing.assert_allclose(lines["promised"], [6.0, 6.0])
    assert axes.get_ylabel() == "contour error [um]" and axes.get_ylim()[0] == 0.0


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
