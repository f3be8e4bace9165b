"""The best of each contour alone, for the objective `regret`."""

import json
from dataclasses import fields, replace
from pathlib import Path
from typing import Any, cast

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from rich.console import Console

from jcontour.analysis.probes import probe_samples
from jcontour.app.designs.design import Design
from jcontour.app.files.checkpoints import load_state
from jcontour.app.flags.tuning import Tune
from jcontour.app.runs.tuning import searching
from jcontour.app.runs.tuning.family_loops import WINDOWS
from jcontour.app.runs.tuning.problem import TuningRun, tuning_run
from jcontour.app.runs.tuning.searching import ROUND, NothingSound, searched
from jcontour.simulation.metrics import Metrics
from tests.app import small_runs
from tests.app.small_runs import partly
from tests.tuning.bumped import HIGH, REFERENCE, problem_of
from tuning.exchange import STABLE
from tuning.objectives import Outcome
from tuning.parameters import Chart, Positive
from tuning.point import evaluate_point
from tuning.problem import THOROUGH
from tuning.tuner import TuneState

SAMPLES = (27, 28)


@pytest.fixture(scope="module")
def run(machine_file, part_file):
    parts = (str(part_file), "circle")
    flags = Tune(parts=parts, plant=str(machine_file), preview=4, objective="regret", scatter=0)
    return tuning_run(flags)


@pytest.mark.slow
def test_a_contour_alone_has_the_metrics_and_loops_that_it_has_among_others(run):
    z = np.asarray(Chart(run.problem.space, run.start).coordinates())
    whole = evaluate_point(run.problem, run.start, z).outcome
    for index in range(2):
        alone = evaluate_point(searching._alone(run, index), run.start, z).outcome
        for a, b in zip(
            jax.tree.leaves(alone.metrics), jax.tree.leaves(whole.metrics), strict=True
        ):
            np.testing.assert_allclose(a[0], b[index], rtol=1e-9)
        probes = slice(8 * index, 8 * index + 8)
        np.testing.assert_allclose(
            alone.loops.sensitivity, whole.loops.sensitivity[probes], rtol=1e-9
        )


@pytest.mark.slow
def test_what_is_found_is_kept_and_divides_the_errors(run, tmp_path, monkeypatch):
    """An interrupted run goes on with the contour that is missing."""
    asked = []

    def tuned(problem, start, settings, show):
        asked.append(problem.references.position.shape[0])
        errors = np.array([[1e-6, 4e-6]])
        return small_runs.tuned(
            outcome=Outcome(small_runs.metrics((1, 2), rms_contour_error=errors))
        )

    monkeypatch.setattr(searching, "tune", tuned)
    (tmp_path / searching.BEST).write_text(json.dumps({"part": 2e-6}))
    found = searching.with_regret(run, tmp_path, lambda state: None)
    assert asked == [1] and json.loads((tmp_path / searching.BEST).read_text())["circle"] == 4e-6
    np.testing.assert_array_equal(found.problem.objective.best, [2e-6, 4e-6])
    errors = np.array([[4e-6, 6e-6], [4e-6, 8e-6]])
    same = {field.name: errors for field in fields(Metrics)}
    metrics = Metrics(**{**same, "diverged": errors > 1.0})
    np.testing.assert_allclose(found.problem.objective(Outcome(metrics)), [[2.0, 3.0, 1.0, 2.0]])


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
def found(folder):
    return searched(run_from(0.4), folder, lambda state: None, Console(quiet=True))


@pytest.mark.slow
def test_a_loop_between_the_probes_ends_stable_and_points_of_all_rounds_count(found, folder):
    assert not set(SAMPLES) & set(probe_samples(REFERENCE, WINDOWS).tolist())
    first = load_state(folder)
    alone = min(first.history, key=lambda row: row.objective)
    assert np.exp(alone.z[0]) * HIGH > 2  # where the search alone ends
    gain = float(found.tuned.weights["gain"])
    assert gain == pytest.approx((1 + STABLE) / HIGH, rel=1e-4)
    assert found.run.limits == {"spectral_radius": STABLE}
    rounds = [load_state(folder), load_state(folder / ROUND.format(1))]
    assert rounds[1].begin.size == 1 and not (folder / ROUND.format(2)).exists()
    assert [row.start for row in found.tuned.history] == [
        number for number, state in enumerate(rounds) for _ in state.history
    ]
    assert found.descents == 2
    rejected = sum(row.diverged for state in rounds for row in state.history)
    assert found.tuned.diverged_points == rejected and not found.tuned.stabilised


def test_nothing_sound_is_told(tmp_path):
    with pytest.raises(NothingSound, match="every start diverges"):
        searched(run_from(1e30), tmp_path, lambda state: None, Console(quiet=True))


@pytest.mark.slow
def test_what_is_stored_counts_and_an_interrupted_round_goes_on(found, folder, tmp_path):
    def stop(state):
        if state.begin.size and len(state.history) == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        searched(run_from(0.4), tmp_path, stop, Console(quiet=True))
    told: dict[Path, list[TuneState]] = {folder: [], tmp_path: []}
    for stored, states in told.items():
        again = searched(run_from(0.4), stored, states.append, Console(quiet=True)).tuned
        np.testing.assert_array_equal(again.weights["gain"], found.tuned.weights["gain"])
        assert len(again.history) == len(found.tuned.history)
    assert told[folder] == [] and told[tmp_path] != []


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
    found = searched(run, tmp_path, lambda state: None, Console(quiet=True))
    assert found.idle == ("spare",)
    assert float(found.tuned.weights["spare"]) == pytest.approx(30.0)
    assert float(found.tuned.weights["gain"]) > 0.4
    scattered = [row.z[1] for row in found.tuned.history if row.start == 1]
    assert np.exp(scattered[0]) != pytest.approx(30.0)  # where a search may end
