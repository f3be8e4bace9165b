"""`jcontour sweep`: metrics over weights x preview x contours x plants, on the true machines."""

from rich.console import Console

from jcontour.app.files.netcdf import save_dataset
from jcontour.app.files.results.search_results import SweepResult
from jcontour.app.files.results.stored import write_result
from jcontour.app.flags.tuning import Sweep
from jcontour.app.reports import tables
from jcontour.app.reports.figures.axes import save_figures
from jcontour.app.reports.figures.sweeps import sweep_figure, worst_errors
from jcontour.app.reports.screen import Entry, next_step
from jcontour.app.runs.lifecycle import finished, opened
from jcontour.app.runs.spread.best_designs import ALIKE, judged
from jcontour.app.runs.spread.sweep_advice import (
    diverged_lines,
    edge_of,
    limit_lines,
    margin_lines,
    next_steps,
    repeated,
)
from jcontour.app.runs.spread.sweep_runs import found_along, swept_of

MOST_SHOWN = 3  # findings and previews on the screen


def command(flags: Sweep) -> int:
    """Sweep, store and print; exit code."""
    with opened(flags, "sweep", swept_of) as (folder, asked):
        dataset, picks = judged(asked, found_along(asked, folder))
        names, error = list(asked.values), asked.machine.error
        save_dataset(dataset, folder / "sweep.nc")
        figures = {"sweep": lambda best: sweep_figure(best, names, error)}
        save_figures(figures, dataset, folder)
        diverged, within = worst_errors(dataset, error)[1], int(dataset.within_limits.values.sum())
        result = SweepResult(diverged.size, int(diverged.sum()), within, picks)
        write_result(folder, result)
    findings = [*diverged_lines(dataset, names, error), *limit_lines(asked, dataset, result)]
    findings += [*margin_lines(asked), *edge_of(asked, result, dataset)]
    best = []
    for row in sorted(picks, key=lambda row: (bool(row.beyond), row.worst_um))[:MOST_SHOWN]:
        weights = ", ".join(f"{name} {value:.4g}" for name, value in row.weights.items())
        worst = f"{row.worst_um:.4g} um RMS, worst case, Ms {tables.digits(row.sensitivity)}"
        best.append(Entry("Best", f"{worst}: preview {row.preview}, {weights}"))
    answer = [
        *best,
        Entry("Points", counted_words(result)),
        *(Entry("Note", line) for line in findings[:MOST_SHOWN]),
        *(Entry("Again", line) for line in repeated(asked, result)),
        *map(next_step, next_steps(asked, result)),
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


def counted_words(result: SweepResult) -> str:
    """How many designs diverge and keep the limits, and which are called the best."""
    return (
        f"{result.points} points, {result.diverged} diverged, {result.within} within the limits "
        f"on their runs. Of errors within {100 * ALIKE:g} % those of the calmest control are the "
        "best"
    )
