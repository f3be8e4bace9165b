"""netCDF files with named dimensions and units: rollouts, and the gain schedule as CSV for a drive."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import xarray as xr

from experiments.files.run_folder import write
from experiments.jobs.replays import Course, Replay, desired, scored
from jcontour.linear.plant import AffinePlan

LEVEL = 1  # of compression: the signals shrink little beyond it


def rollouts(designs: dict[str, Replay], course: Course, axes: Sequence[str], control_unit: str, attributes: dict[str, str]) -> xr.Dataset:
    """Signals and metrics of several designs over one course."""
    dims = ("design", "contour", "plant")
    runs = list(designs.values())
    steps, inputs = runs[0].output.shape[2], runs[0].control.shape[-1]

    def stacked(values):
        return np.stack([values(run) for run in runs])

    data = {
        "output": ((*dims, "time", "axis"), stacked(lambda run: run.output), {"units": "m", "long_name": "tool point"}),
        "control": ((*dims, "time", "input"), stacked(lambda run: run.control), {"units": control_unit, "long_name": "control"}),
        "contour_error": (
            (*dims, "time", "axis"), stacked(lambda run: run.contour_error),
            {"units": "m", "long_name": "vector from the nearest point of the contour to the tool"},
        ),
        "reference": (("contour", "time", "axis"), desired(course), {"units": "m", "long_name": "where the tool should be"}),
        "scored": (("contour", "time"), scored(course).astype("i1"), {"long_name": "1 where the sample counts in the metrics"}),
        "training": (("contour",), np.array(course.training).astype("i1"), {"long_name": "1 where the tuner has seen the contour"}),
    }  # fmt: skip
    for name in vars(runs[0].metrics):
        values = stacked(lambda run, name=name: np.asarray(getattr(run.metrics, name)))
        kind = values.astype("i1") if values.dtype == bool else values
        data[name] = (dims, kind, {"units": metric_unit(name, control_unit)})
    coordinates = {
        "design": list(designs),
        "contour": [job.name for job in course.jobs],
        "plant": list(course.plants),
        "time": ("time", np.arange(steps) * course.references.dt, {"units": "s"}),
        "axis": list(axes),
        "input": [f"u{k + 1}" for k in range(inputs)],
    }
    return xr.Dataset(data, coordinates, attributes)


def metric_unit(name: str, control_unit: str) -> str:
    """Unit of a metric in SI."""
    if name == "diverged":
        return "1"
    if name == "duration":
        return "s"
    return "m" if name.endswith("error") else control_unit


def save_dataset(dataset: xr.Dataset, path: Path) -> Path:
    """Write netCDF, compressed."""
    encoding = {name: {"zlib": True, "complevel": LEVEL} for name, values in dataset.data_vars.items() if values.ndim > 3}
    return write(path, lambda temporary: dataset.to_netcdf(temporary, engine="h5netcdf", encoding=encoding))


def load_dataset(path: Path) -> xr.Dataset:
    """Read a netCDF file into memory."""
    with xr.open_dataset(path, engine="h5netcdf") as dataset:
        return dataset.load()


def save_gains(plan: AffinePlan, steps: int, dt: float, path: Path) -> Path:
    """Gain schedule u = f - F xf of every sample as CSV, 17 digits: k, t_s, F row by row, f."""
    F, f = np.asarray(plan.F)[:steps], np.asarray(plan.f)[:steps]
    names = [f"F_u{i + 1}_x{j + 1}" for i in range(F.shape[1]) for j in range(F.shape[2])] + [f"f_u{i + 1}" for i in range(f.shape[1])]
    k = np.arange(len(F))
    rows = np.column_stack([k, k * dt, F.reshape(len(F), -1), f])
    formats = ["%d", "%.10g"] + ["%.17g"] * len(names)
    return write(path, lambda temporary: np.savetxt(temporary, rows, formats, ",", header=",".join(["k", "t_s", *names]), comments=""))
