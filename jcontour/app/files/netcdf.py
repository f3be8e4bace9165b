"""netCDF files with named dimensions and units; the gain schedule as CSV for a drive."""

from pathlib import Path

import numpy as np
import xarray as xr

from jcontour.app.files.run_folder import write
from jcontour.export.code_text import heading
from jcontour.linear.plant import AffinePlan

LEVEL = 1  # of compression: the signals shrink little beyond it


def save_dataset(dataset: xr.Dataset, path: Path) -> Path:
    """Write netCDF, compressed."""
    encoding = {
        name: {"zlib": True, "complevel": LEVEL}
        for name, values in dataset.data_vars.items()
        if values.ndim > 3
    }
    return write(
        path, lambda temporary: dataset.to_netcdf(temporary, engine="h5netcdf", encoding=encoding)
    )


def load_dataset(path: Path) -> xr.Dataset:
    """Read a netCDF file into memory."""
    with xr.open_dataset(path, engine="h5netcdf") as dataset:
        return dataset.load()


def save_gains(plan: AffinePlan, steps: int, dt: float, control_unit: str, path: Path) -> Path:
    """Gain schedule u = f - F xf of every sample as CSV, 17 digits: k, t_s, F row by row, f.

    Names end in their units; a gain is one per unit of its state.
    """
    F, f = np.asarray(plan.F)[:steps], np.asarray(plan.f)[:steps]
    inputs, states = (range(1, size + 1) for size in F.shape[1:])
    names = [heading(f"F_u{i}_x{j}", control_unit, per=f"x{j}") for i in inputs for j in states] + [
        heading(f"f_u{i}", control_unit) for i in inputs
    ]
    k = np.arange(len(F))
    rows = np.column_stack([k, k * dt, F.reshape(len(F), -1), f])
    formats = ["%d", "%.10g"] + ["%.17g"] * len(names)
    return write(
        path,
        lambda temporary: np.savetxt(
            temporary,
            rows,
            formats,
            ",",
            header=",".join(["k", "t_s", *names]),
            comments="",
            encoding="utf-8",
        ),
    )
