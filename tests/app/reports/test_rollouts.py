"""Signals and metrics as they are stored: whole, thinned, or not at all."""

import numpy as np
import pytest
import xarray as xr

from jcontour.app.reports.rollouts import (
    ROLLOUTS,
    SENSITIVITY,
    FamilyCurves,
    save_rollouts,
    save_sensitivity,
)
from tests.app import small_runs

SAMPLES = 6
MACHINE = small_runs.machine(control_unit="mm/s")
COUNTED = np.arange(SAMPLES) >= 2
SCENARIOS = small_runs.scenarios(
    [small_runs.job("line", COUNTED)], np.zeros((1, SAMPLES, 2)), COUNTED[None]
)


@pytest.fixture
def run():
    found = small_runs.replay(SAMPLES)
    found.output[:] = np.random.default_rng(0).standard_normal(found.output.shape)
    return found


def test_everything_has_its_dimensions_and_units(run, tmp_path):
    line = save_rollouts("full", {"mine": run}, SCENARIOS, MACHINE, "test", tmp_path)
    assert line.startswith("Rollouts: rollouts.nc, ") and line.endswith("every sample")
    found = xr.load_dataset(tmp_path / ROLLOUTS)
    assert found.attrs["title"] == "test"
    assert found.output.dims == ("design", "contour", "plant", "time", "axis")
    assert found.rms_contour_error.dims == ("design", "contour", "plant")
    units = {"output": "m", "control": "mm/s", "time": "s", "rms_contour_error": "m"}
    assert {name: found[name].attrs["units"] for name in units} == units
    assert list(found.axis.values) == ["X", "Y"] and list(found.plant.values) == ["nominal", "late"]
    np.testing.assert_array_equal(found.output.values[0], run.output)
    np.testing.assert_array_equal(found.scored.values[0], COUNTED)


def test_thinned_it_is_one_sample_of_two_and_none_is_not_written(run, tmp_path):
    line = save_rollouts("thinned", {"mine": run}, SCENARIOS, MACHINE, "test", tmp_path)
    found = xr.load_dataset(tmp_path / ROLLOUTS)
    np.testing.assert_array_equal(found.output.values[0], run.output[:, :, ::2])
    np.testing.assert_allclose(
        found.time.values, SCENARIOS.references.dt * np.arange(0, SAMPLES, 2)
    )
    assert "one sample of 2" in line
    line = save_rollouts("none", {"mine": run}, SCENARIOS, MACHINE, "test", tmp_path / "none")
    assert line.startswith("Rollouts: not kept") and not (tmp_path / "none").exists()


def test_curves_come_back_with_their_names(tmp_path):
    frequency, curve = np.array([1.0, 10.0]), np.array([[0.5, 1.5], [np.nan, np.nan]])
    curves = {"start": FamilyCurves(frequency, curve), "tuned": FamilyCurves(frequency, curve / 2)}
    save_sensitivity(curves, ["nominal", "late"], tmp_path)
    data = xr.load_dataset(tmp_path / SENSITIVITY)
    assert data.frequency.units == "Hz" and list(data.plant.values) == ["nominal", "late"]
    tuned = data.sensitivity.sel(design="tuned").values
    assert np.array_equal(tuned, curve / 2, equal_nan=True)
