"""`jcontour sweep --controller mpcc` or `tracking-mpc`: weights x horizon x speed, run by run.

Every design has a run of its own, with a quadratic program at every sample, in this process or in
those of a cluster.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field, fields, replace
from itertools import product
from pathlib import Path
from typing import NamedTuple

import jax
import numpy as np
import xarray as xr
from jaxtyping import Array, Float
from rich.console import Console

from jcontour.app.catalogue.choices import job_named, machine_named
from jcontour.app.designs.predictive.sweep_designs import (
    PREDICTIVE,
    Case,
    PredictiveDesign,
    PredictiveKind,
)
from jcontour.app.files import run_folder
from jcontour.app.files.netcdf import save_dataset
from jcontour.app.files.results.stored import BESIDE_OTHERS, write_result
from jcontour.app.files.sweep_files import DesignFiles
from jcontour.app.flags.shared import MachineFlags
from jcontour.app.flags.tuning import Sweep
from jcontour.app.jobs.pace import Pace
from jcontour.app.reports import tables
from jcontour.app.reports.figures.png import save_figures
from jcontour.app.reports.figures.sweeps import front_figure, on_the_front, surface_figure
from jcontour.app.reports.progress import counted
from jcontour.app.reports.screen import Entry
from jcontour.app.runs.lifecycle import finished, opened
from jcontour.app.runs.spread.cluster import Killed, answers, cluster_of
from jcontour.app.runs.spread.predictive_runs import Ending, PredictiveRun, predictive_run
from jcontour.app.runs.spread.spreading import cores
from jcontour.app.runs.spread.sweep_asked import listed_values, sampled_designs

USUAL = "lobes"  # size and tight curves of the contour in Lam, Manzie & Good (2011)
RUNS = "parts"  # folder of the designs' files inside a run folder
DIMENSIONS = ("contour", "speed", "horizon", "sample")
SHOWN = 15  # designs of the front that are printed
NAMED = 5  # designs without a result that are printed
HEEDED = (  # flags of a sweep that predictive control has a use for
    *(
        "json",
        "details",
        "plant",
        "controller",
        "parts",
        "vary",
        "previews",
        "speeds_mm_s",
        "samples",
        "seed",
    ),
    *("drawing_unit", "join_um", "corner_tolerance_um", "workers", "scheduler", "listen"),
    *("out", "resume", "trust_code"),
)


@dataclass(frozen=True)
class FrontDesign:
    """A design with less contour error than every quicker one.

    Attributes:
        weights: those that vary, by name.
        horizon: [steps of the controller].
        speed_mm_s: along the path; of mpcc the highest one.
        time_s: of all contours together.
        rms_um: contour error, the worst of the contours.
        peak_um: likewise.
    """

    weights: dict[str, float] = field(metadata=BESIDE_OTHERS)
    horizon: int
    speed_mm_s: float
    time_s: float
    rms_um: float
    peak_um: float


@dataclass(frozen=True)
class PredictiveSweepResult:
    """Summary; all numbers are in the netCDF file.

    Attributes:
        runs: designs along contours.
        arrived, late, outrun, unsolved, diverged, killed: how many ended so.
        front: designs with less error than every quicker one, the quickest first.
    """

    controller: str
    plant: str
    runs: int
    arrived: int
    late: int
    outrun: int
    unsolved: int
    diverged: int
    killed: int
    front: list[FrontDesign]


class Point(NamedTuple):
    """One run that is asked for."""

    case: Case
    design: PredictiveDesign


@dataclass(frozen=True)
class PredictiveSwept:
    """A sweep that is asked for.

    Attributes:
        names: of the contours.
        values: of the weights that vary, one entry per sample.
    """

    flags: Sweep
    kind: PredictiveKind
    cases: list[Case]
    names: list[str]
    speeds: tuple[float, ...]
    values: dict[str, Float[Array, " D"]]

    @property
    def shape(self) -> tuple[int, int, int, int]:
        """Sizes of `DIMENSIONS`."""
        samples = next(iter(self.values.values())).size
        return len(self.cases), len(self.speeds), len(self.flags.previews), samples

    def points(self) -> Iterator[Point]:
        """Every run, in the order of `DIMENSIONS`."""
        columns = {name: np.asarray(column).tolist() for name, column in self.values.items()}
        samples = [
            dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)
        ]
        for case, speed, horizon, weights in product(
            self.cases, self.speeds, self.flags.previews, samples
        ):
            yield Point(case, PredictiveDesign(weights, horizon, speed))


def command(flags: Sweep) -> int:
    """Sweep, store and print; exit code."""
    jax.config.update("jax_platforms", "cpu")  # a step at a time: a GPU would only wait
    with opened(flags, "sweep", swept_of) as (folder, asked):
        dataset = dataset_of(asked, found_along(asked, folder))
        save_dataset(dataset, folder / "sweep.nc")
        figures = {"sweep": surface_figure, "front": front_figure}
        save_figures(figures, dataset, folder)
        result = summary_of(asked, dataset)
        write_result(folder, result)
    best = min(result.front, key=lambda one: one.rms_um, default=None)
    answer = [Entry("Runs", counted_words(result))]
    if best is not None:
        weights = ", ".join(f"{name} {value:.4g}" for name, value in best.weights.items())
        how = f"horizon {best.horizon}, {best.speed_mm_s:g} mm/s, {weights}"
        answer.append(Entry("Closest", f"{best.rms_um:.4g} um RMS in {best.time_s:.4g} s: {how}"))
    answer += [Entry("Lost", line) for line in _lost_lines(asked, dataset)]
    return finished(folder, result, flags, _show, answer)


def swept_of(flags: Sweep) -> PredictiveSwept:
    """The sweep that flags describe.

    Raises:
        ValueError: a flag, a file or their combination is wrong.
    """
    assert flags.controller is not None
    # Refuse flags that nothing would heed
    for one in fields(flags):
        if one.name not in HEEDED and getattr(flags, one.name) != one.default:
            raise ValueError(f"{one.name.replace('_', '-')}: {flags.controller} has no use for it")
    if not flags.previews:
        raise ValueError("previews: need at least one")
    if not all(speed > 0 and np.isfinite(speed) for speed in flags.speeds_mm_s):
        raise ValueError(f"speeds-mm-s: need numbers above zero, received {flags.speeds_mm_s}")
    if flags.scheduler is not None and flags.workers is not None:
        raise ValueError("workers: the scheduler has its own; leave one of the two out")
    if flags.workers is not None and flags.workers < 0:
        raise ValueError(f"workers: needs at least 0, received {flags.workers}")
    kind, machine = PREDICTIVE[flags.controller], machine_named(flags.plant)
    names = list(flags.parts or (USUAL,))
    of_parts = {name: getattr(flags, name) for name in HEEDED if hasattr(MachineFlags, name)}
    pace = Pace.of(MachineFlags(**of_parts, feed_mm_per_min=3000.0), machine)  # it is not used
    jobs = [job_named(name, pace) for name in names]
    if machine.limits.control is None:
        raise ValueError(f"plant: {flags.plant} states no limit on its controls, which this needs")
    cases = [Case(flags.controller, machine, job.contour) for job in jobs]
    varied = listed_values(flags.vary) or dict([kind.varied(machine)])
    for name in varied:
        if name not in kind.weights:
            raise ValueError(
                f"vary: {flags.controller} has no weight {name!r}; "
                f"name some of {', '.join(kind.weights)}"
            )
    values = sampled_designs(varied, flags.samples, flags.seed)
    flags = replace(flags, previews=tuple(dict.fromkeys(flags.previews)))
    speeds = tuple(dict.fromkeys(flags.speeds_mm_s or kind.speeds_mm_s(machine)))
    asked = PredictiveSwept(flags, kind, cases, [job.name for job in jobs], speeds, values)
    _check_designs(asked)
    return asked


def _check_designs(asked: PredictiveSwept) -> None:
    """Make a run of each horizon and of the ends of each weight, before anything is written."""
    first = {name: float(column[0]) for name, column in asked.values.items()}
    previews, speed = asked.flags.previews, asked.speeds[0]
    tried = [PredictiveDesign(first, horizon, speed) for horizon in previews]
    for name, column in asked.values.items():
        for value in (float(np.min(column)), float(np.max(column))):
            tried.append(PredictiveDesign({**first, name: value}, previews[0], speed))
    for case, design in product(asked.cases, tried):
        hosted = case.hosted(design)
        hosted.controller.initial_memory(hosted.reference)


def found_along(asked: PredictiveSwept, folder: Path) -> list[PredictiveRun]:
    """Runs of all points; those that are stored in the run folder are not computed again.

    One whose processes were killed is not stored: a resumed sweep tries it again.
    """
    points, files = list(asked.points()), DesignFiles(folder / RUNS, PredictiveRun)
    missing = [number for number in range(len(points)) if number not in files.found]
    flags = asked.flags
    workers = min(cores(), len(missing)) if flags.workers is None else flags.workers
    console = tables.console_of(stderr=True, quiet=flags.json)
    cluster = cluster_of(workers, flags.scheduler, flags.listen)
    with cluster as client, counted(console, len(points)) as count:
        count(len(files.found))
        for place, run in answers(predictive_run, [points[k] for k in missing], client):
            if not isinstance(run, Killed):
                files.add(missing[place], run)
            count(1)
    killed = PredictiveRun(Ending.KILLED)
    return [files.found.get(number, killed) for number in range(len(points))]


def dataset_of(asked: PredictiveSwept, runs: list[PredictiveRun]) -> xr.Dataset:
    """Numbers of all runs, SI, over the dimensions of the sweep."""
    endings = [ending.value for ending in Ending]

    def column(values) -> np.ndarray:
        return np.reshape(list(values), asked.shape)

    meanings = {"flag_values": np.arange(len(endings), dtype="i1"), "flag_meanings": endings}
    numbers = column(endings.index(run.ending.value) for run in runs).astype("i1")
    data = {
        "ending": (DIMENSIONS, numbers, meanings),
        "time": (DIMENSIONS, column(run.time_s for run in runs), {"units": "s"}),
        "rms_contour_error": (DIMENSIONS, 1e-6 * column(run.rms_um for run in runs)),
        "peak_contour_error": (DIMENSIONS, 1e-6 * column(run.peak_um for run in runs)),
        "limited": (DIMENSIONS, column(run.limited for run in runs), {"units": "1"}),
        "residual": (DIMENSIONS, column(run.residual for run in runs), {"units": "1"}),
    }
    coordinates = {
        "contour": asked.names,
        "speed": ("speed", list(asked.speeds), {"units": "mm/s"}),
        "horizon": ("horizon", list(asked.flags.previews), {"units": "steps"}),
    }
    for name, values in asked.values.items():
        unit = asked.kind.weights[name][1]
        coordinates[name] = ("sample", np.asarray(values), {"units": unit})
    attributes = {
        "title": f"jcontour sweep: {asked.flags.controller} on {asked.flags.plant}",
        "comment": "predictive control has no linear loop: no Ms and no delay margin",
    }
    dataset = xr.Dataset(data, coordinates, {**attributes, **run_folder.versions()})
    for name in ("rms_contour_error", "peak_contour_error"):
        dataset[name].attrs["units"] = "m"
    return dataset


def summary_of(asked: PredictiveSwept, dataset: xr.Dataset) -> PredictiveSweepResult:
    """Counts, and the designs with less error than every quicker one."""
    front = []
    for place in on_the_front(dataset):
        here = dataset.isel(place)
        front.append(
            FrontDesign(
                weights={name: float(here[name]) for name in asked.values},
                horizon=int(here.horizon),
                speed_mm_s=float(here.speed),
                time_s=float(here.time.sum()),
                rms_um=1e6 * float(here.rms_contour_error.max()),
                peak_um=1e6 * float(here.peak_contour_error.max()),
            )
        )
    counted = np.bincount(dataset.ending.values.ravel(), minlength=len(Ending)).tolist()
    counts = {ending.value: count for ending, count in zip(Ending, counted, strict=True)}
    assert asked.flags.controller is not None
    return PredictiveSweepResult(
        asked.flags.controller, asked.flags.plant, dataset.ending.size, **counts, front=front
    )


def _show(result: PredictiveSweepResult, console: Console) -> None:
    if result.front:
        columns = {
            "horizon": lambda row: str(row.horizon),
            "speed mm/s": lambda row: f"{row.speed_mm_s:g}",
            **{name: lambda row, name=name: row.weights[name] for name in result.front[0].weights},
            "time s": lambda row: row.time_s,
            "RMS contour\nerror um": lambda row: row.rms_um,
            "peak\num": lambda row: row.peak_um,
        }
        title = "Less error than every quicker design (worst of the contours)"
        console.print(tables.table_of(title, result.front[:SHOWN], columns))
    if len(result.front) > SHOWN:
        tables.say(console, f"and {len(result.front) - SHOWN} slower ones: result.json")
    tables.say(console, counted_words(result))


def counted_words(result: PredictiveSweepResult) -> str:
    """How many runs ended in which way."""
    counts = ((getattr(result, ending.value), ending.value) for ending in Ending)
    return f"{result.runs}: {', '.join(f'{count} {name}' for count, name in counts)}"


def _lost_lines(asked: PredictiveSwept, dataset: xr.Dataset) -> list[str]:
    """The first runs that have not arrived, by name, and what can be done."""
    lost = np.argwhere(dataset.ending.values != 0)
    endings, lines = list(Ending), []
    for place in lost[:NAMED]:
        here = dataset.isel(dict(zip(DIMENSIONS, place.tolist(), strict=True)))
        weights = ", ".join(f"{name} {float(here[name]):.4g}" for name in asked.values)
        where = f"{here.contour.item()}, {float(here.speed):g} mm/s, horizon {int(here.horizon)}"
        lines.append(f"{endings[int(here.ending)].value.capitalize()}: {where}, {weights}")
    if len(lost) > NAMED:
        lines.append(f"and {len(lost) - NAMED} more: red crosses in sweep.png")
    if (dataset.ending.values == endings.index(Ending.KILLED)).any():
        lines.append("Killed: every process that computed it was. --resume tries it again.")
    return lines
