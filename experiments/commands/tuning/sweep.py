"""`jcontour sweep`: metrics over weights x preview x contours x plants, on the true machines."""

import warnings
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import jax
import numpy as np
import xarray as xr
from jaxtyping import Array, Float
from rich.console import Console

from experiments.catalogue.choices import UnreadFlagWarning, design_for, job_named, machine_named
from experiments.catalogue.own_classes import own_name
from experiments.commands.tuning import sweep_predictive
from experiments.designs.design import Design, by_name, plain_weights, with_values
from experiments.designs.predictive.sweep_designs import PREDICTIVE
from experiments.files import run_folder
from experiments.files.netcdf import metric_unit, save_dataset
from experiments.files.results.stored import BESIDE_OTHERS, write_result
from experiments.files.sweep_chunks import SweepChunks
from experiments.flags.shared import Limited
from experiments.flags.tuning import Sweep
from experiments.jobs.job import Pace, Task
from experiments.jobs.replays import Scenarios
from experiments.machines.machine import Machine
from experiments.reports import tables
from experiments.reports.figures.shared.png import save_figures
from experiments.reports.figures.tuning.sweep import sweep_figure, worst_errors
from experiments.runs.lifecycle import finished, opened, task_words
from experiments.runs.spread.best_designs import (
    ALIKE,
    Beyond,
    Chosen,
    DesignLoops,
    chosen,
    largest_of,
    within_limits,
)
from experiments.runs.spread.spreading import batching_of
from experiments.runs.spread.varied_weights import listed_values, sampled_designs
from experiments.runs.tuning.limits import loop_limits, named_limits, noise_limit
from jcontour.simulation.devices import Spread
from jcontour.simulation.evaluation import Batching
from tuning.objectives import COUNT_NOISE, LATE
from tuning.sweep import sweep

CHUNKS = "parts"  # folder of the chunks inside a run folder
DIMENSIONS = ("preview", "sample", "contour", "plant")
FACTORS, VARIED = (0.1, 0.3, 1.0, 3.0, 10.0), 2  # of the first weights, where none are named
# of weights of a cost: on the contours of bridgeport a tenth to a thousand times them are the best
COST_FACTORS = (1e-2, 0.1, 1.0, 10.0, 1e2, 1e3, 1e4)
STEPS_ON_CPU = 2_000_000  # of one core at once: a few seconds, which a kill costs at most
BYTES_PER_STEP = 2_000  # of a run on an accelerator, with room to spare
BEYOND = {  # limit on loops -> what is said of a design that breaks it, with its value
    "peak_sensitivity": "its Ms is {:.3g}",
    LATE: "a loop does not bear the delay that --min-delay-margin asks for",
    COUNT_NOISE: "the rounding of encoders causes {:.3g} RMS control",
    "spectral_radius": "with its gains frozen a loop is unstable",
}
NAMED = 5  # diverged designs that are printed; all of them are in the figure and in the netCDF file


@dataclass(frozen=True)
class BestDesign:
    """The best weights with one preview within the limits, by the worst error of all runs.

    Of errors that are alike, those of the calmest control are the best.

    Attributes:
        preview: [samples].
        weights: those that vary, by name.
        worst_um: worst RMS error [um].
        nominal_um: worst RMS error over the contours on the nominal plant [um].
        sensitivity: peak Ms of the frozen loops over the family; None where one is unstable.
        delay_samples: extra delay that the nominal loops bear; -1 where one is unstable as it is.
        looked: designs whose loops were looked at, the best first, until one kept the limits.
        beyond: limits on loops that it breaks, with its values, SI; none did better.
    """

    preview: int
    weights: dict[str, float] = field(metadata=BESIDE_OTHERS)
    worst_um: float
    nominal_um: float
    sensitivity: float | None
    delay_samples: int
    looked: int = 1
    beyond: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class SweepResult:
    """Summary of a sweep; all numbers are in its netCDF file.

    Attributes:
        points: designs with their previews.
        diverged: points that diverge on any plant along any contour.
        within: points that do not, and whose runs keep the limits of the flags.
        best: one design for every preview with which any is within the limits.
    """

    points: int
    diverged: int
    within: int
    best: list[BestDesign]


@dataclass(frozen=True)
class Swept:
    """A sweep that is asked for.

    Attributes:
        flags: with the previews that make different controllers.
        values: of the weights that vary, one entry per design.
    """

    flags: Sweep
    machine: Machine
    jobs: list[Task]
    values: dict[str, Float[Array, " D"]]

    def design(self, preview: int) -> Design:
        """The controller with a preview, its weights open."""
        return _design(self.flags, self.machine, preview)

    def scenarios(self, design: Design) -> Scenarios:
        """The contours and the true machines, for a controller with its preview."""
        seen = [True] * len(self.jobs)
        return Scenarios.of(self.jobs, seen, self.machine, design.fed, design.preview)

    @property
    def count(self) -> int:
        """Designs for every preview."""
        return next(iter(self.values.values())).size


