"""`jcontour sweep`: metrics over weights x preview x contours x plants, on the true machines."""

from collections.abc import Iterable

import numpy as np
import xarray as xr
from rich.console import Console

from jcontour.app.files.netcdf import save_dataset
from jcontour.app.files.results.search_results import BestDesign, SweepResult
from jcontour.app.files.results.stored import write_result
from jcontour.app.flags.tuning import Sweep
from jcontour.app.reports import tables
from jcontour.app.reports.figures.png import save_figures
from jcontour.app.reports.figures.sweeps import sweep_figure, worst_errors
from jcontour.app.reports.screen import Entry
from jcontour.app.runs.lifecycle import finished, opened
from jcontour.app.runs.spread.best_designs import (
    ALIKE,
    Beyond,
    Chosen,
    DesignLoops,
    DesignMargins,
    chosen,
    largest_of,
    within_limits,
)
from jcontour.app.runs.spread.sweep_advice import (
    diverged_lines,
    edge_of,
    limit_lines,
    next_steps,
    repeated,
)
from jcontour.app.runs.spread.sweep_asked import Swept, swept_of
from jcontour.app.runs.spread.sweep_runs import DIMENSIONS, found_along
from jcontour.app.runs.tuning.limits import named_limits

MOST_SHOWN = 3  # findings and previews on the screen
LOOPS = 100  # designs of a preview whose margins are stored: about ten seconds


def command(flags: Sweep) -> int:
    """Sweep, store and print; exit code."""
    with opened(flags, "sweep", swept_of) as (folder, asked):
        dataset, picks = judged(asked, found_along(asked, folder))
        names, error = list(asked.values), asked.machine.error
        save_dataset(dataset, folder / "sweep.nc")
        figures = {"sweep": lambda found: sweep_figure(found, names, error)}
        save_figures(figures, dataset, folder)
        result = summary_of(dataset, error, picks)
        write_result(folder, result)
    findings = [*diverged_lines(dataset, names, error), *limit_lines(asked, dataset, result)]
    findings += [*margin_lines(asked), *edge_of(asked, result, dataset)]
    answer = [
        *(Entry("Best", line) for line in best_lines(result)),
        Entry("Points", counted_words(result)),
        *(Entry("Note", line) for line in findings[:MOST_SHOWN]),
        *(Entry("Again", line) for line in repeated(asked, result)),
        *(Entry("Next", line) for line in next_steps(asked, result)),
    ]

    def show(result: SweepResult, console: Console) -> None:
        columns = {
            "preview": lambda row: str(row.preview),
            **{name: lambda row, name=name: row.weights[name] for name in names},
            f"worst RMS\n{error} um": lambda row: row.worst_um,
            "nominal\num": lambda row: row.nominal_um,
            "Ms": lambda row: "unstable" if row.sensitivity is None else f"{row.sensitivity:.3g}",
            "delay margin\nsamples": lambda row: str(row.delay_samples),
        }
        title = "Best weights within the limits for every preview (worst over contours and plants)"
        if result.best:
            console.print(tables.table_of(title, result.best, columns))
        tables.say(console, counted_words(result))
        tables.say(console, *findings)

    return finished(folder, result, flags, show, answer)


def judged(asked: Swept, dataset: xr.Dataset) -> tuple[xr.Dataset, list[BestDesign]]:
    """The metrics with what keeps the limits, and the best design of every preview that has one."""
    kept, error = within_limits(dataset, named_limits(asked.flags)), asked.machine.error
    worst = np.where(kept, worst_errors(dataset, error)[0], np.inf)
    increments = largest_of(dataset, "rms_increment")
    samples, best = np.full(len(dataset.preview), -1), []
    margins = [np.full(dataset.diverged.shape, np.nan) for _ in DesignMargins._fields]
    for p, preview in enumerate(asked.flags.previews):
        design = asked.design(preview)
        loops = DesignLoops(asked.flags, design, asked.machine, asked.scenarios(design))
        if not design.learns:
            looked = np.argsort(worst_errors(dataset, error)[0][p], kind="stable")[:LOOPS]
            varied = {name: dataset[name].values[looked] for name in asked.values}
            for values, found in zip(margins, loops.of_all(varied), strict=True):
                values[p, looked] = found
        if not kept[p].any():
            continue

        def beyond(sample: int, loops: DesignLoops = loops) -> Beyond:
            return loops.beyond(_weights(dataset, asked.values, sample))

        choice = chosen(worst[p], increments[p], beyond)
        assert choice is not None  # one is kept
        samples[p] = choice.sample
        best.append(_best(asked, dataset, p, choice, loops))
    told = {
        "peak_sensitivity": (DIMENSIONS, margins[0], {"units": "1", "long_name": "Ms", **_known()}),
        "delay_margin": (DIMENSIONS, margins[1], {"units": "samples", **_known()}),
        "within_limits": (("preview", "sample"), kept.astype("i1")),
        "best": ("preview", samples, {"long_name": "best sample within the limits; -1: none"}),
    }
    return dataset.assign(told), best


def _known() -> dict[str, str]:
    """Attribute of the margins that says which are known."""
    return {
        "comment": "NaN: the controller learns while it runs and has no linear loop, or the "
        f"design is not one of the {LOOPS} with the least errors of its preview; an unstable loop "
        "has the sensitivity inf and the delay margin -1"
    }


def margin_lines(asked: Swept) -> list[str]:
    """Designs whose margins are not in the netCDF file."""
    if any(asked.design(preview).learns for preview in asked.flags.previews):
        return [
            "The controller learns while it runs: Ms and delay margin in the table are of the "
            "loop that it begins with, sweep.nc has none"
        ]
    if asked.count > LOOPS:
        return [f"Ms and delay margin are stored of the {LOOPS} best designs of every preview"]
    return []


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


def counted_words(result: SweepResult) -> str:
    """How many designs diverge and keep the limits, and which are called the best."""
    return (
        f"{result.points} points, {result.diverged} diverged, {result.within} within the limits "
        f"on their runs. Of errors within {100 * ALIKE:g} % those of the calmest control are the "
        "best"
    )


def best_lines(result: SweepResult) -> list[str]:
    """The best design of the previews with the least error, one line each."""
    best = sorted(result.best, key=lambda row: (bool(row.beyond), row.worst_um))
    return [
        f"{row.worst_um:.4g} um RMS on the worst plant, Ms {tables.digits(row.sensitivity)}: "
        f"preview {row.preview}, "
        + ", ".join(f"{name} {value:.4g}" for name, value in row.weights.items())
        for row in best[:MOST_SHOWN]
    ]
