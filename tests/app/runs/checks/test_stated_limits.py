"""Limits of machine and flags against what a loop reaches."""

import math

import numpy as np

from jcontour.analysis.uncertain_loops import BORNE, ResponseUncertainty
from jcontour.app.files.results.tuned_result import Standstill
from jcontour.app.flags.tuning import Tune
from jcontour.app.machines.uncertainty import Uncertainty
from jcontour.app.runs.checks.stated_limits import (
    stated_limits,
)
from jcontour.app.runs.tuning.limits import AT_REST
from jcontour.app.runs.tuning.problem import TuningRun
from tests.app import small_runs
from tests.app.small_runs import partly
from tuning.objectives import COUNT_NOISE, Entry

MARGINS = small_runs.margins(sensitivity=1.9, uncertainty=0.4)
DOUBT = ResponseUncertainty(np.array([0.1]), np.full((1, 2), 0.2))
ENTRIES = [
    Entry("peak_sensitivity", 0, 0),
    Entry("peak_sensitivity", 0, 1),
    Entry("peak_sensitivity", 1, 2),
    Entry("rms_increment", 0, 1),
    Entry("late_radius", 0, 2),
]
BOUNDS = {"peak_sensitivity": 2.0, "rms_increment": 0.5, "late_radius": 0.999}


def checks(flags, bounds, rest=None, response=None):
    """Two contours, the second held out, on two plants; peaks [A] and errors [m] are given."""
    counted = np.ones((2, 5), bool)
    jobs = [small_runs.job(name, counted[0]) for name in ("part", "circle")]
    scenarios = small_runs.scenarios(jobs, np.zeros((2, 5, 2)), counted, training=(True, False))
    machine = small_runs.machine(uncertainty=Uncertainty(0.1, 1, response))
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
    limit_checks = checks(Tune(), {COUNT_NOISE: AT_REST * 0.15}, rest, response=DOUBT)
    assert [one.value for one in limit_checks.values()] == [1.9, 0.4, 0.1696]
    assert [one.allowed for one in limit_checks.values()] == [2.0, BORNE, 0.15]
    assert [one.kept for one in limit_checks.values()] == [True, True, False]
    assert list(checks(Tune(), {}, rest)) == ["peak sensitivity Ms"]
