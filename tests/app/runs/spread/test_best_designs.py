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
    LOOPS,
    DesignLoops,
    best_design,
    best_first,
    chosen,
    within_limits,
)
from jcontour.app.runs.tuning.limits import family_peaks
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


def test_designs_are_looked_at_the_best_first_then_others_by_their_error():
    errors, calm = np.array([4.0, 2.0, 3.0, 1.0, np.inf, 2.5]), np.ones(6)
    kept = np.array([True, True, True, False, False, False])
    assert best_first(errors, kept, calm) == [1, 2, 0, 3, 5, 4]
    many = np.arange(1.0, 2 * LOOPS)
    order = best_first(many, many > 10, np.ones(many.size))
    assert order == list(range(10, 10 + LOOPS))


class Loops:
    """Loops of designs that break these limits."""

    def __init__(self, *beyond):
        self.beyond = beyond.__getitem__


def test_the_best_design_whose_loops_keep_their_limits_is_chosen():
    first, second = {"peak_sensitivity": 11.0}, {"peak_sensitivity": 12.0}
    assert chosen(Loops(first, second, {}, {}), 4) == (2, 3, {})
    assert chosen(Loops(first, second, {}), 2) == (0, 2, first)  # none within the limits on runs
    assert chosen(Loops(), 0) == (0, 0, {})


@pytest.fixture(scope="module")
def looked():
    """Loops of designs on bridgeport along a circle, and what makes them."""
    machine = machine_named("bridgeport")
    flags = Sweep(max_sensitivity=2.0, max_count_noise=None)
    design = design_for(machine, flags).tunable()
    jobs = [job_named("circle", Pace.of(flags, machine))]
    scenarios = Scenarios.of(jobs, [True], machine, design.fed, design.preview)
    made = partly(TuningRun, machine=machine, design=design, scenarios=scenarios)
    alpha, beta = np.array([0.093, 93.0, 0.093]), np.array([9300.0, 9300.0, 93000.0])
    return DesignLoops(flags, design, machine, scenarios, {"alpha": alpha, "beta": beta}), made


@pytest.mark.slow
def test_loops_are_those_of_the_family(looked):
    """Against the peaks that `tune` tells, made another way; far weights are unstable there."""
    loops, made = looked
    sharp = {"alpha": 0.093, "beta": 9300.0}
    controller = made.design.build(with_values(made.design.start, sharp))
    peaks = family_peaks(controller, made.machine, made.scenarios, made.design.fed)
    assert float(np.max(peaks.sensitivity)) > 2.0
    expected = {"peak_sensitivity": pytest.approx(float(np.max(peaks.sensitivity)), rel=1e-6)}
    assert loops.beyond(0) == expected and loops.beyond(1) == {}
    assert list(loops.beyond(2)) == ["spectral_radius"]
    sensitivity, delay = loops.margins()
    assert sensitivity[0].max() == expected["peak_sensitivity"]
    assert np.isinf(sensitivity[2]).any() and delay[2].min() == -1 and delay[1].min() >= 0
