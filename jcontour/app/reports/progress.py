"""Progress: of a tuning run, with the best error so far, of a count, and of a stage.

A terminal shows a bar, of which nothing stays; a file or a pipe gets a line for each stage.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
from rich.console import Console
from rich.progress import (
    BarColumn,
    Progress,
    ProgressColumn,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

from jcontour.app.reports.tables import say
from tuning.point import FEASIBLE, rank, sound
from tuning.problem import Effort
from tuning.tuner import TuneState

COMPILING = "compiling"
PACE = 0.85  # part of a descent that is left after a step: nobody knows how many it takes


@contextmanager
def progress_of(
    console: Console, settings: Effort, error: str
) -> Iterator[Callable[[TuneState], None]]:
    """A bar to tell the state of a run to, step by step."""
    with _bar(console, "{task.percentage:>3.0f} %") as bar:
        task, stage = bar.add_task(COMPILING, total=1.0), COMPILING

        def show(state: TuneState) -> None:
            nonlocal stage
            words = progress_words(state, settings, error)
            bar.update(task, completed=progress(state, settings), description=words)
            if stage != (stage := words.partition(":")[0]):
                announce(console, words)

        yield show


@contextmanager
def working(console: Console, words: str) -> Iterator[None]:
    """A stage that has no steps to count."""
    announce(console, words)
    with _bar(console, "") as bar:
        bar.add_task(words, total=None)
        yield


def announce(console: Console, words: str) -> None:
    """Say what begins where no bar shows it."""
    if not console.is_terminal:
        say(console, f"jcontour: {words}")


@contextmanager
def counted(console: Console, total: int, what: str = "runs") -> Iterator[Callable[[int], None]]:
    """A bar to tell how many more of a number of runs are done."""
    with _bar(console, "{task.completed:.0f} of {task.total:.0f}", TimeRemainingColumn()) as bar:
        task = bar.add_task(what, total=total)
        yield lambda more: bar.advance(task, more)


def _bar(console: Console, words: str, *more: ProgressColumn) -> Progress:
    columns = (TextColumn("{task.description}"), BarColumn(), TextColumn(words))
    return Progress(
        *(*columns, TimeElapsedColumn(), *more),
        console=console,
        transient=True,
        disable=not console.is_terminal,  # it would leave an empty line
    )


def progress(state: TuneState, settings: Effort) -> float:
    """Part of the run that is done, from 0 to 1; never less than before."""
    if state.done:
        return 1.0
    parts = settings.starts + 1  # the random points count as much as one descent
    scattered = sum(row.start < 0 for row in state.history) / max(settings.scatter, 1)
    steps = 0 if state.descent is None else state.descent.steps
    return (max(state.start, 0) + scattered + 1 - PACE**steps) / parts


def progress_words(state: TuneState, settings: Effort, error: str) -> str:
    """Where a run is, how many points were tried, and the best of them."""
    if not state.history:
        return COMPILING
    random = state.history[-1].start < 0
    descent = f"descent {max(state.start, 0) + 1} of {settings.starts}"
    tried = f"{len(state.history)} point{'s' * (len(state.history) > 1)} tried"
    return f"{'random points' if random else descent}: {tried}, {_best(state, error)}"


def _best(state: TuneState, error: str) -> str:
    rows = sound(state.history)
    if not rows:
        return "all diverge"
    best = min(rows, key=rank)
    worst = float(np.max(getattr(best.outcome.metrics, f"rms_{error}_error")))
    beyond = "" if best.violation <= FEASIBLE else ", beyond a limit"
    return f"best so far {1e6 * worst:.4g} um{beyond}"
