"""Limits of machine and flags against what a loop reaches."""

import math

import numpy as np
import pytest

from jcontour.analysis.uncertain_loops import BORNE, Doubt
from jcontour.app.files.results.tuned_result import Standstill
from jcontour.app.flags.tuning import Tune
from jcontour.app.jobs.replays import Scenarios
from jcontour.app.runs.checks.stated_limits import (
    HELP,
    OverFamily,
    exceeded_unseen,
    over_family,
    stated_limits,
)
from jcontour.app.runs.tuning.limits import AT_REST, family_peaks
from jcontour.app.runs.tuning.problem import TuningRun, tuning_run
from jcontour.simulation.evaluation import evaluate, stack_plants
from tests.app import small_runs
from tests.app.small_runs import partly
from tuning.objectives import COUNT_NOISE, Entry, Outcome
from tuning.problem import Problem

MARGINS = small_runs.margins(sensitivity=1.9, doubt=0.4)
DOUBT = Doubt(np.array([0.1]), np.full((1, 2), 0.2))
ENTRIES = [
    Entry("peak_sensitivity", 0, 0),
    Entry("peak_sensitivity", 0, 1),
    Entry("peak_sensitivity", 1, 2),
    Entry("rms_increment", 0, 1),
    Entry("late_radius", 0, 2),
]
BOUNDS = {"peak_sensitivity": 2.0, "rms_increment": 0.5, "late_radius": 0.999}


def checks(flags, bounds, rest=None, doubt=None):
    """Two contours, the second held out, on two plants; peaks [A] and errors [m] are given."""
    counted = np.ones((2, 5), bool)
    jobs = [small_runs.job(name, counted[0]) for name in ("part", "circle")]
    scenarios = small_runs.scenarios(jobs, np.zeros((2, 5, 2)), counted, training=(True, False))
    machine = small_runs.machine(response_doubt=doubt)
    replay = small_runs.replay(
        5,
        (2, 2),
        peak_control=np.array([[0.1, 0.3], [0.2, 9.0]]),
        rms_tracking_error=np.array([[1e-6, np.nan], [0.0, 0.0]]),
    )
    run = partly(TuningRun, flags=flags, limits=bounds, machine=machine, scenarios=scenarios)
    return {one.name: one for one in stated_limits(run, replay, MARGINS, rest)}


def test_a_limit_of_the_flags_holds_for_the_worst_plant_of_the_training_contours():
    flags = Tune(max_peak_control=0.25, max_sensitivity=None)
    (one,) = checks(flags, {"peak_control": 0.25}).values()
    assert (one.value, one.allowed, one.unit, one.member) == (0.3, 0.25, "A", "part, late")
    assert not one.kept
    flags = Tune(max_tracking_error_um=5.0, max_sensitivity=None)
    (one,) = checks(flags, {"rms_tracking_error": 5e-6}).values()
    assert math.isclose(one.allowed, 5.0) and not one.kept  # a run that is lost


def test_counts_at_rest_and_loops_have_limits_too():
    rest = Standstill(rms_control=0.1696, rms_increment=0.1)
    found = checks(Tune(), {COUNT_NOISE: AT_REST * 0.15}, rest, doubt=DOUBT)
    assert [one.value for one in found.values()] == [1.9, 0.4, 0.1696]
    assert [one.allowed for one in found.values()] == [2.0, BORNE, 0.15]
    assert [one.kept for one in found.values()] == [True, True, False]
    assert list(checks(Tune(), {}, rest)) == ["peak sensitivity Ms"]


def found(*violations):
    """An outcome of those entries."""
    problem = partly(Problem, limit_entries=lambda outcome: ENTRIES)
    plants = ["nominal", "gains 1.1", "1 sample late"]
    scenarios = partly(Scenarios, plants=plants)
    run = partly(TuningRun, problem=problem, limits=BOUNDS, scenarios=scenarios)
    return OverFamily(run, Outcome(None), np.array(violations))


def test_nothing_is_said_where_every_plant_keeps_every_limit():
    assert exceeded_unseen(None) == []
    assert exceeded_unseen(found(-0.1, 0.0, 1e-7, -1.0, -1.0)) == []


def test_the_plant_that_breaks_a_limit_most_is_named():
    lines = exceeded_unseen(found(-0.1, np.log(1.2), np.log(1.909), np.log(1.05), 1e-3))
    assert lines == [
        "the plant '1 sample late' exceeds the limit peak sensitivity <= 2 by 90.9 %",
        "the plant 'gains 1.1' exceeds the limit rms increment <= 0.5 by 5 %",
        "the plant '1 sample late' does not bear the delay that --min-delay-margin asks for",
        HELP,
    ]


@pytest.mark.parametrize("lost", [np.inf, np.nan])
def test_a_plant_that_is_unstable_is_told_without_a_number(lost):
    line, _ = exceeded_unseen(found(-0.1, lost, 0.5, -1.0, -1.0))
    assert line == "a run or a loop of the plant 'gains 1.1' is unstable: peak sensitivity <= 2"


@pytest.fixture(scope="module")
def nominal(machine_file, part_file):
    """A run that sees the nominal plant alone, with limits on loops and on runs."""
    limits = {"max_sensitivity": 1.2, "max_rms_increment": 1.0, "max_effort": 1.01}
    flags = Tune(
        (str(part_file),),
        plant=str(machine_file),
        controller="linear-cascade",
        nominal_only=True,
        **limits,
    )
    return tuning_run(flags)


@pytest.mark.slow
def test_limits_are_those_of_the_whole_family(nominal):
    """Loops against the peaks of the margins, runs against the smooth machines one by one."""
    seen = over_family(nominal, nominal.start)
    assert seen is not None
    controller, machine = nominal.controller(nominal.start), nominal.machine
    peaks = family_peaks(controller, machine, nominal.scenarios, nominal.design.fed)
    assert seen.outcome.loops is not None
    np.testing.assert_allclose(seen.outcome.loops.sensitivity, peaks.sensitivity, rtol=1e-6)
    plants = machine.smooth_family(nominal.design.fed)
    references = nominal.problem.references
    runs = [evaluate(stack_plants([plant]), controller, references) for plant in plants]
    increments = [float(np.max(one.rms_increment)) for one in runs]
    controls = [float(np.max(one.rms_control)) for one in runs]
    excess = {}
    for entry, violation in zip(
        seen.run.problem.limit_entries(seen.outcome), seen.violations, strict=True
    ):
        excess.setdefault(entry.name, []).append(violation)
    largest = {name: float(np.exp(np.max(rows))) for name, rows in excess.items()}
    assert largest["peak_sensitivity"] == pytest.approx(np.max(peaks.sensitivity) / 1.2, rel=1e-6)
    assert largest["rms_increment"] == pytest.approx(max(increments), rel=1e-9)
    # the start of the whole family is the measure of an effort, not that of one plant
    assert seen.run.limits["rms_control"] == pytest.approx(1.01 * max(controls), rel=1e-9)
    assert largest["rms_control"] == pytest.approx(1 / 1.01, rel=1e-9)
    assert not seen.feasible and exceeded_unseen(seen)[-1] == HELP
    # a tuner that saw the family is not looked at again
    flags = Tune(nominal.flags.parts, plant=nominal.flags.plant, controller="linear-cascade")
    whole = tuning_run(flags, nominal.before)
    assert over_family(whole, whole.start) is None
