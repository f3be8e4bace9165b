"""Units of what is stored in netCDF files."""

import pytest

from experiments.files.netcdf import metric_unit


@pytest.mark.parametrize(
    ("name", "unit"),
    [
        ("rms_contour_error", "m"),
        ("peak_control", "mm/s"),
        ("rms_increment", "mm/s per sample"),
        ("peak_increment", "mm/s per sample"),
        ("duration", "s"),
        ("diverged", "1"),
    ],
)
def test_a_metric_has_its_unit(name, unit):
    assert metric_unit(name, "mm/s") == unit
