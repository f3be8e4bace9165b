"""Runs of a sweep: all designs along all contours on all machines, chunk by chunk."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import jax
import numpy as np
import xarray as xr

from jcontour.app.designs.design import Design, plain_weights, with_values
from jcontour.app.files import run_folder
from jcontour.app.files.results.run_metrics import METRICS
from jcontour.app.files.sweep_files import SweepChunks
from jcontour.app.runs.spread.devices import batching_of
from jcontour.app.runs.spread.sweep_asked import Swept
from jcontour.simulation.devices import Spread
from jcontour.simulation.evaluation import Batching
from tuning.sweeps import sweep

CHUNKS = "parts"  # folder of the chunks inside a run folder
DIMENSIONS = ("preview", "sample", "contour", "plant")
STEPS_ON_CPU = 2_000_000  # of one core at once: a few seconds, which a kill costs at most
BYTES_PER_STEP = 2_000  # of a run on an accelerator, with room to spare


def found_along(asked: Swept, folder: Path) -> xr.Dataset:
    """Metrics of all designs; chunks that are stored in the run folder are not computed again."""
    chunks, batching = SweepChunks(folder / CHUNKS), batching_of(asked.flags)
    for number, preview in enumerate(asked.flags.previews):
        if chunks.rows < (number + 1) * asked.count:
            _sweep_preview(asked, preview, number * asked.count, chunks, batching)
    found = chunks.whole()
    machine, previews = asked.machine, list(asked.flags.previews)
    designs = [asked.design(preview) for preview in previews]
    units = designs[0].units()
    shape = (len(previews), asked.count, len(asked.jobs), len(machine.family_names))
    data = {}
    for name, rows in found.items():
        column = rows.reshape(shape)
        if column.dtype == bool:
            column = column.astype("i1")
        data[name] = (DIMENSIONS, column, {"units": METRICS[name].si(machine.control_unit)})
    coordinates: dict[str, Any] = {
        "preview": ("preview", previews, {"units": "samples"}),
        "contour": [job.name for job in asked.jobs],
        "plant": machine.family_names,
    }
    for name, column in asked.values.items():
        coordinates[name] = ("sample", np.asarray(column), {"units": units[name]})
    for name, values in kept_weights(asked, designs).items():
        dimensions = ("preview", "axis")[: values.ndim]
        coordinates[name] = (dimensions, values, {"units": units.get(name, "1")})
    title = f"jcontour sweep: machine with {machine.nonsmooth_effects}"
    settings = chosen_settings(designs[0])
    return xr.Dataset(data, coordinates, {"title": title, **settings, **run_folder.versions()})


def _sweep_preview(
    asked: Swept, preview: int, before: int, chunks: SweepChunks, batching: Batching | None
) -> None:
    """Add the rows of one preview, which has so many rows before it."""
    design, count = asked.design(preview), asked.count
    scenarios = asked.scenarios(design)
    family, references = scenarios.family, scenarios.references
    steps = len(asked.jobs) * len(scenarios.plants) * references.steps
    at_once = min(count, designs_at_once(steps, batching))

    def make(varied):
        return design.build(with_values(design.start, varied))

    while (first := chunks.rows - before) < count:
        # always as many, the last one again and again: one program
        rows = np.minimum(np.arange(first, first + at_once), count - 1)
        designs = {name: column[rows] for name, column in asked.values.items()}
        found = sweep(make, designs, family, references, batching=batching)
        metrics = vars(found).items()
        chunks.add({name: np.asarray(row)[: count - first] for name, row in metrics})


def designs_at_once(steps: int, batching: Batching | None) -> int:
    """Designs in one program, each of so many steps.

    As many as the memory of an accelerator holds, or a few seconds of a CPU.
    """
    devices = batching.mesh.size if isinstance(batching, Spread) else 1
    memory = (jax.local_devices()[0].memory_stats() or {}).get("bytes_limit")
    at_once = STEPS_ON_CPU if memory is None else memory // BYTES_PER_STEP
    return max(1, devices * at_once // steps)


def kept_weights(asked: Swept, designs: Sequence[Design]) -> dict[str, np.ndarray]:
    """Weights that do not vary, of every preview: one number, or one for each axis."""
    starts = [plain_weights(design.start) for design in designs]
    kept = {}
    for name in starts[0]:
        values = [start[name] for start in starts]
        shapes = {np.shape(value) for value in values}
        if name in asked.values or None in values:
            continue
        if shapes <= {()} or shapes <= {(len(asked.machine.axes),)}:
            kept[name] = np.array(values, float)
    return kept


def chosen_settings(design: Design) -> dict[str, Any]:
    """Controller and what is chosen of it, as its model's delay; a preview has its own place."""
    chosen = {name: value for name, value in design.settings().items() if name != "preview"}
    plain = {name: value for name, value in chosen.items() if isinstance(value, int | float | str)}
    return {"controller": design.name, **plain}
