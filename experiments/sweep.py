"""`jcontour sweep`: metrics over weights x preview x contours x plants, on the quantised machine, stored as netCDF."""

import zipfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr

from experiments import runs, tables
from experiments.catalogue import TERMINALS, contouring, job_named, machine_named, observed
from experiments.datasets import metric_unit, save_dataset
from experiments.jobs import Job, Pace
from experiments.machines import Machine
from experiments.options import Sweep
from experiments.replays import Course
from experiments.tuning_runs import flag_paths, resumed
from jcontour.controllers.contouring_lq import LQWeights
from jcontour.metrics import Metrics
from tuning.sweep import design, grid, random_sample, sweep

CONTOURS = ("circle", "square")
ROWS = "rows.npz"
SAVE_EVERY = 8  # designs: at most these are done again after a kill
NAMES = tuple(Metrics.__dataclass_fields__)


def command(flags: Sweep) -> int:
    """The whole command: sweep, print, exit code."""
    folder, flags = resumed(flags, "sweep") if flags.resume else (None, flags)
    machine = machine_named(flags.plant)
    pace = Pace.of(flags, machine)
    jobs = [job_named(name, pace) for name in flags.parts or CONTOURS]
    weights = sampled_weights(flags)
    _check(flags, machine, jobs, weights)
    if folder is None:
        folder = runs.create(flags.out or runs.default_folder("sweep"), "sweep", replace(flags, json=False, out=None), flag_paths(flags))
    with runs.locked(folder), runs.resumable("sweep", folder):
        dataset = _swept(flags, machine, jobs, weights, folder)
        save_dataset(dataset, folder / "sweep.nc")
        summary = runs.plain(_summary(dataset))
        runs.write_json(folder / runs.RESULT, summary)
    if flags.json:
        print(runs.json_text({"run": str(folder), **summary}))
        return 0
    console = tables.console_of()
    rows = [[str(r["preview"]), *(f"{r[n]:.4g}" for n in ("alpha", "beta", "worst_um", "nominal_um"))] for r in summary["best"]]
    headings = ["preview", "alpha", "beta", "worst RMS contour um", "nominal um"]
    console.print(tables.plain_table("Best weights for every preview (worst over contours and plants)", headings, rows))
    tables.say(console, f"{summary['points']} points, {summary['diverged']} diverged.", f"Run folder: {folder}")
    return 0


def sampled_weights(flags: Sweep) -> LQWeights:
    """Stacked weights: the grid, or random ones between the ends, even in the logarithm.

    Raises:
        ValueError: nothing to sweep, or a weight is wrong.
    """
    if not flags.previews or flags.samples < 0:
        raise ValueError("previews, samples: need at least one preview, and samples of at least 0")
    if flags.samples:
        ends = {"alpha": (min(flags.alphas), max(flags.alphas)), "beta": (min(flags.betas), max(flags.betas))}
        drawn = random_sample(flags.samples, flags.seed, **ends)
    else:
        drawn = grid(alpha=flags.alphas, beta=flags.betas)
    return LQWeights(**drawn, rho=jnp.full_like(drawn["alpha"], flags.rho))


def _check(flags: Sweep, machine: Machine, jobs: list[Job], weights: LQWeights) -> None:
    for preview in flags.previews:
        _maker(flags, machine, preview)(design(weights, 0))
        for job in jobs:
            job.reference(machine.model.dt, preview)


def _maker(flags: Sweep, machine: Machine, preview: int):
    make = observed(contouring(TERMINALS[flags.terminal]))
    return lambda weights: make(machine, weights, preview)


def _swept(flags: Sweep, machine: Machine, jobs: list[Job], weights: LQWeights, folder: Path) -> xr.Dataset:
    rows = _load(folder)
    plants = [(name, plant) for (name, _, _), plant in zip(machine.members, machine.family(quantised=True), strict=True)]
    count = int(weights.alpha.size)
    for number, preview in enumerate(flags.previews):
        if len(rows) >= (number + 1) * count:
            continue
        course, make = Course.of(jobs, [False] * len(jobs), plants, preview), _maker(flags, machine, preview)
        while (first := len(rows) - number * count) < count:
            chunk = jax.tree.map(lambda leaf, first=first: leaf[first : first + SAVE_EVERY], weights)
            found = {name: np.asarray(values) for name, values in vars(sweep(make, chunk, course.family, course.references)).items()}
            rows += [{name: found[name][k] for name in NAMES} for k in range(len(found["diverged"]))]
            _save(folder, rows)
    return _dataset(flags, machine, jobs, weights, [name for name, _ in plants], rows)


def _dataset(flags: Sweep, machine: Machine, jobs: list[Job], weights: LQWeights, plants: list[str], rows) -> xr.Dataset:
    dims = ("preview", "sample", "contour", "plant")
    shape = (len(flags.previews), weights.alpha.size, len(jobs), len(plants))
    data = {}
    for name in NAMES:
        values = np.array([row[name] for row in rows]).reshape(shape)
        values = values.astype("i1") if values.dtype == bool else values
        data[name] = (dims, values, {"units": metric_unit(name, machine.control_unit)})
    coordinates = {
        "preview": ("preview", list(flags.previews), {"units": "samples"}), "contour": [job.name for job in jobs], "plant": plants,
        "alpha": ("sample", np.asarray(weights.alpha), {"units": "m-2"}), "beta": ("sample", np.asarray(weights.beta), {"units": "m-2"}),
    }  # fmt: skip
    return xr.Dataset(data, coordinates, {"title": "jcontour sweep: quantised machine", "rho": flags.rho, **runs.versions()})


def _summary(dataset: xr.Dataset) -> dict[str, Any]:
    lost = dataset.diverged.values.any(axis=(2, 3))
    worst = np.where(lost, np.inf, 1e6 * dataset.rms_contour_error.values.max(axis=(2, 3)))
    best = [
        {"preview": int(preview), "alpha": float(dataset.alpha[i]), "beta": float(dataset.beta[i]), "worst_um": float(worst[p, i]),
         "nominal_um": float(1e6 * dataset.rms_contour_error.values[p, i, :, 0].max())}
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
