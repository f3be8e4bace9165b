"""Sensitivity over frequency of every design, as netCDF."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import xarray as xr

from jcontour.app.files.netcdf import save_dataset
from jcontour.app.files.run_folder import versions
from jcontour.app.reports.figures.tuning.sensitivity import FamilyCurves

FILE = "sensitivity.nc"


def save_sensitivity(
    curves: Mapping[str, FamilyCurves], plants: tuple[str, ...] | list[str], folder: Path
) -> Path:
    """Write the curves of a family by the name of the design; NaN where a loop is not stable."""
    first = next(iter(curves.values()))
    largest = {
        "units": "1",
        "long_name": "largest singular value of S over the probes of the paths",
    }
    values = np.stack([one.sensitivity for one in curves.values()])
    coordinates = {
        "design": list(curves),
        "plant": list(plants),
        "frequency": ("frequency", first.frequency, {"units": "Hz"}),
    }
    data = {"sensitivity": (("design", "plant", "frequency"), values, largest)}
    title = {"title": "jcontour tune: sensitivity of the smooth family", **versions()}
    return save_dataset(xr.Dataset(data, coordinates, title), folder / FILE)
