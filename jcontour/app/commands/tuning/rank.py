"""`jcontour rank`: every controller for a machine, tuned alike, ranked on held-out contours."""

from collections.abc import Callable, Mapping
from typing import Any

from rich.console import Console

from jcontour.app.files import run_folder
from jcontour.app.files.results.search_results import Ranked, RankedResult
from jcontour.app.files.results.stored import write_result
from jcontour.app.flags.tuning import Rank
from jcontour.app.reports import tables
from jcontour.app.reports.screen import Entry, next_step
from jcontour.app.runs.lifecycle import finished, opened, task_words, tuning_words
from jcontour.app.runs.tuning.ranking import ranked, ranking_of

BEGINS = "*"  # marks the Ms of a controller that learns


def command(flags: Rank) -> int:
    """Tune, rank, store and print; exit code."""
    with opened(flags, "rank", ranking_of) as (folder, ranking):
        result = ranked(ranking, folder, tables.console_of(stderr=True, quiet=flags.json))
        write_result(folder, result)
    answer = answer_of(result, run_folder.opened(folder, "rank")["flags"])
    return finished(folder, result, flags, show, answer, result.verdict)


def show(result: RankedResult, console: Console) -> None:
    """Print the ranking, and why some have no place in it."""
    placed = [row for row in result.rows if row.failure is None]
    title = (
        f"Controllers of {result.machine.name}, worst RMS {result.error} error of the family, "
        "geometric mean over contours"
    )

    def over_best(value: float | None, best: float | None) -> str:
        return "-" if value is None or not best else f"{value / best:.2f}"

    def state(row: Ranked) -> str:
        ended = "ended" if row.stationary else "not ended"
        return ended if row.feasible else "BEYOND A LIMIT"

    best = placed[0] if placed else None
    columns: dict[str, Callable[[Ranked], str | float | None]] = {
        "controller": lambda row: row.label,
        "held out\num": lambda row: row.held_out and 1e6 * row.held_out,
        "over\nbest": lambda row: over_best(row.held_out, best and best.held_out),
        "training\num": lambda row: row.training and 1e6 * row.training,
        "Ms": lambda row: tables.digits(row.peak_sensitivity) + (BEGINS if row.learns else ""),
        "evalua-\ntions": lambda row: str(row.evaluations),
        "com-\nputing": lambda row: over_best(row.seconds, best and best.seconds),
        "search": state,
    }
    console.print(tables.table_of(title, placed, columns))
    failed = [f"{row.label}: no place, {row.failure}" for row in result.rows if row.failure]
    tables.say(console, *failed)
    if names := result.learning:
        tables.say(
            console,
            f"Left out: {', '.join(names)}. They learn while they run, and no margin is known of "
            f"what they learn; --controllers {' '.join(names)} ranks them.",
        )
    if any(row.learns for row in placed):
        tables.say(
            console,
            f"Ms with {BEGINS}: of the loop that the controller begins with. It learns while it "
            "runs, and no margin is known of what it learns.",
        )
    tables.say(console, "Computing: processor time of the same runs, over that of the first row.")


def answer_of(result: RankedResult, task: Mapping[str, Any]) -> list[Entry]:
    """The best controller, how far the others are, and the next step on the same parts."""
    placed = [row for row in result.rows if row.failure is None and row.feasible]
    if not placed and all(row.failure for row in result.rows):
        return [next_step("another machine or part: no controller could be tried")]
    if not placed:
        looser = {"nominal_only": False} if task.get("nominal_only") else {"max_sensitivity": 3.0}
        words = task_words(task["parts"], {**task, **looser}, Rank)
        return [
            Entry("Best", "no controller keeps every limit"),
            next_step(f"jcontour rank{words}"),
        ]
    first = placed[0]
    error = first.held_out if first.held_out is not None else first.training
    unseen = "unseen" if first.held_out is not None else "training"
    size = f"{tables.digits(error and 1e6 * error)} um RMS {result.error}, worst case"
    margin = f"Ms {tables.digits(first.peak_sensitivity)}"
    entries = [Entry("Best", f"{first.label}: {size}, {unseen} contours; {margin}")]
    others = [
        f"{row.label} x {row.held_out / first.held_out:.2f}"
        for row in placed[1:]
        if row.held_out and first.held_out
    ]
    if others:
        entries.append(Entry("Others", f"error over the best: {', '.join(others)}"))
    if len(placed) < len(result.rows):
        entries.append(Entry("No place", f"{len(result.rows) - len(placed)} controllers"))
    if any(not row.stationary for row in placed):
        entries.append(
            Entry("Limit", "a search that has not ended may find more with --evaluations")
        )
    words = tuning_words(task["parts"], {**task, "controller": first.label})
    return [*entries, Entry("Next", f"jcontour tune{words}")]
