"""Limits of machine and flags against what a loop reaches."""

import math
from types import SimpleNamespace
from typing import Any, cast

import numpy as np

from experiments.files.results.tuned_result import PathMargins, Standstill
from experiments.flags.tuning import Tune
from experiments.jobs.replays import Replay
from experiments.machines.machine import MachineLimits
from experiments.runs.checks.weights.stated_limits import stated_limits
from experiments.runs.tuning.limits import AT_REST
from jcontour.analysis.uncertain_loops import BORNE
from tuning.objectives import COUNT_NOISE

MARGINS = PathMargins(
    spectral_radius=0.9,
    gain_range=((0.5, 2.0),),
    gain_search=(0.05, 20.0),
    delay_samples=3,
    delay_search=10,
    probes_per_contour=16,
    probes_left_out=0,
    contours_without_margins=(),
    lost_first=None,
    sensitivity=1.9,
    doubt=0.4,
)


def checks(flags, bounds, rest=None, doubt=None):
    """Two contours, the second held out, on two plants; peaks [A] and errors [m] are given."""
    still = np.zeros((2, 2, 5, 2))
    metrics = SimpleNamespace(
        diverged=np.zeros((2, 2), bool),
        peak_control=np.array([[0.1, 0.3], [0.2, 9.0]]),
        rms_tracking_error=np.array([[1e-6, np.nan], [0.0, 0.0]]),
    )
    scenarios = SimpleNamespace(
        jobs=(SimpleNamespace(name="part"), SimpleNamespace(name="circle")),
        training=(True, False),
        plants=("nominal", "late"),
        references=SimpleNamespace(
            mask=np.ones((2, 5), bool), steps=5, position=np.zeros((2, 5, 2))
        ),
    )
    machine = SimpleNamespace(
        control_unit="A",
        axes=("X", "Y"),
        limits=MachineLimits(),
        model=SimpleNamespace(dt=1e-3, inputs=2),
        doubt=doubt,
    )
    run = SimpleNamespace(flags=flags, limits=bounds, machine=machine, scenarios=scenarios)
    replay = Replay(cast(Any, metrics), still, still, still)
    return {one.name: one for one in stated_limits(cast(Any, run), replay, MARGINS, rest)}


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
    found = checks(Tune(), {COUNT_NOISE: AT_REST * 0.15}, rest, doubt=object())
    assert [one.value for one in found.values()] == [1.9, 0.4, 0.1696]
    assert [one.allowed for one in found.values()] == [2.0, BORNE, 0.15]
    assert [one.kept for one in found.values()] == [True, True, False]
    assert list(checks(Tune(), {}, rest)) == ["peak sensitivity Ms"]
