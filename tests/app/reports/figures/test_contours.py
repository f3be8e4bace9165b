"""Figures of runs along a contour show what the runs did."""

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.figure import Figure

from jcontour._arrays import placed
from jcontour.app.reports.figures.contours import (
    TITLE,
    TITLES,
    ContourRuns,
    contour_figure,
    draw_way,
    error_figure,
    magnification,
)
from jcontour.geometry.contours import circle
from jcontour.motion.feed_laws import constant_feed
from jcontour.motion.references import along
from jcontour.simulation.closed_loop import Rollout

RADIUS = 0.01
STEPS = 60  # of the runs
RADIUS = 0.01


def test_runs_of_a_library_user():
    """A tool on a circle a tenth larger: the contour error is the radial distance."""
    contour = circle(RADIUS)
    arc = constant_feed(contour, 0.1, 1e-3)
    reference = along(contour, arc, 1e-3, 0, at_rest=False)
    output = placed(1.1 * np.asarray(reference.position))
    control = placed(np.zeros(output.shape))
    rollout = Rollout(None, output, None, control, None, None, None)
    runs = ContourRuns.of(reference, {"mine": rollout}, "ring")
    (run,) = runs.runs
    np.testing.assert_allclose(np.linalg.norm(run.contour_error, axis=1), 0.1 * RADIUS, rtol=1e-9)
    assert runs.axes == ("X", "Y") and len(contour_figure(runs).axes) == 1


def drawn_way(runs):
    """Axes with the way of these runs."""
    axes = Figure().subplots()
    draw_way(axes, runs)
    return axes


def test_moves_between_cuts_are_rapid(runs):
    scored = runs.scored & ~np.isin(np.arange(STEPS), [30, 31, 32])
    cut = replace(runs, scored=scored)
    panel = drawn_way(cut)
    (rapid,) = [line for line in panel.get_lines() if line.get_label() == "rapid"]
    shown = ~np.isnan(rapid.get_xdata())
    assert np.flatnonzero(shown).tolist() == [*range(11), 29, 30, 31, 32, 33]  # up to the cuts


@pytest.mark.parametrize(
    ("largest", "factor"), [(1e-3, 500.0), (0.1, 5.0), (0.5, 1.0), (20.0, 1.0), (0.0, 1.0)]
)
def test_magnification_is_a_round_number(largest, factor):
    desired = np.array([[0.0, 0.0], [10.0, 3.0]])
    assert magnification(desired, np.array([[0.0, largest], [np.nan, 0.0]])) == factor


def test_rounding_is_no_error_to_magnify():
    """On a line along an axis the tool is off by what coordinates are rounded to."""
    desired = np.array([[1.0, 900.0], [3.0, 900.0]])
    assert magnification(desired, np.array([[0.0, np.spacing(900.0)], [0.0, 0.0]])) == 1.0


def test_errors_over_time_are_in_micrometres(runs):
    figure = error_figure(runs)
    nominal = figure.axes[0].get_lines()
    np.testing.assert_allclose(nominal[0].get_ydata()[10:], 1.0)
    np.testing.assert_allclose(nominal[1].get_ydata()[10:], 0.1)
    worst = figure.axes[1].get_lines()
    np.testing.assert_allclose(worst[0].get_ydata()[10:], 40.0)
    assert worst[1].get_label() == "tuned, largest RMS (heavy), diverged"


def test_rapid_moves_are_left_out_and_told(runs):
    cut = replace(runs, scored=runs.scored & (np.abs(np.arange(runs.scored.size) - 31) > 1))
    drawn = error_figure(cut).axes[0].get_lines()[0].get_ydata()
    assert np.flatnonzero(np.isnan(drawn)).tolist() == [*range(10), 30, 31, 32]
    assert "rapid" in error_figure(cut).get_suptitle()
    assert "rapid" not in error_figure(runs).get_suptitle()


def test_runs_of_one_plant_are_magnified_alike(runs):
    panels = contour_figure(runs).axes
    assert [panel.get_title() for panel in panels] == [
        "start, nominal plant\nerror x 1000",
        "tuned, nominal plant\nerror x 1000",
        "start, largest RMS (late)\nerror x 20",
        "tuned, largest RMS (heavy)\ndiverged",
    ]
    for panel, outside in zip(panels[:3], (1.0, 0.1, 0.8), strict=True):  # mm, magnified
        contour, start, tool = panel.get_lines()
        np.testing.assert_allclose(start.get_xydata(), contour.get_xydata()[10:11])
        np.testing.assert_allclose(np.linalg.norm(contour.get_xydata()[10:], axis=1), 10.0)
        np.testing.assert_allclose(np.linalg.norm(tool.get_xydata()[10:], axis=1), 10.0 + outside)
        assert np.isnan(tool.get_xydata()[:10]).all()
    labels = [line.get_label() for line in panels[3].get_lines()]
    assert labels == ["contour", "first point"]  # no tool


@pytest.mark.parametrize(
    ("squeezed", "shape", "across"), [(1.0, 1.0, 2), (0.5, 0.5, 2), (0.2, 0.2, 1), (1e-3, 0.17, 1)]
)
def test_a_flat_contour_has_flat_panels_above_each_other(runs, squeezed, shape, across):
    reference = runs.reference * np.array([1.0, squeezed])
    width, height = contour_figure(replace(runs, reference=reference)).get_size_inches()
    panel = (height - TITLES) / (4 / across) - TITLE
    np.testing.assert_allclose(panel / (width / across), shape, rtol=0.02)
