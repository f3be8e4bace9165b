"""Rollouts and sensitivity curves of a run as netCDF data sets, and how much of them is kept."""

import math
from collections.abc import Mapping
from operator import attrgetter
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from jcontour.app.files.netcdf import Variables, save_variables
from jcontour.app.files.results.run_metrics import METRICS, MachineSummary
from jcontour.app.files.run_folder import versions
from jcontour.app.flags.shared import Rollouts
from jcontour.app.jobs.replays import Replay, Scenarios, desired, scored
from jcontour.app.machines.machine import Machine

SENSITIVITY = "sensitivity.nc"
ROLLOUTS = "rollouts.nc"
LARGE = 100e6  # bytes of signals: `auto` thins beyond them, `thinned` down to them
FLOAT = 8  # bytes
ERROR = "vector from the nearest point of the contour to the tool"
RUN = ("design", "contour", "plant")  # axes of what there is one of for every run


def save_rollouts(
    keep: Rollouts,
    replays: Mapping[str, Replay],
    scenarios: Scenarios,
    machine: Machine | MachineSummary,
    title: str,
    folder: Path,
) -> str:
    """Write `rollouts.nc` as far as it is kept; one line that says what was written."""
    # Bytes of the signals of all runs
    signals = [(run.output, run.control, run.contour_error) for run in replays.values()]
    size = FLOAT * sum(signal.size for run in signals for signal in run)
    if keep == "none":
        return f"Rollouts: not kept ({_megabytes(size)} of signals)"
    every = 1 if keep == "full" else max(1 if keep == "auto" else 2, math.ceil(size / LARGE))
    variables = rollouts(replays, scenarios, machine, every)
    path = save_variables(variables, {"title": title, **versions()}, folder / ROLLOUTS)
    written = f"Rollouts: {ROLLOUTS}, {_megabytes(path.stat().st_size)}"
    if every == 1:
        return f"{written}, every sample"
    whole = f"all would be about {_megabytes(size)}: --rollouts full"
    return f"{written}, one sample of {every} ({whole})"


def rollouts(
    replays: Mapping[str, Replay],
    scenarios: Scenarios,
    machine: Machine | MachineSummary,
    every: int,
) -> Variables:
    """Signals and metrics of several designs over the same scenarios, one sample of `every`."""
    runs = list(replays.values())
    kept, unit = slice(None, None, every), machine.control_unit
    # Where the tool should be, which samples count, and which contours the tuner has seen
    wanted = desired(scenarios)[:, kept]
    counted = scored(scenarios)[:, kept].astype("i1")
    training = np.array(scenarios.training).astype("i1")
    score = {"long_name": "1 where the sample counts in the metrics"}
    seen = {"long_name": "1 where the tuner has seen the contour"}
    signal = (*RUN, "time")
    output, control, error = (
        np.stack([values(run)[:, :, kept] for run in runs])
        for values in map(attrgetter, ("output", "control", "contour_error"))
    )
    data: Variables = {
        "output": ((*signal, "axis"), output, _words("m", "tool point")),
        "control": ((*signal, "input"), control, _words(unit, "control")),
        "contour_error": ((*signal, "axis"), error, _words("m", ERROR)),
        "reference": (
            ("contour", "time", "axis"),
            wanted,
            _words("m", "where the tool should be"),
        ),
        "scored": (("contour", "time"), counted, score),
        "training": (("contour",), training, seen),
    }
    for name in vars(runs[0].metrics):
        values = np.stack([np.asarray(getattr(run.metrics, name)) for run in runs])
        kind = values.astype("i1") if values.dtype == bool else values
        data[name] = (RUN, kind, {"units": METRICS[name].si(unit)})
    time = np.arange(runs[0].output.shape[2])[kept] * scenarios.references.dt
    names = {
        "design": list(replays),
        "contour": [job.name for job in scenarios.jobs],
        "plant": list(scenarios.plants),
        "axis": list(machine.axes),
        "input": [f"u{k + 1}" for k in range(runs[0].control.shape[-1])],
    }
    data["time"] = (("time",), time, {"units": "s"})
    return data | {name: ((name,), words, {}) for name, words in names.items()}


def _words(unit: str, name: str) -> dict[str, str]:
    return {"units": unit, "long_name": name}


def _megabytes(size: float) -> str:
    return f"{1e-6 * size:.3g} MB"


class FamilyCurves(NamedTuple):
    """Sensitivity over frequency."""

    frequency: Float[np.ndarray, " F"]  # [Hz]
    # of every plant, the largest of all probes; NaN for a plant with a loop that is not stable
    sensitivity: Float[np.ndarray, "P F"]


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
    data: Variables = {
        "design": (("design",), list(curves), {}),
        "plant": (("plant",), list(plants), {}),
        "frequency": (("frequency",), first.frequency, {"units": "Hz"}),
        "sensitivity": (("design", "plant", "frequency"), values, largest),
    }
    title = {"title": "jcontour tune: sensitivity of the smooth family", **versions()}
    return save_variables(data, title, folder / SENSITIVITY)
