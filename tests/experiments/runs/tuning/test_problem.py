import json
from dataclasses import replace
from types import SimpleNamespace
from typing import NamedTuple

import jax
import numpy as np
import pytest

from experiments.files.checkpoints import load_state, save_state
from experiments.files.netcdf import load_dataset, save_dataset, save_gains
from experiments.flags.tuning import Tune
from experiments.jobs.replays import replay
from experiments.reports.progress import progress
from experiments.reports.rollouts import rollouts
from experiments.runs.tuning.problem import tuning_run
from experiments.runs.tuning.results import shown_contours
from jcontour.analysis.sensitivity import LoopPeaks, late_radius
from jcontour.guarantees.worst_cases import PeakValues
from jcontour.simulation.evaluation import evaluate, member, stack_plants
from jcontour.simulation.metrics import Metrics
from tuning.history import Evaluated
from tuning.objectives import AtMost
from tuning.outcome import Outcome
from tuning.parameters import Chart
from tuning.point import evaluate_point, evaluate_values
from tuning.tune import TuneState, advance


@pytest.fixture(scope="module")
def job(machine_file, part_file):
    return tuning_run(
        Tune(
            parts=(str(part_file),),
            plant=str(machine_file),
            preview=4,
            scatter=2,
            starts=1,
            steps=4,
            max_rms_control=90.0,
        )
    )


@pytest.mark.slow
def test_state_comes_back_to_the_last_bit_at_every_step(job, tmp_path):
    """A run that is saved and loaded after every step ends as one that was left alone."""
    straight, stored, before = TuneState(), TuneState(), 0.0
    while not straight.done:
        straight = advance(job.problem, job.start, job.settings, straight)
        save_state(tmp_path, advance(job.problem, job.start, job.settings, stored))
        stored = load_state(tmp_path)
        for a, b in zip(
            jax.tree.leaves(vars(straight)), jax.tree.leaves(vars(stored)), strict=True
        ):
            np.testing.assert_array_equal(a, b)
        assert before <= progress(stored, job.settings) <= 1.0
        before = progress(stored, job.settings)
    assert stored.done and list(tmp_path.iterdir()) == [tmp_path / "state.npz"]


@pytest.mark.slow
@pytest.mark.parametrize("objective", ["typical", "regret"])
def test_errors_are_limited_by_those_of_the_start_on_the_smooth_machine(
    machine_file, part_file, objective
):
    flags = Tune(
        parts=(str(part_file), "circle"), plant=str(machine_file), preview=4, objective=objective
    )
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
def test_rollouts_round_trip(job, tmp_path):
    controller = job.controller(job.start)
    run = replay(controller, job.scenarios)
    machine = replace(job.machine, control_unit="mm/s")
    dataset = rollouts({"start": run}, job.scenarios, machine, {"title": "test"})
    found = load_dataset(save_dataset(dataset, tmp_path / "rollouts.nc"))
    assert (
        found.output.dims == ("design", "contour", "plant", "time", "axis")
        and found.output.attrs["units"] == "m"
    )
    assert (
        found.control.attrs["units"] == "mm/s"
        and found.time.attrs["units"] == "s"
        and found.attrs["title"] == "test"
    )
    assert (
        found.rms_contour_error.dims == ("design", "contour", "plant")
        and found.rms_contour_error.attrs["units"] == "m"
    )
    assert list(found.axis.values) == ["X", "Y"] and found.plant.values[0] == "nominal"
    np.testing.assert_array_equal(found.output.values[0], run.output)
    norm = np.linalg.norm(found.contour_error.values, axis=-1)
    mean = (norm**2 * found.scored.values[None, :, None]).sum(-1) / found.scored.values.sum(-1)[
        None, :, None
    ]
    np.testing.assert_allclose(np.sqrt(mean), found.rms_contour_error.values, rtol=1e-12)


