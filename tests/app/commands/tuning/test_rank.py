"""`rank` from the command line, and what it prints."""

import json
import math

import numpy as np
import pytest

from jcontour.app.cli import main
from jcontour.app.commands.tuning.rank import show
from jcontour.app.files.results.run_metrics import MachineSummary
from jcontour.app.files.results.search_results import Ranked, RankedResult
from jcontour.app.files.results.stored import read_result
from jcontour.app.files.results.verdict import Verdict
from jcontour.app.flags.tuning import Tune
from jcontour.app.reports.tables import console_of
from jcontour.app.runs.tuning import ranking
from jcontour.app.runs.tuning.problem import tuning_run
from jcontour.app.runs.tuning.ranking import verdict_on
from jcontour.simulation.evaluation import evaluate, stack_plants, stack_references

MACHINE = MachineSummary("table", "A", ("X", "Y"), "encoders")


def row(label, held_out, feasible=True, **others):
    return Ranked(label=label, held_out=held_out, feasible=feasible, **others)


RESULT = RankedResult(
    machine=MACHINE,
    verdict=Verdict.of([]),
    error="contour",
    evaluations=40,
    rows=[
        row("good", 2e-6, training=1e-6, evaluations=41, seconds=0.5, stationary=True),
        row(
            "other",
            3e-6,
            training=4e-6,
            evaluations=12,
            seconds=1.0,
            peak_sensitivity=1.8,
            learns=True,
        ),
        row("failed", None, failure="a plant of the family diverges on cam"),
    ],
)


@pytest.fixture
def folder(tour):
    """A ranking of two controllers after a few evaluations."""
    return tour("rank").folder


def test_each_has_the_same_evaluations_and_the_best_comes_first(folder):
    rows = read_result(folder, RankedResult).rows
    assert {row.label for row in rows} == {"contouring-lq-kalman", "contouring-lq"}
    for row in rows:
        # the last step may need two
        assert row.failure is None and 3 <= row.evaluations <= 4
    keys = [(not row.feasible, row.held_out) for row in rows]
    assert keys == sorted(keys)


def test_errors_are_those_of_the_true_family_on_contours_that_were_not_trained_on(
    folder, machine_file, part_file
):
    row = read_result(folder, RankedResult).rows[0]
    flags = Tune(parts=(str(part_file),), plant=str(machine_file), controller=row.label, preview=4)
    run = tuning_run(flags)
    controller = run.controller(type(run.start)(**row.weights))
    family = stack_plants(run.machine.true_family(run.design.fed))
    jobs = run.scenarios.jobs_seen(False)
    paths = [job.reference(run.machine.model.dt, run.design.preview) for job in jobs]
    metrics = evaluate(family, controller, stack_references(paths))
    worst = np.max(metrics.rms_contour_error, axis=1).tolist()
    assert list(row.held_out_errors) == [job.name for job in jobs]
    np.testing.assert_allclose(list(row.held_out_errors.values()), worst, rtol=1e-9)
    assert row.held_out == pytest.approx(math.prod(worst) ** (1 / len(worst)), rel=1e-9)


def test_a_stored_ranking_is_told_without_tuning(folder, capsys, monkeypatch):
    monkeypatch.setattr(ranking, "_row", None)
    before = json.loads((folder / "result.json").read_text())
    assert main(["rank", "--resume", str(folder), "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == {"run": str(folder), **before}


def test_the_table_compares_with_the_best_and_names_failures(capsys):
    show(RESULT, console_of())
    printed = capsys.readouterr().out
    rows = {line.split()[0]: line.split()[1:] for line in printed.splitlines() if line.split()}
    assert rows["good"] == ["2", "1.00", "1", "-", "41", "1.00", "ended"]
    assert rows["other"] == ["3", "1.50", "4", "1.8*", "12", "2.00", "not", "ended"]
    assert "failed: no place, a plant of the family diverges on cam" in printed
    assert "Left out" not in printed


def test_the_verdict_is_for_the_best_that_keeps_every_limit():
    line = "acceleration of X EXCEEDS its limit: 7 of 4 m/s^2"
    beyond = row("beyond", 1e-6, feasible=False, exceeded=[line])
    verdict = verdict_on([*RESULT.rows, beyond], ["the weights were tried on a single plant"])
    assert verdict.exit_code == 0 and verdict.heading == "USE good, tuned"
    assert verdict.warnings == ["the weights were tried on a single plant"]
    verdict = verdict_on([beyond, RESULT.rows[2]], [])
    assert verdict.exit_code == 3 and verdict.heading.startswith("DO NOT USE")
    assert verdict.reasons[1:] == [
        f"beyond: {line}",
        "failed: a plant of the family diverges on cam",
    ]
