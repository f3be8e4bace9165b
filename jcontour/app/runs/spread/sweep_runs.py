"""Runs of a sweep: all designs along all contours on all machines, chunk by chunk."""

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import jax
import numpy as np
import xarray as xr
from jaxtyping import Array, Float

from jcontour.app.catalogue.choices import UnreadFlagWarning, design_for, job_named, machine_named
from jcontour.app.designs.design import Design, plain_weights, with_values
from jcontour.app.files import run_folder
from jcontour.app.files.checkpoints import SweepChunks
from jcontour.app.files.results.run_metrics import METRICS
from jcontour.app.flags.tuning import Sweep
from jcontour.app.jobs.job import Pace, Task
from jcontour.app.jobs.replays import Scenarios
from jcontour.app.machines.machine import Machine
from jcontour.app.plain_numbers import named_numbers
from jcontour.app.runs.spread.devices import batching_of
from jcontour.app.runs.tuning.limits import loop_limits, named_limits, noise_limit
from jcontour.simulation.devices import Spread
from jcontour.simulation.evaluation import Batching
from tuning.sweeps import grid, random_sample, sweep

FACTORS, VARIED = (0.1, 0.3, 1.0, 3.0, 10.0), 2  # of the first weights, where none are named
# of weights of a cost: on the contours of bridgeport a tenth to a thousand times them are the best
COST_FACTORS = (1e-2, 0.1, 1.0, 10.0, 1e2, 1e3, 1e4)
CHUNKS = "parts"  # folder of the chunks inside a run folder
DIMENSIONS = ("preview", "sample", "contour", "plant")
STEPS_ON_CPU = 2_000_000  # of one core at once: a few seconds, which a kill costs at most
BYTES_PER_STEP = 2_000  # of a run on an accelerator, with room to spare


def sampled_designs(
    varied: Mapping[str, Sequence[float]], samples: int, seed: int
) -> dict[str, Float[Array, " D"]]:
    """The grid of all values, or so many random designs where `samples` is above zero.

    A random sample lies between the least value and the largest, even in the logarithm.
    """
    if samples < 0:
        raise ValueError(f"samples: needs at least 0, received {samples}")
    if not samples:
        return grid(**varied)
    for name, values in varied.items():
        if min(values) <= 0:
            raise ValueError(
                f"vary: a random sample needs values above zero, for it is even in the logarithm; "
                f"received {min(values):g} for {name}: give a lower end above zero, or a grid "
                "without --samples"
            )
    ends = {name: (min(values), max(values)) for name, values in varied.items()}
    return random_sample(samples, seed, **ends)


@dataclass(frozen=True)
class Swept:
    """A sweep that is asked for."""

    flags: Sweep  # with the previews that make different controllers
    machine: Machine
    jobs: list[Task]
    values: dict[str, Float[Array, " D"]]  # of the weights that vary, one entry per design
    _designs: dict[int, Design] = field(default_factory=dict, init=False, repr=False, compare=False)

    def design(self, preview: int) -> Design:
        """The controller with a preview, its weights open; its first loop is found once."""
        if preview not in self._designs:
            self._designs[preview] = _design(self.flags, self.machine, preview)
        return self._designs[preview]

    def scenarios(self, design: Design) -> Scenarios:
        """The contours and the true machines, for a controller with its preview."""
        seen = [True] * len(self.jobs)
        return Scenarios.of(self.jobs, seen, self.machine, design.fed, design.preview)

    @property
    def count(self) -> int:
        """Designs for every preview."""
        return next(iter(self.values.values())).size


def swept_of(flags: Sweep) -> Swept:
    """The sweep that flags describe."""
    if flags.preview != Sweep.preview:
        raise ValueError("preview: a sweep has --previews, for one or several")
    for limits in (named_limits, loop_limits):  # they refuse what is no limit
        limits(flags)
    machine = machine_named(flags.plant)
    pace = Pace.of(flags, machine)
    jobs = [job_named(name, pace) for name in flags.parts or machine.usual.swept]
    values = sampled_values(flags, design_for(machine, flags).tunable())
    # previews that make different controllers: all of them for LQ, one for a cascade
    designs = {preview: _design(flags, machine, preview) for preview in flags.previews}
    previews = [k if "preview" in one.reads else one.preview for k, one in designs.items()]
    flags = replace(flags, previews=tuple(dict.fromkeys(previews)))
    asked = Swept(flags, machine, jobs, values)
    noise_limit(flags, machine, asked.design(flags.previews[0]))
    _check(asked)
    return asked


