"""`front` on a small machine, from the command line."""

import numpy as np
import pytest
import xarray as xr

from jcontour.app.commands.tuning.front import next_steps
from jcontour.app.files.results.search_results import FrontResult
from jcontour.app.files.results.stored import read_result
from jcontour.app.reports.page.page_data import page_data


@pytest.fixture
def traced(tour):
    return tour("front").folder


@pytest.mark.slow
def test_every_file_is_there_and_the_page_and_the_netcdf_file_hold_the_points(traced):
    assert {path.name for path in traced.iterdir()} == {
        "settings.json",
        "inputs",
        "budgets.json",
        "first-weights",
        "without-budget",
        "least-increment",
        "budget-0",
        "budget-1",
        "front.nc",
        "report.html",
        "rollouts.nc",
        "result.json",
    }
    points, page = read_result(traced, FrontResult).points, page_data(traced)
    assert [one["design"] for one in page["points"]["points"]] == page["designs"]
    wanted = [1e6 * one.rms_contour_error for one in points]
    assert [one["y"] for one in page["points"]["points"]] == wanted
    assert page["contours"] and page["plants"][0] == "nominal"
    dataset = xr.load_dataset(traced / "front.nc")
    np.testing.assert_array_equal(dataset.budget, [point.budget for point in points])
    for name in ("rms_contour_error", "rms_increment", "objective"):
        if name in dataset:
            np.testing.assert_array_equal(dataset[name], [getattr(p, name) for p in points])
    assert dataset.rms_contour_error.attrs["units"] == "m"


@pytest.mark.slow
def test_default_budgets_bite(traced):
    """From the least increment that the cap allows, which costs error, to what the best need.

    A machine that stands still has no contour error and is no answer: its tracking error is capped.
    """
    result = read_result(traced, FrontResult)
    tight, loose = result.points
    assert tight.budget < loose.budget
    assert tight.rms_tracking_error > 0.5 * result.tracking_cap  # what keeps it from less
    assert tight.rms_increment > 0.99 * tight.budget
    for point in result.points:
        assert point.slack == (point.rms_increment < 0.99 * point.budget)
        assert point.feasible
        assert point.rms_increment <= point.budget * (1 + 1e-6)
        assert point.rms_tracking_error <= result.tracking_cap * (1 + 1e-6)
    assert tight.rms_contour_error > 1.05 * loose.rms_contour_error
    assert result.slack == [point.budget for point in result.points if point.slack]
    assert next_steps(result, "")[0].text.startswith("the RMS tracking error is held below ")