@pytest.mark.slow
def test_gains_round_trip(job, tmp_path):
    plan = job.controller(job.start).prepare(member(job.scenarios.references, 0))
    steps = job.scenarios.jobs[0].arc.size
    path = save_gains(plan, steps, job.machine.model.dt, "N/kg", tmp_path / "gains.csv")
    names = path.read_text().split("\n")[0].split(",")
    rows = np.loadtxt(path, delimiter=",", skiprows=1)
    assert (
        names[:3] == ["k", "t_s", "F_u1_x1_N_per_kg_per_x1"]
        and names[-1] == "f_u2_N_per_kg"
        and rows.shape == (steps, len(names))
    )
    np.testing.assert_array_equal(rows[:, 2:-2], np.asarray(plan.F)[:steps].reshape(steps, -1))


@pytest.mark.slow
def test_parts_are_for_training_and_others_held_out(job):
    names = ["part", "circle", "ellipse", "lemniscate", "square"]
    assert [one.name for one in job.scenarios.jobs] == names
    assert job.scenarios.training == (True, False, False, False, False)


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
    seen = run.problem.plants, run.controller(run.start), loops.windows
    wanted = np.max([late_radius(*seen, delay) for delay in range(1, more + 1)], axis=0)
    np.testing.assert_allclose(point.outcome.late, wanted, rtol=1e-9)
    assert run.limits["late_radius"] < 1
    assert ("peak_sensitivity" in run.limits) == (sensitivity is not None)


@pytest.mark.slow
def test_the_noise_of_counts_is_limited_to_a_part_of_the_control(machine_file, part_file, tmp_path):
    """Of the same loop twice the count is twice the noise; the limits need no margin beside it."""
    fields = json.loads(machine_file.read_text()) | {"limits": {"control": 8.0}}
    path = tmp_path / "counting.json"
    path.write_text(json.dumps(fields))
    flags = Tune(parts=(str(part_file),), plant=str(path), preview=4, max_sensitivity=None)
    run = tuning_run(flags)
    assert run.limits["count_noise"] == pytest.approx(0.08)
    z = np.asarray(Chart(run.problem.space, run.start).coordinates())
    once = evaluate_values(run.problem, run.start, z).outcome.count_noise
    loops = run.problem.loops
    twice = replace(run.problem, loops=replace(loops, count=2 * loops.count))
    assert np.all(np.isfinite(once)) and np.all(once > 0)
    found = evaluate_values(twice, run.start, z).outcome.count_noise
    np.testing.assert_allclose(found, 2 * once, rtol=1e-12)
    assert "count_noise" not in tuning_run(replace(flags, max_count_noise=None)).limits
    with pytest.raises(ValueError, match="max-count-noise: a limit needs to be finite and above"):
        tuning_run(replace(flags, max_count_noise=0.0))


