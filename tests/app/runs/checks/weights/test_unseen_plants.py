"""Limits of the tuner on plants that it did not see."""

from types import SimpleNamespace

import numpy as np
import pytest

from jcontour.app.flags.tuning import Tune
from jcontour.app.runs.checks.weights.unseen_plants import (
    HELP,
    OverFamily,
    exceeded_unseen,
    over_family,
)
from jcontour.app.runs.tuning.family_loops import family_peaks
from jcontour.app.runs.tuning.problem import tuning_run
from jcontour.simulation.evaluation import evaluate, stack_plants
from tuning.objectives import Entry
from tuning.outcome import Outcome

ENTRIES = [
    Entry("peak_sensitivity", 0, 0),
    Entry("peak_sensitivity", 0, 1),
    Entry("peak_sensitivity", 1, 2),
    Entry("rms_increment", 0, 1),
    Entry("late_radius", 0, 2),
]
BOUNDS = {"peak_sensitivity": 2.0, "rms_increment": 0.5, "late_radius": 0.999}


def found(*violations):
    """An outcome of those entries."""
    problem = SimpleNamespace(limit_entries=lambda outcome: ENTRIES)
    plants = ["nominal", "gains 1.1", "1 sample late"]
    run = SimpleNamespace(problem=problem, limits=BOUNDS, scenarios=SimpleNamespace(plants=plants))
    return OverFamily(run, Outcome(None), np.array(violations))  # pyright: ignore[reportArgumentType]


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
