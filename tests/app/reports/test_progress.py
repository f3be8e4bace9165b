"""The progress bar of a tuning run: what it says while it runs, and what stays of it."""

import numpy as np
import pytest

from jcontour.app.reports.progress import progress_words
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