@pytest.mark.slow
def test_what_is_not_known_of_the_response_limits_the_loops(machine_file, part_file, tmp_path):
    fields = json.loads(machine_file.read_text())
    fields["uncertainty"]["response"] = {"hertz": [1, 100], "relative": [[0.01, 2.0]] * 2}
    doubted = tmp_path / "doubted.json"
    doubted.write_text(json.dumps(fields))
    run = tuning_run(Tune(parts=(str(part_file),), plant=str(doubted), preview=4))
    z = Chart(run.problem.space, run.start).coordinates()
    found = evaluate_point(run.problem, run.start, np.asarray(z))
    assert run.limits["response_doubt"] == 0.5
    assert 0 < np.max(found.outcome.loops.doubt) <= 0.5  # the first loop keeps it
    fields["uncertainty"]["response"]["relative"] = [[0.02, 4.0]] * 2
    doubted.write_text(json.dumps(fields))
    twice = tuning_run(Tune(parts=(str(part_file),), plant=str(doubted), preview=4))
    other = evaluate_point(twice.problem, run.start, np.asarray(z))
    np.testing.assert_allclose(other.outcome.loops.doubt, 2 * found.outcome.loops.doubt, rtol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("more", [-1, 11])
def test_a_delay_margin_that_is_none_is_named(machine_file, part_file, more):
    flags = Tune(parts=(str(part_file),), plant=str(machine_file), min_delay_margin=more)
    with pytest.raises(ValueError, match="min-delay-margin: needs 0 to 10 samples"):
        tuning_run(flags)


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
    run = SimpleNamespace(
        scenarios=SimpleNamespace(training=training), machine=SimpleNamespace(error="contour")
    )
    return shown_contours(run, replays)


def test_all_of_a_few_contours_are_shown():
    assert chosen(12, range(12)) == list(range(12))


@pytest.mark.slow
def test_of_many_contours_those_that_fared_worst_are_shown():
    assert chosen(40, range(40), lost=[2, 21]) == [2, 15, 16, 17, 18, 19, 21, 35, 36, 37, 38, 39]


@pytest.mark.slow
def test_the_certified_objective_has_the_slopes_of_differences(machine_file, part_file):
    flags = Tune(parts=(str(part_file),), plant=str(machine_file), preview=4, objective="certified")
    run = tuning_run(flags)
    assert run.limits["certified_control_use"] < 1
    z, h = np.asarray(Chart(run.problem.space, run.start).coordinates()), 1e-4
    point = evaluate_point(run.problem, run.start, z)
    assert point.errors.shape == (1, len(run.machine.family_names))
    for k, e in enumerate(np.eye(z.size)):
        above, below = (evaluate_values(run.problem, run.start, z + s * h * e) for s in (1, -1))
        difference = (above.errors - below.errors) / (2 * h)
        np.testing.assert_allclose(point.slopes.errors[..., k], difference, atol=1e-4)


@pytest.mark.parametrize("flags", [{"objective": "certified"}, {"force": 0.1}])
def test_a_machine_that_is_not_linear_has_no_certified_objective(flags):
    with pytest.raises(ValueError, match="plant: flexible-axis.* is not linear"):
        tuning_run(Tune(plant="flexible-axis", **flags))


def test_points_keep_their_certified_errors(tmp_path):
    ones = {name: np.ones((1, 2)) for name in Metrics.__dataclass_fields__}
    ones["diverged"] = np.zeros((1, 2), bool)
    proven = PeakValues(np.array([[1e-6, 2e-6]]), np.array([[0.5, 0.25]]))
    outcome = Outcome(Metrics(**ones), certified=proven, count_noise=np.array([[0.1, 0.2]]))
    row = Evaluated(0, np.zeros(2), 1e-6, -0.1, outcome, False)
    save_state(tmp_path, TuneState(history=[row]))
    found = load_state(tmp_path).history[0].outcome
    np.testing.assert_array_equal(found.certified, proven)
    np.testing.assert_array_equal(found.count_noise, outcome.count_noise)
    assert found.late is None
    assert found.loops is None


def test_states_of_a_version_without_doubts_are_read(tmp_path):
    """Its loops have no `loops_doubt`: no response was doubted, so nothing of it was used."""
    ones = {name: np.ones((1, 2)) for name in Metrics.__dataclass_fields__}
    ones["diverged"] = np.zeros((1, 2), bool)
    peaks = LoopPeaks(*(np.full((1, 2), k + 1.0) for k in range(len(LoopPeaks._fields))))
    row = Evaluated(0, np.zeros(2), 1e-6, -0.1, Outcome(Metrics(**ones), peaks), False)
    path = save_state(tmp_path, TuneState(history=[row]))
    with np.load(path) as file:
        np.savez(path, **{name: file[name] for name in file.files if name != "loops_doubt"})
    found = load_state(tmp_path).history[0].outcome.loops
    assert not found.doubt.any()
    np.testing.assert_array_equal(found._replace(doubt=peaks.doubt), peaks)
