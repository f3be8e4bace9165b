"""`jcontour sweep`: metrics over weights x preview x contours x plants, on the true machines, stored as netCDF."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import jax
import numpy as np
import xarray as xr
from jaxtyping import Array, Float

from experiments.catalogue.choices import design_for, job_named, machine_named
from experiments.designs.design import Design, by_name, plain_weights, with_values
from experiments.files import run_folder
from experiments.files.netcdf import metric_unit, save_dataset
from experiments.files.swept_parts import SweptParts
from experiments.jobs.job import Pace, Task
from experiments.jobs.replays import Scenarios
from experiments.machines.machine import Machine
from experiments.options import Sweep
from experiments.reports import tables
from experiments.runs.lifecycle import inputs, resumed
from experiments.runs.spreading import batching_of
from jcontour.simulation.devices import Spread
from jcontour.simulation.evaluation import Batching
from tuning.sweep import grid, random_sample, sweep

PARTS = "parts"
FACTORS, VARIED = (0.1, 0.3, 1.0, 3.0, 10.0), 2  # of the first weights, where none are named
STEPS_ON_CPU = 2_000_000  # of one core at once: a few seconds, which a kill costs at most
BYTES_PER_STEP = 2_000  # of a run on an accelerator, with room to spare


def command(flags: Sweep) -> int:
    """The whole command: sweep, print, exit code."""
    folder, flags = resumed(flags, "sweep") if flags.resume else (None, flags)
    machine = machine_named(flags.plant)
    pace = Pace.of(flags, machine)
    jobs = [job_named(name, pace) for name in flags.parts or machine.usual.swept]
    values = sampled_values(flags, _design(flags, machine, flags.preview))
    flags = replace(flags, previews=horizons(flags, machine))
    _check(flags, machine, jobs, values)
    if folder is None:
        folder = run_folder.create(
            flags.out or run_folder.default_folder("sweep"),
            "sweep",
            replace(flags, json=False, out=None),
            inputs(flags),
        )
    with run_folder.locked(folder), run_folder.resumable("sweep", folder):
        dataset = _swept(flags, machine, jobs, values, folder)
        save_dataset(dataset, folder / "sweep.nc")
        summary = run_folder.plain(_summary(dataset, tuple(values), machine.error))
        run_folder.write_json(folder / run_folder.RESULT, summary)
    if flags.json:
        print(run_folder.json_text({"run": str(folder), **summary}))
        return 0
    console = tables.console_of()
    rows = [
        [str(r["preview"]), *(f"{r[n]:.4g}" for n in (*values, "worst_um", "nominal_um"))]
        for r in summary["best"]
    ]
    headings = ["preview", *values, f"worst RMS {machine.error} um", "nominal um"]
    console.print(
        tables.plain_table(
            "Best weights for every preview (worst over contours and plants)", headings, rows
        )
    )
    tables.say(
        console,
        f"{summary['points']} points, {summary['diverged']} diverged.",
        f"Run folder: {folder}",
    )
    return 0


def sampled_values(flags: Sweep, design: Design) -> dict[str, Float[Array, " D"]]:
    """Values of the weights that vary: the grid, or random ones from the least above zero to the largest, even in the logarithm.

    Raises:
        ValueError: nothing to sweep, or a value is wrong.
    """
    if not flags.previews or flags.samples < 0:
        raise ValueError("previews, samples: need at least one preview, and samples of at least 0")
    varied = dict(map(_listed, flags.vary)) or around_start(design)
    if flags.samples:
        ends = {
            name: (min((value for value in values if value > 0), default=0.0), max(values))
            for name, values in varied.items()
        }
        return random_sample(flags.samples, flags.seed, **ends)
    return grid(**varied)


def around_start(design: Design) -> dict[str, tuple[float, ...]]:
    """A tenth to ten times where tuning starts, of the first free weights that are one positive number, equal on all axes.

    Raises:
        ValueError: there is no such weight.
    """
    starts = {
        name: np.unique(np.asarray(by_name(design.start)[name], float)) for name in design.free()
    }
    single = {
        name: float(values[0])
        for name, values in starts.items()
        if values.size == 1 and values[0] > 0
    }
    if not single:
        raise ValueError(
            f"vary: {design.name} has no weight that is one positive number; name some of {', '.join(starts)} with their values"
        )
    return {
        name: tuple(factor * single[name] for factor in FACTORS) for name in list(single)[:VARIED]
    }


def horizons(flags: Sweep, machine: Machine) -> tuple[int, ...]:
    """The previews that make different controllers: all of them for LQ, what a cascade looks ahead for a cascade."""
    return tuple(
        dict.fromkeys(_design(flags, machine, preview).preview for preview in flags.previews)
    )


def _listed(words: str) -> tuple[str, tuple[float, ...]]:
    name, _, values = words.partition("=")
    try:
        return name, tuple(float(value) for value in values.split(","))
    except ValueError:
        raise ValueError(
            f"vary: needs NAME=VALUE,VALUE,... with numbers, received {words!r}"
        ) from None


def _check(
    flags: Sweep, machine: Machine, jobs: list[Task], values: dict[str, Float[Array, " D"]]
) -> None:
    for preview in flags.previews:
        design = _design(flags, machine, preview)
        unknown = [name for name in values if name not in by_name(design.start)]
        if unknown:
            raise ValueError(
                f"vary: {design.name} has no weight {unknown[0]!r}; name some of {', '.join(by_name(design.start))}"
            )
        design.build(
            with_values(design.start, {name: column[0] for name, column in values.items()})
        )
        for job in jobs:
            job.reference(machine.model.dt, design.preview)


def _design(flags: Sweep, machine: Machine, preview: int) -> Design:
    return design_for(machine, replace(flags, preview=preview))


def _swept(
    flags: Sweep,
    machine: Machine,
    jobs: list[Task],
    values: dict[str, Float[Array, " D"]],
    folder: Path,
) -> xr.Dataset:
    parts, count, batching = (
        SweptParts(folder / PARTS),
        next(iter(values.values())).size,
        batching_of(flags),
    )
    for number, preview in enumerate(flags.previews):
        if parts.rows >= (number + 1) * count:
            continue
        design = _design(flags, machine, preview)
        scenarios = Scenarios.of(jobs, [False] * len(jobs), machine, design.fed, design.preview)
        at_once = min(
            count,
            designs_at_once(
                len(jobs) * len(scenarios.plants) * scenarios.references.steps, batching
            ),
        )

        def make(varied, design=design):
            return design.build(with_values(design.start, varied))

        while (first := parts.rows - number * count) < count:
            rows = np.minimum(
                np.arange(first, first + at_once), count - 1
            )  # always as many: one program
            chunk = {name: column[rows] for name, column in values.items()}
            found = sweep(make, chunk, scenarios.family, scenarios.references, batching=batching)
            parts.add({name: np.asarray(row)[: count - first] for name, row in vars(found).items()})
    return _dataset(flags, machine, jobs, values, parts.whole())


def designs_at_once(steps: int, batching: Batching | None) -> int:
    """Designs in one program, of so many steps each: as many as the memory of an accelerator holds, or a few seconds of a CPU."""
    devices = batching.mesh.size if isinstance(batching, Spread) else 1
    memory = (jax.local_devices()[0].memory_stats() or {}).get("bytes_limit")
    at_once = STEPS_ON_CPU if memory is None else memory // BYTES_PER_STEP
    return max(1, devices * at_once // steps)


def _dataset(
    flags: Sweep,
    machine: Machine,
    jobs: list[Task],
    values: dict[str, Float[Array, " D"]],
    found: dict[str, Any],
) -> xr.Dataset:
    dims, design = (
        ("preview", "sample", "contour", "plant"),
        _design(flags, machine, flags.previews[0]),
    )
    shape = (
        len(flags.previews),
        next(iter(values.values())).size,
        len(jobs),
        len(machine.family_names),
    )
    data = {}
    for name in found:
        column = found[name].reshape(shape)
        data[name] = (
            dims,
            column.astype("i1") if column.dtype == bool else column,
            {"units": metric_unit(name, machine.control_unit)},
        )
    coordinates = {
        "preview": ("preview", list(flags.previews), {"units": "samples"}),
        "contour": [job.name for job in jobs],
        "plant": machine.family_names,
        **{
            name: ("sample", np.asarray(column), {"units": design.units()[name]})
            for name, column in values.items()
        },
    }
    kept = {
        name: value
        for name, value in plain_weights(design.start).items()
        if isinstance(value, float) and name not in values
    }
    return xr.Dataset(
        data,
        coordinates,
        {
            "title": f"jcontour sweep: machine with {machine.nonsmooth_effects}",
            **kept,
            **run_folder.versions(),
        },
    )


def _summary(dataset: xr.Dataset, names: tuple[str, ...], error: str) -> dict[str, Any]:
    errors = 1e6 * dataset[f"rms_{error}_error"].values
    lost = dataset.diverged.values.any(axis=(2, 3))
    worst = np.where(lost, np.inf, errors.max(axis=(2, 3)))
    best = [
        {
            "preview": int(preview),
            **{name: float(dataset[name][i]) for name in names},
            "worst_um": float(worst[p, i]),
            "nominal_um": float(errors[p, i, :, 0].max()),
        }
        for p, preview in enumerate(dataset.preview.values)
        if np.isfinite(worst[p]).any()
        for i in [int(np.argmin(worst[p]))]
    ]
    return {"points": int(lost.size), "diverged": int(lost.sum()), "best": best}
