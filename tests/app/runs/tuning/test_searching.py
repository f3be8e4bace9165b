"""Search in rounds: loops between the probes, weights without effect, interruptions."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import jax.numpy as jnp
import numpy as np
import pytest
from rich.console import Console

from jcontour.analysis.sensitivity import probe_samples
from jcontour.app.designs.design import Design
from jcontour.app.files.checkpoints import load_state
from jcontour.app.flags.tuning import Tune
from jcontour.app.runs.tuning import searching
from jcontour.app.runs.tuning.limits import WINDOWS
from jcontour.app.runs.tuning.problem import TuningRun
from jcontour.app.runs.tuning.searching import ROUND, NothingSound, Searched, searched
from tests.app.small_runs import partly
from tests.tuning.bumped import HIGH, REFERENCE, problem_of
from tuning.exchange import STABLE
from tuning.parameters import Chart, Positive
from tuning.problem import THOROUGH
from tuning.tuner import Tuned, TuneState

SAMPLES = (27, 28)


def run_from(gain):
    problem = problem_of(SAMPLES)
    nothing = cast(Any, None)
    design = partly(Design, start={"gain": jnp.asarray(gain)})
    effort = replace(THOROUGH, starts=1, scatter=0, steps=30)
    return TuningRun(Tune(), nothing, nothing, design, problem, effort, (), nothing, {})


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("run")


@pytest.fixture(scope="module")
def end(folder):
    return searched(run_from(0.4), folder, lambda state: None, Console(quiet=True))


@pytest.mark.slow
def test_a_loop_between_the_probes_ends_stable_and_points_of_all_rounds_count(end, folder):
    assert not set(SAMPLES) & set(probe_samples(REFERENCE, WINDOWS).tolist())
    first = load_state(folder)
    alone = min(first.history, key=lambda row: row.objective)
    assert np.exp(alone.z[0]) * HIGH > 2  # where the search alone ends
    gain = float(end.tuned.weights["gain"])
    assert gain == pytest.approx((1 + STABLE) / HIGH, rel=1e-4)
    assert end.run.limits == {"spectral_radius": STABLE}
    rounds = [load_state(folder), load_state(folder / ROUND.format(1))]
    assert rounds[1].begin.size == 1 and not (folder / ROUND.format(2)).exists()
    assert [row.start for row in end.tuned.history] == [
        number for number, state in enumerate(rounds) for _ in state.history
    ]
    assert end.descents == 2
    rejected = sum(row.diverged for state in rounds for row in state.history)
    assert end.tuned.diverged_points == rejected and not end.tuned.stabilised


def test_an_end_beyond_a_limit_steps_back_to_where_every_limit_is_kept(monkeypatch):
    """A limit half of the way from the start to the end: the next point tried is at 0.4 of it."""
    run = run_from(0.4)
    chart = Chart(run.problem.space, run.start)
    first = np.asarray(chart.coordinates())

    def evaluated(problem, start, z):
        beyond = (z - first)[0] - 0.5
        return SimpleNamespace(diverged=False, limits=np.array([beyond]), outcome=z)

    monkeypatch.setattr(searching, "evaluate_values", evaluated)
    nothing = cast(Any, None)
    far = chart.weights(jnp.asarray(first + 1))
    for before, kept in ((-0.1, True), (0.1, False)):  # of a point of the first round
        rows = cast(Any, [SimpleNamespace(violation=before)])
        tuned = Tuned(far, nothing, False, 0.01, 0, 0, rows, [], False, True)
        end = searching._within(Searched(run, tuned, 1)).tuned
        assert end.feasible is kept
        there = np.asarray(Chart(run.problem.space, end.weights).coordinates()) - first
        assert there[0] == pytest.approx(0.4 if kept else 1.0)


def test_nothing_sound_is_told(tmp_path):
    with pytest.raises(NothingSound, match="every start diverges"):
        searched(run_from(1e30), tmp_path, lambda state: None, Console(quiet=True))


@pytest.mark.slow
def test_what_is_stored_counts_and_an_interrupted_round_goes_on(end, folder, tmp_path):
    def stop(state):
        if state.begin.size and len(state.history) == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        searched(run_from(0.4), tmp_path, stop, Console(quiet=True))
    shown: dict[Path, list[TuneState]] = {folder: [], tmp_path: []}
    for stored, states in shown.items():
        again = searched(run_from(0.4), stored, states.append, Console(quiet=True)).tuned
        np.testing.assert_array_equal(again.weights["gain"], end.tuned.weights["gain"])
        assert len(again.history) == len(end.tuned.history)
    assert shown[folder] == [] and shown[tmp_path] != []


@pytest.mark.slow
def test_a_weight_without_effect_stays_at_its_start(tmp_path):
    run = run_from(0.4)
    space = {"gain": Positive(), "spare": Positive()}
    start = {**run.start, "spare": jnp.asarray(30.0)}
    effort = replace(run.settings, starts=2, scatter=2, every_start=True, steps=2)
    run = replace(
        run,
        problem=replace(run.problem, space=space),
        design=partly(Design, start=start),
        settings=effort,
    )
    end = searched(run, tmp_path, lambda state: None, Console(quiet=True))
    assert end.idle == ("spare",)
    assert float(end.tuned.weights["spare"]) == pytest.approx(30.0)
    assert float(end.tuned.weights["gain"]) > 0.4
    scattered = [row.z[1] for row in end.tuned.history if row.start == 1]
    assert np.exp(scattered[0]) != pytest.approx(30.0)  # where a search may end
