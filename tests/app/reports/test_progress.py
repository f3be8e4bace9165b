"""The progress bar of a tuning run: what it says while it runs, and what stays of it."""

import io

import numpy as np
import pytest
from rich.console import Console

from jcontour.app.reports.progress import progress_of, progress_words, working
from tests.app import small_runs
from tuning.objectives import Outcome
from tuning.point import Evaluated
from tuning.problem import QUICK
from tuning.tuner import TuneState


def point(error, violation=-1.0, diverged=False, start=0):
    metrics = small_runs.metrics((2, 1), rms_contour_error=np.array([[error / 2], [error]]))
    return Evaluated(start, np.zeros(1), error, violation, Outcome(metrics), diverged)


@pytest.mark.parametrize(
    ("history", "words"),
    [
        ([], "compiling"),
        ([point(5e-6)], "descent 1 of 2: 1 point tried, best so far 5 um"),
        ([point(5e-6), point(9e-6)], "descent 1 of 2: 2 points tried, best so far 5 um"),
        ([point(5e-6, 0.2)], "descent 1 of 2: 1 point tried, best so far 5 um, beyond a limit"),
        ([point(5e-6), point(1e-6, 0.2, start=-1)], "random points: 2 points tried, best so far 5"),
        ([point(1e-6, diverged=True)], "descent 1 of 2: 1 point tried, all diverge"),
    ],
)
def test_the_best_is_told_and_not_the_last(history, words):
    assert progress_words(TuneState(history=history), QUICK, "contour").startswith(words)


def test_a_pipe_gets_a_line_for_each_stage_and_json_none():
    """A bar shows nothing there: who waits would see no sign of life."""

    def printed(**how):
        out = io.StringIO()
        console = Console(file=out, **how)
        with working(console, "trying"):
            pass
        with progress_of(console, QUICK, "contour") as show:
            for history in ([point(5e-6)], [point(5e-6), point(4e-6)], [point(1e-6, start=-1)]):
                show(TuneState(history=history))
        return out.getvalue().splitlines()

    assert printed() == [
        "jcontour: trying",
        "jcontour: descent 1 of 2: 1 point tried, best so far 5 um",
        "jcontour: random points: 1 point tried, best so far 1 um",
    ]
    assert printed(quiet=True) == []
