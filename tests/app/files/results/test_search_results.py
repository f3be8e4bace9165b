"""The default of every number of a row that failed is none. A front as a dataset."""

from dataclasses import replace

import numpy as np
import xarray as xr

from jcontour.app.files.results.run_metrics import MachineSummary
from jcontour.app.files.results.search_results import (
    BudgetPoint,
    FrontResult,
    Ranked,
    variables_of,
)
from jcontour.app.files.results.stored import to_json

POINTS = [
    BudgetPoint(1.4, {"alpha": 2.0}, 5e-6, 9e-6, 0.1, 5e-6, True, False, 1.4),
    BudgetPoint(3.0, {"alpha": 3.0}, 3e-6, 8e-6, 0.15, 3e-6, True, True, 1.8),
]


def test_a_failed_row_is_stored_without_numbers():
    written = to_json(Ranked(label="lq", failure="why"))
    assert set(written) == {"label", "failure"}


def result(against):
    return FrontResult(
        machine=MachineSummary("mill", "A", ("X", "Y"), "counts"),
        error="contour",
        controller="lq",
        weights=["alpha"],
        points=POINTS,
        against=against,
    )


def dataset_of(result, units):
    return xr.Dataset(variables_of(result, units))


def test_budgets_are_the_axis_with_the_unit_of_what_they_limit():
    dataset = dataset_of(result("sensitivity"), {"alpha": "m-2"})
    np.testing.assert_array_equal(dataset.budget, [1.4, 3.0])
    assert dataset.budget.attrs["units"] == "1"
    assert dataset_of(result("increment"), {"alpha": "m-2"}).budget.attrs["units"] == "A"


def test_variables_have_the_numbers_and_units_of_the_points():
    dataset = dataset_of(result("sensitivity"), {"alpha": "m-2"})
    expected = {
        "alpha": ([2.0, 3.0], "m-2"),
        "rms_contour_error": ([5e-6, 3e-6], "m"),
        "rms_tracking_error": ([9e-6, 8e-6], "m"),
        "rms_increment": ([0.1, 0.15], "A per sample"),
        "peak_sensitivity": ([1.4, 1.8], "1"),
        "feasible": ([1.0, 1.0], "1"),
        "slack": ([0.0, 1.0], "1"),
    }
    assert set(dataset) == set(expected)
    for name, (values, unit) in expected.items():
        np.testing.assert_array_equal(dataset[name], values)
        assert dataset[name].attrs["units"] == unit


def test_a_weight_with_a_number_for_each_axis_has_a_dimension_of_its_own():
    values = [[2.0, 3.0], [4.0, 5.0]]
    points = [replace(p, weights={"kp": v}) for p, v in zip(POINTS, values, strict=True)]
    dataset = dataset_of(replace(result("increment"), points=points), {"kp": "1/s"})
    assert dataset.kp.dims == ("budget", "entry_of_kp") and dataset.kp.attrs["units"] == "1/s"
    np.testing.assert_array_equal(dataset.kp, values)


def test_what_is_spent_is_what_the_budgets_limit():
    assert [point.spent("increment") for point in POINTS] == [0.1, 0.15]
    assert [point.spent("sensitivity") for point in POINTS] == [1.4, 1.8]
    assert result("sensitivity").slack == [3.0]
