"""`jcontour front`: the least contour error for every budget of control increment, or of Ms."""

from collections.abc import Callable

from rich.console import Console

from jcontour.app.designs.design import with_values
from jcontour.app.files import run_folder
from jcontour.app.files.netcdf import save_variables
from jcontour.app.files.results.search_results import BudgetPoint, FrontResult, variables_of
from jcontour.app.files.results.stored import write_result
from jcontour.app.flags.tuning import Front
from jcontour.app.jobs.replays import replay
from jcontour.app.reports import tables
from jcontour.app.reports.rollouts import save_rollouts
from jcontour.app.reports.screen import Entry, next_step
from jcontour.app.runs.lifecycle import created, finished, opened, tuning_words
from jcontour.app.runs.tuning.feeds import front_of_feeds
from jcontour.app.runs.tuning.trade_off import search_of, traced

NAMES = {
    "increment": "the control increment",
    "sensitivity": "the peak sensitivity Ms",
    "feed": "the feed",
}
MOST_SHOWN = 6  # budgets on the screen
TUNED_BY = {"increment": "--max-rms-increment", "sensitivity": "--max-sensitivity"}


def command(flags: Front) -> int:
    """Trace, store and print a front; exit code."""
    if flags.against == "feed":
        result, units = front_of_feeds(flags), {}
        folder, answer = created(flags, "front"), feed_entries(result)
    else:
        with opened(flags, "front", search_of) as (folder, search):
            result = traced(search, folder, tables.console_of(stderr=True, quiet=flags.json))
            run, points = search.run, result.points
            # The page shows the runs of every point, by budget; weights with a number for each
            # sample of the horizon are not kept in a point, nor are its runs
            if all(name in point.weights for point in points for name in result.weights):
                replays = {
                    tables.digits(point.budget): replay(
                        run.controller(with_values(run.start, point.weights)), run.scenarios
                    )
                    for point in points
                }
                title = f"jcontour front: runs of every budget of {NAMES[result.against]}"
                save_rollouts("auto", replays, run.scenarios, run.machine, title, folder)
            units = run.design.units()
        stored = run_folder.opened(folder, "front")["flags"]
        # The error within every budget, as many as a screen takes
        spent, answer = NAMES[result.against].removeprefix("the "), []
        for point in result.points[:MOST_SHOWN]:
            budget, error = map(tables.digits, (point.budget, 1e6 * point.error(result.error)))
            margin = tables.digits(point.peak_sensitivity)
            margin += "" if point.feasible else ", NOT KEPT"
            words = f"{spent} {budget}: RMS {result.error} error {error} um, Ms {margin}"
            answer.append(Entry("Budget", words))
        answer += next_steps(result, tuning_words(stored["parts"], stored))
    title = {"title": f"jcontour front: error against {result.against}", **run_folder.versions()}
    save_variables(variables_of(result, units), title, folder / "front.nc")
    write_result(folder, result)
    return finished(folder, result, flags, show, answer, result.verdict)


def show(result: FrontResult, console: Console) -> None:
    """Print the front and the weights of its points; of feeds which limits each exceeds."""
    if result.against == "feed":
        title = f"{result.contour} on {result.machine.name}, {result.controller}"
        states = {True: "", False: "BEYOND A LIMIT"}
        feeds: dict[str, Callable[[BudgetPoint], str | float]] = {
            "feed\n%": lambda point: f"{point.budget:g}",
            "cycle\ntime s": lambda point: f"{point.cycle_time:.3f}",
            "peak um\nworst": lambda point: 1e6 * point.objective,
            "RMS um\nworst": lambda point: 1e6 * point.error(result.error),
            "RMS\nincrement": lambda point: point.rms_increment,
            "": lambda point: (
                "recommended" if point.budget == result.recommended else states[point.feasible]
            ),
        }
        console.print(tables.table_of(title, result.points, feeds, text_columns=0))
        lines = [f"{one.budget:g} %: {line}" for one in result.points for line in one.messages]
        tables.say(console, *lines)
        return
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


def feed_entries(result: FrontResult) -> list[Entry]:
    """The quickest feeds in a line each, and what to do next."""
    entries = []
    for point in result.points[-MOST_SHOWN:]:
        feed, peak = f"{point.budget:g} %", tables.digits(1e6 * point.objective)
        state = "" if point.feasible else ", BEYOND A LIMIT"
        words = f"{point.cycle_time:.3f} s, peak {result.error} error {peak} um{state}"
        entries.append(Entry(feed, words))
        entries += [Entry("Warning", f"{feed}: {line}") for line in point.messages]
    words = "set the feed override of the control, or the feeds of the program"
    if result.recommended is None:
        words = "slower --overrides, or `jcontour tune` for this part and machine first"
        if any(point.feasible for point in result.points):
            words = "--max-peak-contour-error-um, the largest error that the part may have"
    return [*entries, next_step(words)]


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
    return [*entries, next_step(words)]
