"""Data of the contour and error figures."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest

from experiments.reports.figures.loops.contours import (
    TITLES,
    ContourRuns,
    DrawnRun,
    contour_figure,
    error_figure,
    magnification,
)
from experiments.reports.figures.shared.axes import COLOURS, DESIRED
from jcontour.geometry.contours import circle
from jcontour.motion.feed_laws import constant_feed
from jcontour.motion.references import along
from jcontour.simulation.closed_loop import Rollout

RADIUS, STEPS = 0.01, 60


def drawn(label, plant, radial, diverged=False):
    """A tool that is `radial` [m] outside a circle."""
    around = np.linspace(0, 2 * np.pi, STEPS)
    out = np.stack([np.cos(around), np.sin(around)], axis=-1)
    return DrawnRun(
        label, plant, (RADIUS + radial) * out, np.zeros((STEPS, 2)), radial * out, diverged
    )


@pytest.fixture(scope="module")
def runs():
    around = np.linspace(0, 2 * np.pi, STEPS)
    reference = RADIUS * np.stack([np.cos(around), np.sin(around)], axis=-1)
    scored = np.arange(STEPS) >= 10
    rows = (
        (drawn("start", "nominal plant", 1e-6), drawn("tuned", "nominal plant", 1e-7)),
        (
            drawn("start", "worst plant (late)", 4e-5),
            drawn("tuned", "worst plant (heavy)", 9.0, True),
        ),
    )
    return ContourRuns("ring", 1e-3 * np.arange(STEPS), scored, reference, ("X", "Y"), "A", rows)


def test_runs_of_one_plant_are_magnified_alike(runs):
    panels = contour_figure(runs).axes
    assert [panel.get_title() for panel in panels] == [
        "start, nominal plant\nerror x 1000",
        "tuned, nominal plant\nerror x 1000",
        "start, worst plant (late)\nerror x 20",
        "tuned, worst plant (heavy)\ndiverged",
    ]
    for panel, outside in zip(panels[:3], (1.0, 0.1, 0.8), strict=True):  # mm, magnified
        contour, start, tool = panel.get_lines()
        np.testing.assert_allclose(start.get_xydata(), contour.get_xydata()[10:11])
        np.testing.assert_allclose(np.linalg.norm(contour.get_xydata()[10:], axis=1), 10.0)
        np.testing.assert_allclose(np.linalg.norm(tool.get_xydata()[10:], axis=1), 10.0 + outside)
        assert np.isnan(tool.get_xydata()[:10]).all()
    labels = [line.get_label() for line in panels[3].get_lines()]
    assert labels == ["contour", "first point"]  # no tool


def test_moves_between_cuts_are_rapid_and_left_out_of_the_errors(runs):
    scored = runs.scored & ~np.isin(np.arange(STEPS), [30, 31, 32])
    cut = replace(runs, scored=scored)
    panel = contour_figure(cut).axes[0]
    (rapid,) = [line for line in panel.get_lines() if line.get_label() == "rapid"]
    drawn = ~np.isnan(rapid.get_xdata())
    assert np.flatnonzero(drawn).tolist() == [*range(11), 29, 30, 31, 32, 33]  # up to the cuts
    assert "rapid" in error_figure(cut).get_suptitle()
    assert "rapid" not in error_figure(runs).get_suptitle()


def test_arrows_show_which_way_the_contour_goes(runs):
    for arrow in contour_figure(runs).axes[0].texts:
        tail, tip = np.array(arrow.xyann), np.array(arrow.xy)
        assert tail[0] * tip[1] > tail[1] * tip[0]  # round the origin, to the left


@pytest.mark.parametrize("gap", [(20, 50), (15, 27), (22, 23), (40, 58)])
def test_no_arrow_lies_across_a_rapid_move(runs, gap):
    """Each is as long as a step of a cut, 1.065 mm."""
    scored = runs.scored & ~np.isin(np.arange(STEPS), np.arange(*gap))
    for arrow in contour_figure(replace(runs, scored=scored)).axes[0].texts:
        length = np.linalg.norm(np.array(arrow.xyann) - np.array(arrow.xy))
        assert 0.9 < length < 1.1


@pytest.mark.parametrize(("squeezed", "shape"), [(1.0, 1.0), (0.5, 0.5), (1e-3, 0.4)])
def test_a_flat_contour_has_flat_panels(runs, squeezed, shape):
    reference = runs.reference * np.array([1.0, squeezed])
    width, height = contour_figure(replace(runs, reference=reference)).get_size_inches()
    np.testing.assert_allclose((height - TITLES) / width, shape, rtol=0.02)


def test_errors_over_time_are_in_micrometres(runs):
    figure = error_figure(runs)
    nominal = figure.axes[0].get_lines()
    np.testing.assert_allclose(nominal[0].get_ydata()[10:], 1.0)
    np.testing.assert_allclose(nominal[1].get_ydata()[10:], 0.1)
    worst = figure.axes[1].get_lines()
    np.testing.assert_allclose(worst[0].get_ydata()[10:], 40.0)
    assert worst[1].get_label() == "tuned, worst plant (heavy), diverged"


@pytest.mark.parametrize(
    ("largest", "factor"), [(1e-3, 500.0), (0.1, 5.0), (0.5, 1.0), (20.0, 1.0), (0.0, 1.0)]
)
def test_magnification_is_a_round_number(largest, factor):
    desired = np.array([[0.0, 0.0], [10.0, 3.0]])
    assert magnification(desired, np.array([[0.0, largest], [np.nan, 0.0]])) == factor


def test_runs_of_a_library_user():
    """A tool on a circle a tenth larger: the contour error is the radial distance."""
    contour = circle(RADIUS)
    arc = constant_feed(contour, 0.1, 1e-3)
    reference = along(contour, arc, 1e-3, 0, at_rest=False)
    output = 1.1 * np.asarray(reference.position)
    control = np.zeros_like(output)
    rollout = Rollout(None, jnp.asarray(output), None, jnp.asarray(control), None, None, None)
    runs = ContourRuns.of(reference, {"mine": rollout}, "ring")
    (run,) = runs.runs
    np.testing.assert_allclose(np.linalg.norm(run.contour_error, axis=1), 0.1 * RADIUS, rtol=1e-9)
    assert runs.axes == ("X", "Y") and len(contour_figure(runs).axes) == 1


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
