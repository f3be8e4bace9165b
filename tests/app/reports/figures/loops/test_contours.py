"""Contours with the tool, a panel for every run."""

from dataclasses import replace

import numpy as np
import pytest

from jcontour.app.reports.figures.loops.contour_runs import ContourRuns, DrawnRun
from jcontour.app.reports.figures.loops.contours import TITLE, TITLES, contour_figure
from jcontour.app.reports.figures.shared.axes import COLOURS, DESIRED

RADIUS = 0.01


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


def test_an_error_as_large_as_the_contour_is_true_to_scale_and_no_title_says_magnified(runs):
    assert contour_figure(runs).get_suptitle().endswith("contour and tool, contour error magnified")
    large = tuple(tuple(_far_off(run, runs.reference) for run in row) for row in runs.rows)
    figure = contour_figure(replace(runs, rows=large))
    assert figure.get_suptitle().endswith(": contour and tool")
    words = [panel.get_title().split("\n")[1] for panel in figure.axes]
    assert words == [*3 * ["error true to scale"], "diverged"]
    _, _, tool = figure.axes[0].get_lines()
    drawn = np.linalg.norm(tool.get_xydata()[10:], axis=1)
    np.testing.assert_allclose(drawn, 1e3 * 1.1 * RADIUS)


def _far_off(run, reference):
    """The same run a tenth of the radius outside."""
    return replace(run, output=1.1 * reference, contour_error=0.1 * reference)


@pytest.mark.parametrize(
    ("squeezed", "shape", "across"), [(1.0, 1.0, 2), (0.5, 0.5, 2), (0.2, 0.2, 1), (1e-3, 0.17, 1)]
)
def test_a_flat_contour_has_flat_panels_above_each_other(runs, squeezed, shape, across):
    reference = runs.reference * np.array([1.0, squeezed])
    width, height = contour_figure(replace(runs, reference=reference)).get_size_inches()
    panel = (height - TITLES) / (4 / across) - TITLE
    np.testing.assert_allclose(panel / (width / across), shape, rtol=0.02)


def test_titles_above_a_tall_contour_stay_apart(runs):
    thin = np.array([0.02, 1.0])
    rows = tuple(
        tuple(
            replace(
                run,
                label="contouring-lq",
                plant="largest RMS (gains 1.1, 0.9)",
                output=run.output * thin,
                contour_error=run.contour_error * thin,
            )
            for run in row[:1]
        )
        for row in runs.rows
    )
    figure = contour_figure(replace(runs, reference=runs.reference * thin, rows=rows))
    figure.draw_without_rendering()
    boxes = [panel.title.get_window_extent() for panel in figure.axes]
    assert not any(one.overlaps(other) for one, other in zip(boxes, boxes[1:], strict=False))


@pytest.mark.parametrize("details", [1, 40])
def test_axes_of_a_line_have_a_height_with_ticks_apart_and_equal_scales(details):
    """To and fro along X, once or so often that it is coloured: Y is 0 everywhere."""
    there = np.abs((np.linspace(0.0, details, 4000) % 2) - 1)
    place = RADIUS * np.stack([there, np.zeros(4000)], axis=1)
    error = np.tile([0.0, 1e-6], (4000, 1))
    one = DrawnRun("mine", "nominal plant", place + error, np.zeros((4000, 2)), error)
    time, every = 1e-3 * np.arange(4000), np.ones(4000, bool)
    figure = contour_figure(ContourRuns("line", time, every, place, ("X", "Y"), "A", ((one,),) * 2))
    figure.draw_without_rendering()
    for axes in figure.axes:
        box = axes.get_window_extent()
        assert box.height > 0.9 * figure.dpi  # inches
        ticks = [tick.get_window_extent() for tick in axes.get_yticklabels() if tick.get_text()]
        ticks = [tick for tick in ticks if box.y0 <= (tick.y0 + tick.y1) / 2 <= box.y1]
        assert len(ticks) > 1
        assert not any(a.overlaps(b) for a, b in zip(ticks, ticks[1:], strict=False))
    panel = figure.axes[0]
    (left, right), (low, high) = panel.get_xlim(), panel.get_ylim()
    box = panel.get_window_extent()
    assert (high - low) / (right - left) == pytest.approx(box.height / box.width, rel=1e-3)


def test_the_legend_names_every_curve_once(runs):
    """The black dot is not a curve of the start weights."""
    (legend,) = contour_figure(runs).legends
    colours = {
        text.get_text(): handle.get_color()
        for text, handle in zip(legend.get_texts(), legend.legend_handles, strict=True)
    }
    assert colours == {
        "contour": DESIRED,
        "first point": "black",
        "start": COLOURS["start"],
        "tuned": COLOURS["tuned"],
    }


def test_a_contour_of_many_details_is_coloured(runs):
    """A ring of 20 loops: no panel has a magnified error, every one a scale."""
    around = np.linspace(0, 2 * np.pi, 2000)
    place = RADIUS * np.stack([np.cos(around), np.sin(around)], axis=-1)
    place += 0.1 * RADIUS * np.stack([np.cos(20 * around), np.sin(20 * around)], axis=-1)
    out = place / np.linalg.norm(place, axis=1, keepdims=True)
    rows = tuple(
        (DrawnRun("mine", plant, place + error * out, np.zeros_like(place), error * out),)
        for plant, error in (("nominal plant", 1e-6), ("worst plant", 5e-6))
    )
    time, scored = 1e-3 * np.arange(2000), np.ones(2000, bool)
    figure = contour_figure(ContourRuns("loops", time, scored, place, ("X", "Y"), "A", rows))
    titles = [axes.get_title() for axes in figure.axes if axes.get_title()]
    assert titles == [
        "mine, nominal plant\nlargest error 1 um",
        "mine, worst plant\nlargest error 5 um",
    ]
    assert [axes.get_ylabel() for axes in figure.axes].count("error [um]") == 2
