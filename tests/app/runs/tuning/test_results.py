"""The loop that tuned weights are compared with: closed cases."""

import numpy as np
import pytest

from jcontour.app.designs.design import Design
from jcontour.app.runs.tuning import results
from jcontour.app.runs.tuning.problem import TuningRun
from jcontour.app.runs.tuning.results import Trial, baseline_trial
from jcontour.app.runs.tuning.simple_loops import SimpleLoop
from tests.app.small_runs import partly

KEPT, BEYOND = Trial(*[None] * 4, name="kept"), Trial(*[None] * 4)  # pyright: ignore


def loop(name, violation=-0.1):
    known = {"design": partly(Design, name=name, fed="outputs"), "controller": lambda _: name}
    run = partly(TuningRun, start=None, machine=None, scenarios=None, **known)
    return SimpleLoop(run, 1e-6, violation)


@pytest.fixture(autouse=True)
def trials(monkeypatch):
    """Trials that keep every limit but those of a loop named "loud"."""
    monkeypatch.setattr(results, "keeps_limits", lambda run, trial: trial.name == "kept")
    monkeypatch.setattr(results, "simple_loops", lambda run: [loop("p")])
    monkeypatch.setattr(results, "tried", lambda name, *on: BEYOND if name == "loud" else KEPT)


@pytest.mark.parametrize(
    ("loops", "baseline"),
    [
        ([loop("far", 0.2), loop("pi"), loop("notch")], "pi"),
        ([], "p"),  # of a run that tries none
        ([loop("far", 0.2)], None),
        ([loop("loud")], None),  # beyond a limit with all effects
        ([loop("far", np.inf)], None),
    ],
)
def test_a_start_that_is_not_usable_gives_way_to_the_best_simple_loop(loops, baseline):
    trial = baseline_trial(loop("lq").run, BEYOND, loops)
    assert (trial and trial.name) == baseline
    assert baseline_trial(loop("lq").run, KEPT, loops) is None
