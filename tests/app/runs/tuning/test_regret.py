"""The best of each contour alone, for the objective `regret`."""

import json
from dataclasses import fields
from types import SimpleNamespace

import jax
import numpy as np
import pytest

from jcontour.app.flags.tuning import Tune
from jcontour.app.runs.tuning import regret
from jcontour.app.runs.tuning.problem import tuning_run
from jcontour.simulation.metrics import Metrics
from tuning.outcome import Outcome
from tuning.parameters import Chart
from tuning.point import evaluate_point


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
        alone = evaluate_point(regret._alone(run, index), run.start, z).outcome
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
        return SimpleNamespace(
            outcome=SimpleNamespace(metrics=SimpleNamespace(rms_contour_error=errors))
        )

    monkeypatch.setattr(regret, "tune", tuned)
    (tmp_path / regret.BEST).write_text(json.dumps({"part": 2e-6}))
    found = regret.with_regret(run, tmp_path, lambda state: None)
    assert asked == [1] and json.loads((tmp_path / regret.BEST).read_text())["circle"] == 4e-6
    np.testing.assert_array_equal(found.problem.objective.best, [2e-6, 4e-6])
    errors = np.array([[4e-6, 6e-6], [4e-6, 8e-6]])
    same = {field.name: errors for field in fields(Metrics)}
    metrics = Metrics(**{**same, "diverged": errors > 1.0})
    np.testing.assert_allclose(found.problem.objective(Outcome(metrics)), [[2.0, 3.0, 1.0, 2.0]])
