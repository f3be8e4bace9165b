"""Figures of runs along a contour show what the runs did."""

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from jcontour._arrays import placed
from jcontour.app.reports.figures.contours import (
    MOST,
    TITLE,
    TITLES,
    ContourRuns,
    DrawnRun,
    contour_figure,
    detailed,
    draw_coloured,
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


def runs_along(place, error, scored=None):
    """One run, `error` [m] beside its contour `place` (T, 2) [m], along Y."""
    place = np.asarray(place, float)
    beside = np.zeros_like(place)
    beside[:, 1] = error
    run = DrawnRun("mine", "nominal plant", place + beside, np.zeros_like(place), beside)
    scored = np.ones(len(place), bool) if scored is None else scored
    time = 1e-3 * np.arange(len(place))
    return ContourRuns("part", time, scored, place, ("X", "Y"), "A", ((run,),))


def drawn(runs):
    """Pieces (n, 2, 2) [mm], their lines, the ring [mm], and the words of its panel."""
    axes = Figure().subplots()
    (run,) = runs.rows[0]
    words = draw_coloured(axes, runs, run, runs.rows[0], "blue")
    (lines,) = [one for one in axes.collections if isinstance(one, LineCollection)]
    (ring,) = axes.get_lines()
    return np.array(lines.get_segments()), lines, ring.get_xydata()[0], words


def wave(count, loops, size=0.1):
    """A line with half circles of both sides: `loops` of them on a length [m]."""
    along = np.linspace(0.0, loops * np.pi, count)
    radius = size / (2 * loops)
    place, done = np.mod(along, np.pi), np.floor(along / np.pi)
    x = (2 * done + 1 - np.cos(place)) * radius
    return np.stack([x, radius * np.sin(place) * (-1) ** done], axis=-1)


@pytest.mark.parametrize(("loops", "many"), [(1, False), (2, False), (5, True), (30, True)])
def test_curves_are_many_when_they_are_tight(loops, many):
    """The mean diameter of n half circles in a row is a n-th of the size: 1/2 > 0.35 > 1/5."""
    assert detailed(runs_along(wave(3001, loops), 1e-6)) == many


@pytest.mark.parametrize(("laps", "crowded"), [(1, False), (3, False), (4, True), (20, True)])
def test_laps_of_a_circle_crowd_it(laps, crowded):
    """Its curves are as wide as the whole. A lap is pi sizes long, and 3 pi < 10 < 4 pi."""
    angle = np.linspace(0.0, 2 * np.pi * laps, 200 * laps + 1)
    place = 0.05 * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    assert detailed(runs_along(place, 1e-6)) == crowded


def test_a_standstill_has_no_direction():
    place = np.repeat(np.linspace([0.0, 0.0], [0.1, 0.0], 50), 20, axis=0)
    jitter = 1e-12 * np.random.default_rng(1).standard_normal(place.shape)
    assert not detailed(runs_along(place + jitter, 1e-6))


def test_every_piece_has_the_larger_error_of_its_stretch():
    place = np.linspace([0.0, 0.0], [0.1, 0.05], 60)
    error = 1e-6 * (1 + np.arange(60) % 7)
    scored = ~np.isin(np.arange(60), [20, 21])
    pieces, lines, ring, words = drawn(runs_along(place, error, scored))
    assert len(pieces) == 59 - 3  # three touch samples that do not count
    assert lines.get_clim() == (0.0, pytest.approx(7.0))
    values = lines.get_array()
    assert (np.diff(values) >= 0).all()  # the largest is drawn last
    x = np.rint(pieces[:, 0, 0] / (100 / 59)).astype(int)
    np.testing.assert_allclose(values, 1 + x % 7)
    np.testing.assert_allclose(ring, 1e3 * place[6] + [0.0, 7e-3])
    assert words == "largest error 7 um"


def test_a_peak_of_one_sample_is_kept_in_a_long_run():
    count = 5 * MOST + 3
    place = np.linspace([0.0, 0.0], [0.1, 0.05], count)
    error = np.full(count, 1e-6)
    error[12_346] = 9e-6
    pieces, lines, ring, _ = drawn(runs_along(place, error))
    assert len(pieces) <= MOST
    (peak,) = np.flatnonzero(np.asarray(lines.get_array()) > 5)
    begin, end = pieces[peak][:, 0]
    assert begin <= ring[0] <= end and np.isclose(ring[0], 1e3 * place[12_346, 0])


@pytest.mark.parametrize("first", [50_000, 50_001, 50_003])
@pytest.mark.parametrize("long", [1, 3, 8])
def test_a_short_rapid_of_a_long_run_is_no_cut(first, long):
    """Pieces cover the cuts, to their last sample, and nothing between them."""
    count = 5 * MOST + 3
    along = np.arange(count) * 1e-6  # [m], 1 um in every sample
    place = np.stack([along, np.zeros(count)], axis=1)
    scored = np.ones(count, bool)
    scored[first : first + long] = False
    pieces, *_ = drawn(runs_along(place, 1e-6, scored))
    ends = np.rint(1e3 * np.sort(pieces[:, :, 0], axis=0)).astype(int)  # samples
    assert ends[0, 0] == 0 and ends[-1, 1] == count - 1
    gaps = ends[1:, 0] - ends[:-1, 1]
    (border,) = np.flatnonzero(gaps)
    assert ends[border, 1] == first - 1 and gaps[border] == long + 1


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
