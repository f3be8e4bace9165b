"""`jcontour sweep`: metrics over weights x preview x contours x plants, on the true machines, stored as netCDF."""

import zipfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from jaxtyping import Array, Float

from experiments import runs, tables
from experiments.catalogue import design_for, job_named, machine_named
from experiments.datasets import metric_unit, save_dataset
from experiments.designs import Design, by_name, plain_weights, with_values
from experiments.jobs import Job, Pace
from experiments.machines import Machine
from experiments.options import Sweep
from experiments.replays import Course
from experiments.tuning_runs import flag_paths, resumed
from jcontour.metrics import Metrics
from tuning.sweep import grid, random_sample, sweep

ROWS = "rows.npz"
SAVE_EVERY = 8  # designs: at most these are done again after a kill
NAMES = tuple(Metrics.__dataclass_fields__)


def command(flags: Sweep) -> int:
    """The whole command: sweep, print, exit code."""
    folder, flags = resumed(flags, "sweep") if flags.resume else (None, flags)
    machine = machine_named(flags.plant)
    pace = Pace.of(flags, machine)
    jobs = [job_named(name, pace) for name in flags.parts or machine.usual.swept]
    values = sampled_values(flags)
    _check(flags, machine, jobs, values)
    if folder is None:
        folder = runs.create(flags.out or runs.default_folder("sweep"), "sweep", replace(flags, json=False, out=None), flag_paths(flags))
    with runs.locked(folder), runs.resumable("sweep", folder):
        dataset = _swept(flags, machine, jobs, values, folder)
        save_dataset(dataset, folder / "sweep.nc")
        summary = runs.plain(_summary(dataset, tuple(values), machine.error))
        runs.write_json(folder / runs.RESULT, summary)
    if flags.json:
        print(runs.json_text({"run": str(folder), **summary}))
        return 0
    console = tables.console_of()
    rows = [[str(r["preview"]), *(f"{r[n]:.4g}" for n in (*values, "worst_um", "nominal_um"))] for r in summary["best"]]
    headings = ["preview", *values, f"worst RMS {machine.error} um", "nominal um"]
    console.print(tables.plain_table("Best weights for every preview (worst over contours and plants)", headings, rows))
    tables.say(console, f"{summary['points']} points, {summary['diverged']} diverged.", f"Run folder: {folder}")
    return 0


def sampled_values(flags: Sweep) -> dict[str, Float[Array, " D"]]:
    """Values of the weights that vary: the grid, or random ones between the ends, even in the logarithm.

    Raises:
        ValueError: nothing to sweep, or a value is wrong.
    """
    if not flags.previews or flags.samples < 0:
        raise ValueError("previews, samples: need at least one preview, and samples of at least 0")
    varied = dict(map(_listed, flags.vary)) if flags.vary else {"alpha": flags.alphas, "beta": flags.betas}
    if flags.samples:
        return random_sample(flags.samples, flags.seed, **{name: (min(values), max(values)) for name, values in varied.items()})
    return grid(**varied)


def _listed(words: str) -> tuple[str, tuple[float, ...]]:
    name, _, values = words.partition("=")
    try:
        return name, tuple(float(value) for value in values.split(","))
    except ValueError:
        raise ValueError(f"vary: needs NAME=VALUE,VALUE,... with numbers, received {words!r}") from None


def _check(flags: Sweep, machine: Machine, jobs: list[Job], values: dict[str, Float[Array, " D"]]) -> None:
    for preview in flags.previews:
        design = _design(flags, machine, preview)
        unknown = [name for name in values if name not in by_name(design.start)]
        if unknown:
            raise ValueError(f"vary: {design.name} has no weight {unknown[0]!r}; name some of {', '.join(by_name(design.start))}")
        design.build(with_values(design.start, {name: column[0] for name, column in values.items()}))
        for job in jobs:
            job.reference(machine.model.dt, design.preview)