def sampled_values(flags: Sweep, design: Design) -> dict[str, Float[Array, " D"]]:
    """Values of the weights that vary: a grid, or a random sample."""
    if not flags.previews:
        raise ValueError("previews: need at least one")
    varied = dict(named_numbers("vary", one) for one in flags.vary) or around_start(design)
    return sampled_designs(varied, flags.samples, flags.seed)


def around_start(design: Design) -> dict[str, tuple[float, ...]]:
    """Factors around the start of the first free weights, more decades of weights of a cost.

    Only weights count that are one positive number, equal on all axes.
    """
    starts = {}
    for name in design.free():
        starts[name] = np.unique(np.asarray(design.start[name], float))
    single = {}
    for name, values in starts.items():
        if values.size == 1 and values[0] > 0:
            single[name] = float(values[0])
    if not single:
        raise ValueError(
            f"vary: {design.name} has no weight that is one positive number; "
            f"name some of {', '.join(starts)} with their values"
        )
    values_of = {}
    for name in list(single)[:VARIED]:
        factors = COST_FACTORS if name in design.costs else FACTORS
        values_of[name] = tuple(factor * single[name] for factor in factors)
    return values_of


def _check(asked: Swept) -> None:
    """Refuse names, values and parts that do not fit before anything is written."""
    for preview in asked.flags.previews:
        design = asked.design(preview)
        known = design.start
        unknown = [name for name in asked.values if name not in known]
        if unknown:
            raise ValueError(
                f"vary: {design.name} has no weight {unknown[0]!r}; name some of {', '.join(known)}"
            )
        first = {name: column[0] for name, column in asked.values.items()}
        design.complete(with_values(design.start, first))
        for job in asked.jobs:
            job.reference(asked.machine.model.dt, design.preview)


def _design(flags: Sweep, machine: Machine, preview: int) -> Design:
    """The controller with a preview; without a word where it has none: nobody gave it one."""
    flags = replace(flags, preview=preview)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UnreadFlagWarning)
        return design_for(machine, flags).tunable()


def found_along(asked: Swept, folder: Path) -> xr.Dataset:
    """Metrics of all designs; chunks that are stored in the run folder are not computed again."""
    chunks, batching = SweepChunks(folder / CHUNKS), batching_of(asked.flags)
    for number, preview in enumerate(asked.flags.previews):
        if chunks.rows < (number + 1) * asked.count:
            _sweep_preview(asked, preview, number * asked.count, chunks, batching)
    metrics = chunks.whole()
    machine, previews = asked.machine, list(asked.flags.previews)
    designs = [asked.design(preview) for preview in previews]
    units = designs[0].units()
    shape = (len(previews), asked.count, len(asked.jobs), len(machine.family_names))
    data = {}
    for name, rows in metrics.items():
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
    # What is chosen of the controller, as its model's delay; a preview has its own place
    chosen = {name: value for name, value in designs[0].settings().items() if name != "preview"}
    plain = {name: value for name, value in chosen.items() if isinstance(value, int | float | str)}
    about = {"title": title, "controller": designs[0].name, **plain, **run_folder.versions()}
    return xr.Dataset(data, coordinates, about)


def _sweep_preview(
    asked: Swept, preview: int, before: int, chunks: SweepChunks, batching: Batching | None
) -> None:
    """Add the rows of one preview, which has so many rows before it."""
    design, count = asked.design(preview), asked.count
    scenarios = asked.scenarios(design)
    family, references = scenarios.family, scenarios.references
    steps = len(asked.jobs) * len(scenarios.plants) * references.steps
    # As many as the memory of an accelerator holds, or a few seconds of a CPU
    devices = batching.mesh.size if isinstance(batching, Spread) else 1
    memory = (jax.local_devices()[0].memory_stats() or {}).get("bytes_limit")
    each = STEPS_ON_CPU if memory is None else memory // BYTES_PER_STEP
    at_once = min(count, max(1, devices * each // steps))

    def make(varied):
        return design.complete(with_values(design.start, varied))

    while (first := chunks.rows - before) < count:
        # always as many, the last one again and again: one program
        rows = np.minimum(np.arange(first, first + at_once), count - 1)
        designs = {name: column[rows] for name, column in asked.values.items()}
        swept = sweep(make, designs, family, references, batching=batching)
        metrics = vars(swept).items()
        chunks.add({name: np.asarray(row)[: count - first] for name, row in metrics})


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