def command(flags: Sweep) -> int:
    """Sweep, store and print; exit code."""
    if _controller(flags) in PREDICTIVE:
        return sweep_predictive.command(flags)
    with opened(flags, "sweep", swept_of) as (folder, asked):
        dataset, picks = judged(asked, found_along(asked, folder))
        names, error = list(asked.values), asked.machine.error
        save_dataset(dataset, folder / "sweep.nc")
        figures = {"sweep": lambda found: sweep_figure(found, names, error)}
        save_figures(figures, dataset, folder)
        result = summary_of(dataset, error, picks)
        write_result(folder, result)
    lines = [*_diverged_lines(dataset, names, error), *_limit_lines(asked, dataset, result)]
    then = [*lines, *_edge_of(asked, result, dataset), *_next_steps(asked, result)]
    return finished(folder, result, flags, _shown(names, error), then)


def swept_of(flags: Sweep) -> Swept:
    """The sweep that flags describe.

    Raises:
        ValueError: a flag, a file or their combination is wrong.
    """
    _check_flags(flags)
    for limits in (named_limits, loop_limits):  # they refuse what is no limit
        limits(flags)
    machine = machine_named(flags.plant)
    pace = Pace.of(flags, machine)
    jobs = [job_named(name, pace) for name in flags.parts or machine.usual.swept]
    values = sampled_values(flags, design_for(machine, flags).tunable())
    asked = Swept(replace(flags, previews=horizons(flags, machine)), machine, jobs, values)
    noise_limit(flags, machine, asked.design(flags.previews[0]))
    _check(asked)
    return asked


def _controller(flags: Sweep) -> str | None:
    """Name of the controller, of a run that goes on the stored one."""
    if flags.resume is None:
        return flags.controller
    return run_folder.opened(flags.resume, "sweep")["flags"].get("controller")


def sampled_values(flags: Sweep, design: Design) -> dict[str, Float[Array, " D"]]:
    """Values of the weights that vary: a grid, or a random sample.

    Raises:
        ValueError: nothing to sweep, or a value is wrong.
    """
    if not flags.previews:
        raise ValueError("previews: need at least one")
    varied = listed_values(flags.vary) or around_start(design)
    return sampled_designs(varied, flags.samples, flags.seed)


def around_start(design: Design) -> dict[str, tuple[float, ...]]:
    """Factors around the start of the first free weights, more decades of weights of a cost.

    Only weights count that are one positive number, equal on all axes.

    Raises:
        ValueError: there is no such weight.
    """
    starts = {}
    for name in design.free():
        starts[name] = np.unique(np.asarray(by_name(design.start)[name], float))
    single = {}
    for name, values in starts.items():
        if values.size == 1 and values[0] > 0:
            single[name] = float(values[0])
    if not single:
        raise ValueError(
            f"vary: {design.name} has no weight that is one positive number; "
            f"name some of {', '.join(starts)} with their values"
        )
    found = {}
    for name in list(single)[:VARIED]:
        factors = COST_FACTORS if name in design.costs else FACTORS
        found[name] = tuple(factor * single[name] for factor in factors)
    return found


def horizons(flags: Sweep, machine: Machine) -> tuple[int, ...]:
    """Previews that make different controllers: all of them for LQ, one for a cascade."""
    previews = [_design(flags, machine, preview).preview for preview in flags.previews]
    return tuple(dict.fromkeys(previews))


def _check_flags(flags: Sweep) -> None:
    if flags.preview != Sweep.preview:
        raise ValueError("preview: a sweep has --previews, for one or several")
    for name in ("speeds_mm_s", "workers", "scheduler"):
        if getattr(flags, name) != getattr(Sweep, name):
            others = ", ".join(PREDICTIVE)
            raise ValueError(f"{name.replace('_', '-')}: is for --controller {others}")


def _check(asked: Swept) -> None:
    """Refuse names, values and parts that do not fit before anything is written."""
    for preview in asked.flags.previews:
        design = asked.design(preview)
        known = by_name(design.start)
        unknown = [name for name in asked.values if name not in known]
        if unknown:
            raise ValueError(
                f"vary: {design.name} has no weight {unknown[0]!r}; name some of {', '.join(known)}"
            )
        first = {name: column[0] for name, column in asked.values.items()}
        design.build(with_values(design.start, first))
        for job in asked.jobs:
            job.reference(asked.machine.model.dt, design.preview)


def _design(flags: Sweep, machine: Machine, preview: int) -> Design:
    """The controller with a preview; without a word where it has none: nobody gave it one."""
    if flags.controller is None or own_name(flags.controller) is None:  # another has its own
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
    return _dataset(asked, chunks.whole())


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


