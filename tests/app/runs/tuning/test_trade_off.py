"""Searches of a front: what the flags ask for, and a front against the peak sensitivity."""

from dataclasses import replace

import numpy as np
import pytest

from jcontour.analysis.sensitivity import probe_windows, sensitivity_curves
from jcontour.app.designs.design import with_values
from jcontour.app.flags.tuning import Front
from jcontour.app.reports.tables import console_of
from jcontour.app.runs.tuning import trade_off
from jcontour.app.runs.tuning.limits import WINDOWS
from jcontour.app.runs.tuning.trade_off import search_of, traced


@pytest.fixture(scope="module")
def search(machine_file, part_file):
    flags = Front(
        parts=(str(part_file),), plant=str(machine_file), preview=4, against="sensitivity", points=2
    )
    result = search_of(flags)
    return replace(
        result, run=replace(result.run, settings=replace(trade_off.EFFORT, starts=2, scatter=4))
    )


@pytest.fixture(scope="module")
def result(search, tmp_path_factory):
    return traced(search, tmp_path_factory.mktemp("front"), console_of(quiet=True))


@pytest.mark.slow
def test_more_sensitivity_is_less_error(search, result):
    robust, fast = result.points
    assert (robust.budget, fast.budget) == pytest.approx((1.4, 3.0))
    assert result.against == "sensitivity"
    for point in result.points:
        assert point.feasible
        assert point.peak_sensitivity <= point.budget * (1 + 1e-6)
    assert not robust.slack and robust.peak_sensitivity == pytest.approx(1.4, rel=1e-3)
    assert robust.objective > 1.01 * fast.objective
    # curves on a grid of frequencies come near the peak, and do not exceed it
    problem = search.run.problem
    controller = problem.build(with_values(search.run.start, robust.weights))
    windows = probe_windows(problem.references, WINDOWS)
    curves = sensitivity_curves(problem.plants, controller, windows, np.linspace(1e-3, np.pi, 4001))
    assert robust.peak_sensitivity * 0.999 < curves.max() < robust.peak_sensitivity * (1 + 1e-9)


def test_budgets_in_the_wrong_order_are_named(tmp_path):
    with pytest.raises(ValueError, match="least: 2 is above the largest budget, 1$"):
        trade_off._budgets(Front(least=2.0, most=1.0), None, None, tmp_path)
    assert trade_off._budgets(Front(points=3), 1.0, 4.04, tmp_path) == pytest.approx(
        [1.01, 2.02, 4.04]
    )


@pytest.mark.parametrize(
    ("flags", "says"),
    [
        (Front(points=0), "points: needs at least 1"),
        (Front(max_rms_increment=1.0), "max-rms-increment: the front varies it; leave it out"),
        (Front(against="sensitivity", max_sensitivity=1.5), "max-sensitivity: the front varies it"),
        (Front(least=0.0), "least: needs to be finite and above 0"),
        (Front(most=float("inf")), "most: needs to be finite"),
        (Front(against="sensitivity", least=1.0), "least: needs to be finite and above 1"),
    ],
)
def test_bad_flags_are_named(flags, says):
    with pytest.raises(ValueError, match=says):
        search_of(flags)
