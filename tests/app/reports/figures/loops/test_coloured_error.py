"""The tool where it went, coloured by its contour error."""

import numpy as np
import pytest
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from jcontour.app.reports.figures.loops.coloured_error import MOST, detailed, draw_coloured
from jcontour.app.reports.figures.loops.contour_runs import ContourRuns, DrawnRun


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
