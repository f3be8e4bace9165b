"""The progress bar of a tuning run, with the current worst error."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from tuning.tune import Effort, TuneState

PACE = 0.85  # part of a descent that is left after a step: nobody knows how many it takes


@contextmanager
def progress_of(
    console: Console, settings: Effort, error: str
) -> Iterator[Callable[[TuneState], None]]:
    """A bar to tell the state of a run to, step by step."""
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.percentage:>3.0f} %"),
        TimeElapsedColumn(),
    )
    with Progress(*columns, console=console) as bar:
        task = bar.add_task("compiling", total=1.0)
        yield lambda state: bar.update(
            task, completed=progress(state, settings), description=_words(state, settings, error)
        )


def progress(state: TuneState, settings: Effort) -> float:
    """Part of the run that is done, from 0 to 1; never less than before."""
    if state.done:
        return 1.0
    parts = settings.starts + 1  # the random points count as much as one descent
    scattered = sum(row.start < 0 for row in state.history) / max(settings.scatter, 1)
    steps = 0 if state.descent is None else state.descent.steps
    return (max(state.start, 0) + scattered + 1 - PACE**steps) / parts


def _words(state: TuneState, settings: Effort, error: str) -> str:
    row = state.history[-1] if state.history else None
    descents = f"descent {max(state.start, 0) + 1} of {settings.starts}"
    phase = "random points" if row is not None and row.start < 0 else descents
    worst = (
        "diverged"
        if row is None or row.diverged
        else f"{1e6 * float(np.max(getattr(row.outcome.metrics, f'rms_{error}_error'))):.3f} um"
    )
    return f"{phase}: worst RMS {error} error now {worst}"
