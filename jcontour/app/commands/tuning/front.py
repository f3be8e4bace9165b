"""`jcontour front`: the least contour error for every budget of control increment, or of Ms."""

from collections.abc import Callable
from pathlib import Path

from rich.console import Console

from jcontour.app.designs.design import with_values
from jcontour.app.files import run_folder
from jcontour.app.files.netcdf import save_dataset
from jcontour.app.files.results.search_results import BudgetPoint, FrontResult, dataset_of
from jcontour.app.files.results.stored import write_result
from jcontour.app.flags.tuning import Front
from jcontour.app.jobs.replays import replay
from jcontour.app.reports import tables
from jcontour.app.reports.figures.png import save_figure
from jcontour.app.reports.figures.searches import front
from jcontour.app.reports.rollouts import save_rollouts
from jcontour.app.reports.screen import Entry
from jcontour.app.runs.lifecycle import finished, opened, tuning_words
from jcontour.app.runs.tuning.trade_off import Search, search_of, traced

NAMES = {"increment": "the control increment", "sensitivity": "the peak sensitivity Ms"}
MOST_SHOWN = 6  # budgets on the screen
TUNED_BY = {"increment": "--max-rms-increment", "sensitivity": "--max-sensitivity"}


def command(flags: Front) -> int:
    """Trace, store and print a front; exit code."""
    with opened(flags, "front", search_of) as (folder, search):
        result = traced(search, folder, tables.console_of(stderr=True, quiet=flags.json))
        _store_runs(result, search, folder)
        weight_units = search.run.design.units()
        save_dataset(dataset_of(result, weight_units), folder / "front.nc")
        save_figure(front(result), folder / "front.png")
        write_result(folder, result)
    stored = run_folder.opened(folder, "front")["flags"]
    # The error within every budget, as many as a screen takes
    spent, entries = NAMES[result.against].removeprefix("the "), []
    for point in result.points[:MOST_SHOWN]:
        budget, error = tables.digits(point.budget), tables.digits(1e6 * point.error(result.error))
        margin = tables.digits(point.peak_sensitivity) + ("" if point.feasible else ", NOT KEPT")
        words = f"{spent} {budget}: RMS {result.error} error {error} um, Ms {margin}"
        entries.append(Entry("Budget", words))
    answer = [*entries, *next_steps(result, tuning_words(stored["parts"], stored))]
    return finished(folder, result, flags, show, answer)


def _store_runs(result: FrontResult, search: Search, folder: Path) -> None:
    """Write the runs of every point on the machines as they are, by budget: the page shows them.

    Weights with a number for each sample of the horizon are not kept in a point, nor are its runs.
    """
    run, points = search.run, result.points
    if any(name not in point.weights for point in points for name in result.weights):
        return
    replays = {
        tables.digits(point.budget): replay(
            run.controller(with_values(run.start, point.weights)), run.scenarios
        )
        for point in points
    }
    title = f"jcontour front: runs of every budget of {NAMES[result.against]}"
    save_rollouts("auto", replays, run.scenarios, run.machine, title, folder)


def show(result: FrontResult, console: Console) -> None:
    """Print the front, and the weights of its points."""
    plants = "nominal plant" if result.nominal_only else "family"
    title = f"Front against {NAMES[result.against]} (smooth machine, {plants})"
    used_up = {True: "no", False: "yes"}
    columns: dict[str, Callable[[BudgetPoint], str | float]] = {
        "budget": lambda point: point.budget,
        f"worst RMS {result.error} um": lambda point: 1e6 * point.error(result.error),
        "Ms": lambda point: point.peak_sensitivity,
        "RMS increment": lambda point: point.rms_increment,
        "feasible": lambda point: "yes" if point.feasible else "NO",
        "used up": lambda point: used_up[point.slack] if point.feasible else "-",
    }
    console.print(tables.table_of(title, result.points, columns, text_columns=0))
    columns = {"budget": columns["budget"]}
    for name in result.weights:
        columns[name] = lambda point, name=name: tables.weight_digits(point.weights.get(name))
    console.print(tables.table_of("Weights", result.points, columns, text_columns=0))


def next_steps(result: FrontResult, task: str) -> list[Entry]:
    """Which budgets are slack, and what to do next with the same task."""
    entries = []
    if result.tracking_cap is not None:
        words = (
            f"the RMS tracking error is held below {1e6 * result.tracking_cap:.4g} um: a tool that "
            "stands still has no contour error; --max-tracking-error-um is another"
        )
        entries.append(Entry("Limit", words))
    if result.slack:
        slack = ", ".join(map(tables.digits, result.slack))
        words = f"the best weights need less than {slack}; smaller ones with --least and --most"
        entries.append(Entry("Slack", words))
    tight = [point for point in result.points if point.feasible and not point.slack]
    words = "no budget is met and used up; give larger or smaller ones"
    if tight:
        budget = tables.digits(tight[0].budget)
        words = f"jcontour tune{task} {TUNED_BY[result.against]} {budget}"
    return [*entries, Entry("Next", words)]
