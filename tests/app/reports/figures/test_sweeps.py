"""The data that the figure of a sweep shows."""

import numpy as np
import pytest
import xarray as xr

from jcontour.app.reports.figures.sweeps import MANY, sweep_figure, worst_errors

DIMENSIONS = ("preview", "sample", "contour", "plant")


def swept(errors_um, within=None, best=None, **weights):
    """Dataset of errors (preview, sample) on the second of two plants; NaN diverges.

    The best has the least error where none is given.
    """
    worst = np.asarray(errors_um, float)[..., None, None]
    errors = 1e-6 * np.concatenate([0.1 * worst, worst], axis=-1)
    data = {
        "rms_contour_error": (DIMENSIONS, errors),
        "rms_increment": (DIMENSIONS, np.ones_like(errors)),
        "diverged": (DIMENSIONS, np.isnan(errors).astype("i1")),
    }
    least = np.where(np.isnan(worst), np.inf, worst)[..., 0, 0]
    lost = np.isinf(least)
    best = np.where(lost.all(axis=1), -1, least.argmin(axis=1)) if best is None else best
    kept = ~lost if within is None else np.asarray(within)
    data |= {"best": ("preview", best), "within_limits": (DIMENSIONS[:2], kept.astype("i1"))}
    coordinates = {name: ("sample", np.asarray(row, float)) for name, row in weights.items()}
    previews = {"preview": 10 * (1 + np.arange(len(worst)))}
    return xr.Dataset(data, previews | coordinates)


GRID = {"alpha": [1, 1, 2, 2], "beta": [0, 5, 0, 5]}
MAPS = swept([[4, 3, 2, np.nan], [5, 6, np.nan, np.nan]], **GRID)


def test_diverged_designs_have_no_finite_error():
    worst, diverged = worst_errors(MAPS, "contour")
    np.testing.assert_array_equal(diverged, [[0, 0, 0, 1], [0, 0, 1, 1]])
    np.testing.assert_allclose(worst, [[4, 3, 2, np.inf], [5, 6, np.inf, np.inf]])


@pytest.mark.parametrize(
    ("panel", "title", "best", "lost"),
    [
        (0, "preview 10: 1 of 4 diverged", (2, 0), [(2, 5)]),
        (1, "preview 20: 2 of 4 diverged", (1, 0), [(2, 0), (2, 5)]),
    ],
)
def test_a_map_for_every_preview(panel, title, best, lost):
    axes = sweep_figure(MAPS, ["alpha", "beta"], "contour").axes[panel]
    assert axes.get_title() == title
    lines = {line.get_label(): line.get_xydata().tolist() for line in axes.lines}
    assert lines == {"best": [list(best)], "diverged": [list(place) for place in lost]}
    (marks,) = axes.collections
    shown = {
        (x, y): c for (x, y), c in zip(marks.get_offsets().tolist(), marks.get_array(), strict=True)
    }
    worst, _ = worst_errors(MAPS, "contour")
    for x, y, error in zip(GRID["alpha"], GRID["beta"], worst[panel], strict=True):
        assert shown.get((x, y), np.inf) == pytest.approx(error)
    assert (axes.get_xscale(), axes.get_yscale()) == ("log", "symlog")  # beta may be zero


def test_one_weight_is_a_curve_for_every_preview():
    one = swept([[4, np.nan, 2], [5, 6, 7]], alpha=[3, 2, 1])
    (axes,) = sweep_figure(one, ["alpha"], "contour").axes
    curves = {line.get_label(): line.get_xydata() for line in axes.lines}
    np.testing.assert_allclose(curves["preview 10: 1 of 3 diverged"], [[1, 2], [2, np.nan], [3, 4]])
    np.testing.assert_allclose(curves["preview 20: 0 of 3 diverged"], [[1, 7], [2, 6], [3, 5]])
    stars = [line.get_xydata().tolist() for line in axes.lines if line.get_marker() == "*"]
    assert stars == [[[1, pytest.approx(2)]], [[3, pytest.approx(5)]]]
    (crosses,) = [line for line in axes.lines if line.get_marker() == "x"]
    assert crosses.get_xdata().tolist() == [2]


def test_the_star_is_at_the_best_and_what_is_beyond_a_limit_is_marked():
    within = [[False, True, True, False], [False] * 4]
    limited = swept([[1, 3, 4, np.nan], [5, 6, 7, 8]], within, [1, -1], **GRID)
    figure = sweep_figure(limited, ["alpha", "beta"], "contour")
    first, second = figure.axes[:2]
    lines = {line.get_label(): line.get_xydata().tolist() for line in first.lines}
    assert lines == {"best": [[1, 5]], "beyond a limit": [[1, 0]], "diverged": [[2, 5]]}
    assert first.get_title() == "preview 10: 1 of 4 diverged, 1 beyond a limit"
    assert "best" not in [line.get_label() for line in second.lines]
    assert figure.get_suptitle().endswith("grey dot: beyond a limit on its runs")


def test_of_very_many_designs_the_best_of_each_cell_is_drawn():
    random = np.random.default_rng(0)
    count = 4 * MANY
    errors = random.uniform(1, 9, count)
    errors[7] = 0.5
    many = swept([errors], alpha=random.uniform(1, 2, count), beta=random.uniform(1, 2, count))
    axes = sweep_figure(many, ["alpha", "beta"], "contour").axes[0]
    (marks,) = axes.collections
    assert 1000 < len(marks.get_offsets()) <= 10_000
    assert marks.get_array().min() == pytest.approx(0.5)


def test_nothing_but_diverged_designs_can_be_drawn():
    nothing = swept([[np.nan] * 4], **GRID)
    axes = sweep_figure(nothing, ["alpha", "beta"], "contour").axes[0]
    assert axes.get_title() == "preview 10: 4 of 4 diverged"
