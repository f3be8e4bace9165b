import json
from dataclasses import replace
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.analysis.sensitivity import frozen_family
from jcontour.app.files.checkpoints import load_state, save_state
from jcontour.app.flags.tuning import Tune
from jcontour.app.jobs.replays import Scenarios
from jcontour.app.machines.machine import Machine
from jcontour.app.reports.progress import progress
from jcontour.app.runs.tuning.problem import TuningRun, tuning_run
from jcontour.app.runs.tuning.results import shown_contours
from jcontour.linear.plant import spectral_radius
from jcontour.simulation.evaluation import evaluate, stack_plants
from jcontour.simulation.metrics import Metrics
from tests.app.small_runs import partly
from tuning.objectives import AtMost, Outcome
from tuning.parameters import Chart
from tuning.point import Evaluated, evaluate_point
from tuning.problem import QUICK
from tuning.tuner import TuneState, advance


def test_state_comes_back_to_the_last_bit_at_every_step(proportional_problem, tmp_path):
    """A run that is saved and loaded after every step ends as one that was left alone."""
    problem = proportional_problem(AtMost(rms_increment=2e-5, rms_tracking_error=5e-4))
    start, effort = {name: jnp.asarray(0.3) for name in "xy"}, replace(QUICK, starts=1, scatter=2)
    straight, stored, before = TuneState(), TuneState(), 0.0
    while not straight.done:
        straight = advance(problem, start, effort, straight)
        save_state(tmp_path, advance(problem, start, effort, stored))
        stored = load_state(tmp_path)
        for a, b in zip(
            jax.tree.leaves(vars(straight)), jax.tree.leaves(vars(stored)), strict=True
        ):
            np.testing.assert_array_equal(a, b)
        assert before <= progress(stored, effort) <= 1.0
        before = progress(stored, effort)
    assert stored.done and list(tmp_path.iterdir()) == [tmp_path / "state.npz"]


@pytest.mark.slow
def test_errors_are_limited_by_those_of_the_start_on_the_smooth_machine(machine_file, part_file):
    flags = Tune(parts=(str(part_file), "circle"), plant=str(machine_file), preview=4)
    run = tuning_run(replace(flags, max_error_ratio=0.9))
    assert run.limits == {**tuning_run(flags).limits, "error_ratio": 0.9}
    family = stack_plants(run.machine.smooth_family())
    before = run.before.build(run.before.start)
    metrics = evaluate(family, before, run.problem.references)
    limits = run.problem.limits
    assert isinstance(limits, AtMost) and limits.before is not None
    worst = np.max(metrics.rms_contour_error, axis=1)
    np.testing.assert_allclose(limits.before.errors, worst, rtol=1e-9)


@pytest.mark.parametrize("ratio", [0.0, -1.0, np.inf])
def test_a_bad_ratio_is_told(machine_file, part_file, ratio):
    flags = Tune(parts=(str(part_file),), plant=str(machine_file), max_error_ratio=ratio)
    with pytest.raises(ValueError, match="max-error-ratio: a limit needs to be finite"):
        tuning_run(flags)


@pytest.mark.slow
@pytest.mark.parametrize(("sensitivity", "more"), [(None, 2), (2.0, 1)])
def test_a_delay_margin_limits_loops_with_that_much_more_delay(
    machine_file, part_file, sensitivity, more
):
    """The limit at the start weights is the radius that the library finds for them."""
    flags = Tune(parts=(str(part_file),), plant=str(machine_file), preview=4)
    run = tuning_run(replace(flags, max_sensitivity=sensitivity, min_delay_margin=more))
    z = Chart(run.problem.space, run.start).coordinates()
    point = evaluate_point(run.problem, run.start, np.asarray(z))
    loops = run.problem.loops
    cut = frozen_family(run.problem.plants, run.controller(run.start), loops.windows).cut()
    late = [spectral_radius(cut.late(delay)) for delay in range(1, more + 1)]
    wanted = np.max(late, axis=0)
    np.testing.assert_allclose(point.outcome.late, wanted, rtol=1e-9)
    assert run.limits["late_radius"] < 1
    assert ("peak_sensitivity" in run.limits) == (sensitivity is not None)


@pytest.mark.slow
def test_what_is_not_known_of_the_response_limits_the_loops(machine_file, part_file, tmp_path):
    fields = json.loads(machine_file.read_text())
    fields["uncertainty"]["response"] = {"hertz": [1, 100], "relative": [[0.01, 2.0]] * 2}
    doubted = tmp_path / "doubted.json"
    doubted.write_text(json.dumps(fields))
    run = tuning_run(Tune(parts=(str(part_file),), plant=str(doubted), preview=4))
    z = Chart(run.problem.space, run.start).coordinates()
    point = evaluate_point(run.problem, run.start, np.asarray(z))
    assert run.limits["response_doubt"] == 0.5
    assert 0 < np.max(point.outcome.loops.uncertainty) <= 0.5  # the first loop keeps it
    fields["uncertainty"]["response"]["relative"] = [[0.02, 4.0]] * 2
    doubted.write_text(json.dumps(fields))
    twice = tuning_run(Tune(parts=(str(part_file),), plant=str(doubted), preview=4))
    other = evaluate_point(twice.problem, run.start, np.asarray(z))
    np.testing.assert_allclose(
        other.outcome.loops.uncertainty, 2 * point.outcome.loops.uncertainty, rtol=1e-9
    )


class Runs(NamedTuple):
    """As much of a replay as the choice of contours looks at; errors (contour, plant)."""

    rms_contour_error: np.ndarray
    diverged: np.ndarray

    @property
    def metrics(self):
        return self


def chosen(count, tuned, lost=()):
    """Contours that are shown: the first half was trained on, and every start has the error 1."""
    training = [k < count // 2 for k in range(count)]
    diverged = np.isin(np.arange(count), lost)[:, None]
    replays = {
        "start": Runs(np.ones((count, 1)), np.zeros((count, 1), bool)),
        "tuned": Runs(np.asarray(tuned, float)[:, None], diverged),
    }
    scenarios, machine = partly(Scenarios, training=training), partly(Machine, error="contour")
    run = partly(TuningRun, scenarios=scenarios, machine=machine)
    return shown_contours(run, replays)


def test_all_of_a_few_contours_are_shown():
    assert chosen(12, range(12)) == list(range(12))


def test_of_many_contours_those_that_fared_worst_are_shown():
    assert chosen(40, range(40), lost=[2, 21]) == [2, 15, 16, 17, 18, 19, 21, 35, 36, 37, 38, 39]


def test_points_keep_what_they_look_at(tmp_path):
    ones = {name: np.ones((1, 2)) for name in Metrics.__dataclass_fields__}
    ones["diverged"] = np.zeros((1, 2), bool)
    outcome = Outcome(Metrics(**ones), count_noise=np.array([[0.1, 0.2]]))
    row = Evaluated(0, np.zeros(2), 1e-6, -0.1, outcome, False)
    save_state(tmp_path, TuneState(history=[row]))
    loaded = load_state(tmp_path).history[0].outcome
    np.testing.assert_array_equal(loaded.count_noise, outcome.count_noise)
    assert loaded.late is None
    assert loaded.loops is None
