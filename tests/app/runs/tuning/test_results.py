"""The loop that tuned weights are compared with: closed cases."""

import numpy as np
import pytest

from jcontour.app.designs.design import Design
from jcontour.app.runs.tuning import results
from jcontour.app.runs.tuning.problem import TuningRun
from jcontour.app.runs.tuning.results import Trial, baseline_trial, recommended, suiting_all
from jcontour.app.runs.tuning.searching import Searched
from jcontour.app.runs.tuning.simple_loops import SimpleLoop
from tests.app.small_runs import partly
from tuning.parameters import Positive
from tuning.point import Point
from tuning.problem import Problem
from tuning.tuner import Tuned

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


@pytest.mark.parametrize(
    ("rise", "last_kept", "part"),
    [
        (0.05, 1.0, 1.0),  # no contour is clearly worse at the end
        (0.3, 1.0, 0.2),  # the second contour is 1.24, 1.18, 1.12, 1.06 times worse on the way back
        (0.2, 1.0, 0.4),  # 1.16, 1.12, 1.08: the farther one has the smaller mean
        (0.2, 0.3, 0.2),  # and here it is beyond a limit of the search
        (9.0, 1.0, 1.0),  # no point suits every contour
    ],
)
def test_weights_step_back_to_where_no_contour_pays(monkeypatch, rise, last_kept, part):
    """From gain 1 to gain e the first contour falls by e, and the second rises."""
    gain = {"gain": 1.0}
    run = partly(TuningRun, problem=partly(Problem, space={"gain": Positive()}), start=gain)
    way = lambda weights: float(np.log(weights["gain"]))  # noqa: E731
    monkeypatch.setattr(results, "keeps_limits", lambda run, trial: True)
    monkeypatch.setattr(results, "trial_of", lambda run, tuned, _: tuned.weights)
    monkeypatch.setattr(
        results, "_errors", lambda run, w: np.array([np.exp(-way(w)), 1 + rise * way(w)])
    )
    monkeypatch.setattr(results, "_finest", lambda run: 0.0)
    monkeypatch.setattr(
        results,
        "evaluate_point",
        lambda problem, start, z: partly(
            Point, diverged=False, limits=np.array([z[0] - last_kept]), outcome=None
        ),
    )
    end = partly(Tuned, weights={"gain": np.e}, feasible=True, prices=["dear"])
    back, trial = suiting_all(Searched(run, end, 1), gain)
    assert back.part == part and way(trial) == pytest.approx(part)
    assert back.tuned.weights is trial
    assert back.tuned.prices == (["dear"] if part == 1.0 else [])


@pytest.mark.parametrize(
    ("first", "second", "chosen"),
    [
        ([1.0, 1.0], [0.95, 0.95], 0),  # a simpler loop needs no reason
        ([1.0, 1.0], [0.9, 0.9], 1),
        ([1.4, 0.5], [1.0, 0.9], 1),  # the first makes a contour clearly worse than the start
        ([1.2, 0.5], [1.3, 0.4], 0),  # so do both
        (None, [1.0, 1.0], 1),  # beyond a stated limit
    ],
)
def test_of_candidates_the_trials_with_all_effects_decide(monkeypatch, first, second, chosen):
    monkeypatch.setattr(results, "_finest", lambda run: 0.0)
    errors = {"start": [1.0, 1.0], "one": first or [0.1, 0.1], "two": second}
    monkeypatch.setattr(results, "_errors", lambda run, trial: np.array(errors[trial.name]))
    lost = "one" if first is None else ""
    monkeypatch.setattr(results, "keeps_limits", lambda run, trial: trial.name != lost)
    trials = [(partly(Searched, run=None), Trial(*[None] * 4, name=n)) for n in ("one", "two")]
    assert recommended(trials, None, Trial(*[None] * 4, name="start")) is trials[chosen]
    assert recommended(trials[:1], None, KEPT) is trials[0]
