"""Rollouts of a run as a netCDF data set."""

from collections.abc import Sequence

import numpy as np
import xarray as xr

from experiments.files.netcdf import metric_unit
from experiments.jobs.replays import Replay, Scenarios, desired, scored


def rollouts(
    designs: dict[str, Replay],
    scenarios: Scenarios,
    axes: Sequence[str],
    control_unit: str,
    attributes: dict[str, str],
) -> xr.Dataset:
    """Signals and metrics of several designs over the same scenarios."""
    dims = ("design", "contour", "plant")
    runs = list(designs.values())
    steps, inputs = runs[0].output.shape[2], runs[0].control.shape[-1]

    def stacked(values):
        return np.stack([values(run) for run in runs])

    data = {
        "output": (
            (*dims, "time", "axis"),
            stacked(lambda run: run.output),
            {"units": "m", "long_name": "tool point"},
        ),
        "control": (
            (*dims, "time", "input"),
            stacked(lambda run: run.control),
            {"units": control_unit, "long_name": "control"},
        ),
        "contour_error": (
            (*dims, "time", "axis"),
            stacked(lambda run: run.contour_error),
            {"units": "m", "long_name": "vector from the nearest point of the contour to the tool"},
        ),
        "reference": (
            ("contour", "time", "axis"),
            desired(scenarios),
            {"units": "m", "long_name": "where the tool should be"},
        ),
        "scored": (
            ("contour", "time"),
            scored(scenarios).astype("i1"),
            {"long_name": "1 where the sample counts in the metrics"},
        ),
        "training": (
            ("contour",),
            np.array(scenarios.training).astype("i1"),
            {"long_name": "1 where the tuner has seen the contour"},
        ),
    }
    for name in vars(runs[0].metrics):
        values = stacked(lambda run, name=name: np.asarray(getattr(run.metrics, name)))
        kind = values.astype("i1") if values.dtype == bool else values
        data[name] = (dims, kind, {"units": metric_unit(name, control_unit)})
    coordinates = {
        "design": list(designs),
        "contour": [job.name for job in scenarios.jobs],
        "plant": list(scenarios.plants),
        "time": ("time", np.arange(steps) * scenarios.references.dt, {"units": "s"}),
        "axis": list(axes),
        "input": [f"u{k + 1}" for k in range(inputs)],
    }
    return xr.Dataset(data, coordinates, attributes)