def _dataset(asked: Swept, found: dict[str, Any]) -> xr.Dataset:
    machine, previews = asked.machine, list(asked.flags.previews)
    design = asked.design(previews[0])
    shape = (len(previews), asked.count, len(asked.jobs), len(machine.family_names))
    data = {}
    for name, rows in found.items():
        column = rows.reshape(shape)
        if column.dtype == bool:
            column = column.astype("i1")
        data[name] = (DIMENSIONS, column, {"units": metric_unit(name, machine.control_unit)})
    coordinates: dict[str, Any] = {
        "preview": ("preview", previews, {"units": "samples"}),
        "contour": [job.name for job in asked.jobs],
        "plant": machine.family_names,
    }
    for name, column in asked.values.items():
        coordinates[name] = ("sample", np.asarray(column), {"units": design.units()[name]})
    kept = {}
    for name, value in plain_weights(design.start).items():
        if isinstance(value, float) and name not in asked.values:
            kept[name] = value
    title = f"jcontour sweep: machine with {machine.nonsmooth_effects}"
    return xr.Dataset(data, coordinates, {"title": title, **kept, **run_folder.versions()})


def judged(asked: Swept, dataset: xr.Dataset) -> tuple[xr.Dataset, list[BestDesign]]:
    """The metrics with what keeps the limits, and the best design of every preview that has one."""
    kept, error = within_limits(dataset, named_limits(asked.flags)), asked.machine.error
    worst = np.where(kept, worst_errors(dataset, error)[0], np.inf)
    increments = largest_of(dataset, "rms_increment")
    samples, best = np.full(len(dataset.preview), -1), []
    for p, preview in enumerate(asked.flags.previews):
        if not kept[p].any():
            continue
        design = asked.design(preview)
        loops = DesignLoops(asked.flags, design, asked.machine, asked.scenarios(design))

        def beyond(sample: int, loops: DesignLoops = loops) -> Beyond:
            return loops.beyond(_weights(dataset, asked.values, sample))

        found = chosen(worst[p], increments[p], beyond)
        assert found is not None  # one is kept
        samples[p] = found.sample
        best.append(_best(asked, dataset, p, found, loops))
    told = {
        "within_limits": (("preview", "sample"), kept.astype("i1")),
        "best": ("preview", samples, {"long_name": "best sample within the limits; -1: none"}),
    }
    return dataset.assign(told), best


def _best(
    asked: Swept, dataset: xr.Dataset, place: int, found: Chosen, loops: DesignLoops
) -> BestDesign:
    """What is told of a design, by the place of its preview."""
    weights = _weights(dataset, asked.values, found.sample)
    margins = loops.margins(weights)
    here = dataset.isel(preview=place, sample=found.sample)
    errors = 1e6 * here[f"rms_{asked.machine.error}_error"].values
    return BestDesign(
        preview=int(here.preview),
        weights=weights,
        worst_um=float(errors.max()),
        nominal_um=float(errors[:, 0].max()),
        sensitivity=margins.sensitivity,
        delay_samples=margins.delay_samples,
        looked=found.looked,
        beyond=found.beyond,
    )


def _weights(dataset: xr.Dataset, names: Iterable[str], sample: int) -> dict[str, float]:
    return {name: float(dataset[name][sample]) for name in names}


def summary_of(dataset: xr.Dataset, error: str, best: list[BestDesign]) -> SweepResult:
    """Counts, beside the best designs of a judged sweep."""
    _, diverged = worst_errors(dataset, error)
    within = int(dataset.within_limits.values.sum())
    return SweepResult(diverged.size, int(diverged.sum()), within, best)


def _shown(names: list[str], error: str):
    """Printer of a result whose designs have these weights."""

    def show(result: SweepResult, console: Console) -> None:
        rows = []
        for row in result.best:
            numbers = [*(row.weights[name] for name in names), row.worst_um, row.nominal_um]
            peak = "unstable" if row.sensitivity is None else f"{row.sensitivity:.3g}"
            words = [*(f"{number:.4g}" for number in numbers), peak, str(row.delay_samples)]
            rows.append([str(row.preview), *words])
        title = "Best weights within the limits for every preview (worst over contours and plants)"
        errors = [f"worst RMS\n{error} um", "nominal\num"]
        columns = ["preview", *names, *errors, "Ms", "delay margin\nsamples"]
        if rows:
            console.print(tables.plain_table(title, columns, rows))
        tables.say(
            console,
            f"{result.points} points, {result.diverged} diverged, {result.within} within the "
            f"limits on their runs. Of errors within {100 * ALIKE:g} % those of the calmest "
            "control are the best.",
        )

    return show


