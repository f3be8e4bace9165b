"""Which design of a sweep is called the best, and what is seen at its loops."""

import numpy as np
import pytest
import xarray as xr

from jcontour.app.catalogue.choices import design_for, job_named, machine_named
from jcontour.app.designs.design import with_values
from jcontour.app.flags.tuning import Sweep
from jcontour.app.jobs.job import Pace
from jcontour.app.jobs.replays import Scenarios
from jcontour.app.runs.spread.best_designs import (
    LOOKED_AT,
    DesignLoops,
    best_design,
    chosen,
    within_limits,
)
from jcontour.app.runs.tuning.family_loops import family_peaks
from jcontour.app.runs.tuning.problem import TuningRun
from tests.app.small_runs import partly

DIMENSIONS = ("preview", "sample", "contour", "plant")


@pytest.mark.parametrize(("last", "best"), [(2.01, 2), (2.03, 1)])
def test_of_errors_that_are_alike_the_calmest_design_is_the_best(last, best):
    assert best_design(np.array([9, 2, last]), np.array([1.0, 5.0, 4.0])) == best


def test_one_run_beyond_a_limit_is_enough():
    runs = np.array([[1.0, 1.0], [1.0, 1.2], [1.0, 1.0], [0.9, 1.0]]).reshape(1, 4, 1, 2)
    lost = np.zeros(runs.shape, "i1")
    lost[0, 2, 0, 1] = 1
    data = {"peak_control": (DIMENSIONS, runs), "diverged": (DIMENSIONS, lost)}
    dataset = xr.Dataset(data)
    assert within_limits(dataset, {"peak_control": 1.1}).tolist() == [[True, False, False, True]]
    assert within_limits(dataset, {"peak_control": 0.95}).tolist() == [[False] * 4]
    assert within_limits(dataset, {}).tolist() == [[True, True, False, True]]


def test_the_best_design_whose_loops_keep_their_limits_is_chosen():
    worst, calm = np.array([4.0, 2.0, 3.0, np.inf]), np.ones(4)
    asked = []

    def look(sample):
        asked.append(sample)
        return {} if sample in (0, 3) else {"peak_sensitivity": 10.0 + sample}

    assert chosen(worst, calm, look) == (0, 3, {})
    assert asked == [1, 2, 0]


def test_where_none_keeps_them_the_best_is_told_with_what_it_breaks():
    count = LOOKED_AT + 5
    found = chosen(2.0 ** -np.arange(count), np.ones(count), lambda k: {"peak_sensitivity": k})
    assert found == (count - 1, LOOKED_AT, {"peak_sensitivity": count - 1})
    assert chosen(np.full(3, np.inf), np.ones(3), lambda k: {}) is None


@pytest.fixture(scope="module")
def looked():
    """Loops of designs on bridgeport along a circle, and what makes them."""
    machine = machine_named("bridgeport")
    flags = Sweep(max_sensitivity=2.0, max_count_noise=None)
    design = design_for(machine, flags).tunable()
    jobs = [job_named("circle", Pace.of(flags, machine))]
    scenarios = Scenarios.of(jobs, [True], machine, design.fed, design.preview)
    made = partly(TuningRun, machine=machine, design=design, scenarios=scenarios)
    return DesignLoops(flags, design, machine, scenarios), made


@pytest.mark.slow
def test_loops_are_those_of_the_family(looked):
    """Against the peaks that `tune` tells, made another way; far weights are unstable there."""
    loops, made = looked
    sharp = {"alpha": 0.093, "beta": 9300.0}
    controller = made.design.build(with_values(made.design.start, sharp))
    peaks = family_peaks(controller, made.machine, made.scenarios, made.design.fed)
    assert float(np.max(peaks.sensitivity)) > 2.0
    expected = {"peak_sensitivity": pytest.approx(float(np.max(peaks.sensitivity)), rel=1e-6)}
    assert loops.beyond(sharp) == expected
    assert loops.margins(sharp).sensitivity == expected["peak_sensitivity"]
    assert loops.beyond({"alpha": 93.0, "beta": 9300.0}) == {}
    assert list(loops.beyond({"alpha": 0.093, "beta": 93000.0})) == ["spectral_radius"]