def _design(flags: Sweep, machine: Machine, preview: int) -> Design:
    return design_for(machine, replace(flags, preview=preview))


def _swept(flags: Sweep, machine: Machine, jobs: list[Job], values: dict[str, Float[Array, " D"]], folder: Path) -> xr.Dataset:
    rows, count = _load(folder), next(iter(values.values())).size
    for number, preview in enumerate(flags.previews):
        if len(rows) >= (number + 1) * count:
            continue
        design = _design(flags, machine, preview)
        plants = list(zip(machine.family_names, machine.true_family(design.measured), strict=True))
        course = Course.of(jobs, [False] * len(jobs), plants, design.preview)

        def make(varied, design=design):
            return design.build(with_values(design.start, varied))

        while (first := len(rows) - number * count) < count:
            chunk = {name: column[first : first + SAVE_EVERY] for name, column in values.items()}
            found = {name: np.asarray(row) for name, row in vars(sweep(make, chunk, course.family, course.references)).items()}
            rows += [{name: found[name][k] for name in NAMES} for k in range(len(found["diverged"]))]
            _save(folder, rows)
    return _dataset(flags, machine, jobs, values, rows)


def _dataset(flags: Sweep, machine: Machine, jobs: list[Job], values: dict[str, Float[Array, " D"]], rows) -> xr.Dataset:
    dims, design = ("preview", "sample", "contour", "plant"), _design(flags, machine, flags.previews[0])
    shape = (len(flags.previews), next(iter(values.values())).size, len(jobs), len(machine.family_names))
    data = {}
    for name in NAMES:
        found = np.array([row[name] for row in rows]).reshape(shape)
        data[name] = (dims, found.astype("i1") if found.dtype == bool else found, {"units": metric_unit(name, machine.control_unit)})
    coordinates = {
        "preview": ("preview", list(flags.previews), {"units": "samples"}), "contour": [job.name for job in jobs],
        "plant": machine.family_names,
        **{name: ("sample", np.asarray(column), {"units": design.units()[name]}) for name, column in values.items()},
    }  # fmt: skip
    kept = {name: value for name, value in plain_weights(design.start).items() if isinstance(value, float) and name not in values}
    return xr.Dataset(data, coordinates, {"title": f"jcontour sweep: machine with {machine.truth}", **kept, **runs.versions()})


def _summary(dataset: xr.Dataset, names: tuple[str, ...], error: str) -> dict[str, Any]:
    errors = 1e6 * dataset[f"rms_{error}_error"].values
    lost = dataset.diverged.values.any(axis=(2, 3))
    worst = np.where(lost, np.inf, errors.max(axis=(2, 3)))
    best = [
        {"preview": int(preview), **{name: float(dataset[name][i]) for name in names}, "worst_um": float(worst[p, i]),
         "nominal_um": float(errors[p, i, :, 0].max())}
        for p, preview in enumerate(dataset.preview.values) if np.isfinite(worst[p]).any() for i in [int(np.argmin(worst[p]))]
    ]  # fmt: skip
    return {"points": int(lost.size), "diverged": int(lost.sum()), "best": best}


def _save(folder: Path, rows: list[dict[str, np.ndarray]]) -> None:
    arrays = {name: np.array([row[name] for row in rows]) for name in NAMES}
    runs.write(folder / ROWS, lambda temporary: np.savez(temporary, **arrays))  # pyright: ignore[reportArgumentType]


def _load(folder: Path) -> list[dict[str, np.ndarray]]:
    if not (folder / ROWS).exists():
        return []
    try:
        with np.load(folder / ROWS, allow_pickle=False) as file:
            arrays = {name: file[name] for name in NAMES}
    except (ValueError, KeyError, EOFError, OSError, zipfile.BadZipFile) as error:
        raise runs.RunError(f"{folder / ROWS}: cannot be read ({error})") from None
    return [{name: arrays[name][k] for name in NAMES} for k in range(len(arrays["diverged"]))]