def _diverged_lines(dataset: xr.Dataset, names: list[str], error: str) -> list[str]:
    """The first diverged designs by name."""
    _, diverged = worst_errors(dataset, error)
    places = np.argwhere(diverged)
    lines = []
    for p, i in places[:NAMED]:
        weights = ", ".join(f"{name} {float(dataset[name][i]):.4g}" for name in names)
        lines.append(f"Diverged: preview {int(dataset.preview[p])}, {weights}")
    if len(places) > NAMED:
        lines.append(f"and {len(places) - NAMED} more: red crosses in the figure")
    return lines


def _limit_lines(asked: Swept, dataset: xr.Dataset, result: SweepResult) -> list[str]:
    """What keeps a limit nowhere, and what was passed over for limits on loops."""
    lines = []
    for place in np.flatnonzero(dataset.best.values < 0).tolist():
        lines += _none_within(asked, dataset.isel(preview=[place]))
    for row in result.best:
        where, better = f"preview {row.preview}", row.looked - 1
        if row.beyond:
            what = ", ".join(BEYOND[name].format(value) for name, value in row.beyond.items())
            also = f", and {better} next best ones break a limit as well" if better else ""
            lines.append(f"WARNING: {where}: the best design breaks a limit: {what}{also}")
        elif better:
            lines.append(
                f"With {where}, {better} design{'s' if better > 1 else ''} with less error or a "
                "calmer control break a limit on the loops: Ms, delay margin or noise of counts"
            )
    return lines


def _none_within(asked: Swept, one: xr.Dataset) -> list[str]:
    """A line for a preview with which no design is within the limits, and what comes nearest."""
    lost = worst_errors(one, asked.machine.error)[1][0]
    limits = named_limits(asked.flags)
    if lost.all():
        return []
    least = []
    for metric, bound in limits.items():
        factor = 1e6 if metric.endswith("_error") else 1.0
        unit = "um" if metric.endswith("_error") else asked.machine.control_unit
        value = factor * float(largest_of(one, metric)[0, ~lost].min())
        least.append(
            f"{metric.replace('_', ' ').replace('rms', 'RMS')} {value:.4g} {unit} "
            f"(limit {factor * bound:.4g})"
        )
    return [
        f"WARNING: preview {int(one.preview[0])}: none of {lost.size} designs keeps the limits; "
        f"the least of each: {', '.join(least)}"
    ]


def _leading(best: Sequence[BestDesign]) -> BestDesign:
    """The design with the least error, of those that break no limit if there are any."""
    return min(best, key=lambda row: (bool(row.beyond), row.worst_um))


def _next_steps(asked: Swept, result: SweepResult) -> list[str]:
    if not result.best and result.diverged < result.points:
        return ["Next: no design keeps the limits; allow more, or sweep other weights with --vary."]
    if not result.best:
        return ["Next: every design diverges; sweep smaller weights with --vary."]
    best = _leading(result.best)
    given = dict(words.split("=", 1) for words in asked.flags.weights)
    weights = given | {name: f"{value:.6g}" for name, value in best.weights.items()}
    flags = vars(asked.flags) | {name: None for name in weights if name in vars(asked.flags)}
    flags |= {"weights": [f"{name}={value}" for name, value in weights.items()]}
    if len(asked.flags.previews) > 1 or asked.design(best.preview).settings().get("terminal"):
        flags |= {"preview": best.preview}
    words = task_words(asked.flags.parts, flags, Limited)
    return [f"Next: tune from the best point with jcontour tune{words}"]


def _edge_of(asked: Swept, result: SweepResult, dataset: xr.Dataset) -> list[str]:
    if asked.flags.samples or not result.best:  # a random sample has no edge
        return []
    best = _leading(result.best)
    here = dataset.sel(preview=[best.preview])
    worst, _ = worst_errors(here, asked.machine.error)
    kept = here.within_limits.values[0].astype(bool)
    return edge_lines(best.weights, asked.values, np.where(kept, worst[0], np.inf))


def edge_lines(
    best: Mapping[str, float],
    values: Mapping[str, Float[Array, " D"]],
    worst: Float[np.ndarray, " D"],
) -> list[str]:
    """A line for every weight that is best at the end of its grid, if none is as good inside."""
    ends = {name: (grid.min(), grid.max()) for name, grid in values.items() if np.ptp(grid) > 0}
    inside = np.ones(len(worst), bool)
    for name, (low, high) in ends.items():
        inside &= np.asarray((values[name] > low) & (values[name] < high))
    if worst[inside].min(initial=np.inf) <= (1 + ALIKE) * worst.min():
        return []
    return [
        f"The best {name}, {best[name]:.6g}, lies on the edge of the grid: "
        f"try {'smaller' if best[name] == places[0] else 'larger'} ones with --vary."
        for name, places in ends.items()
        if best[name] in places
    ]
