import numpy as np

from jcontour.app.files.netcdf import load_dataset
from jcontour.app.reports.figures.tuning.sensitivity import FamilyCurves
from jcontour.app.reports.sensitivity_curves import FILE, save_sensitivity


def test_curves_come_back_with_their_names(tmp_path):
    frequency, curve = np.array([1.0, 10.0]), np.array([[0.5, 1.5], [np.nan, np.nan]])
    curves = {"start": FamilyCurves(frequency, curve), "tuned": FamilyCurves(frequency, curve / 2)}
    save_sensitivity(curves, ["nominal", "late"], tmp_path)
    data = load_dataset(tmp_path / FILE)
    assert data.frequency.units == "Hz" and list(data.plant.values) == ["nominal", "late"]
    tuned = data.sensitivity.sel(design="tuned").values
    assert np.array_equal(tuned, curve / 2, equal_nan=True)
