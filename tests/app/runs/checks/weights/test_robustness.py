"""The robust test, against one run after another."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from jcontour.app.catalogue.choices import design_for
from jcontour.app.flags.loops import Simulate
from jcontour.app.jobs.job import Pace, at_constant_feed
from jcontour.app.jobs.replays import Scenarios
from jcontour.app.machines.linear import bridgeport_machine
from jcontour.app.machines.machine import MachineLimits
from jcontour.app.runs.checks.weights import robustness
from jcontour.geometry.contours import circle, line
from jcontour.simulation.closed_loop import simulate
from jcontour.simulation.evaluation import member
from jcontour.simulation.metrics import score

FEW = 6


@pytest.fixture(scope="module")
def machine():
    return bridgeport_machine()


def scenarios(machine, design):
    pace = Pace(machine, 0.05, None)
    jobs = [
        at_constant_feed("arc", circle(0.5e-3), pace),
        at_constant_feed("line", line([0.0, 0.0], [2e-3, 1e-3]), pace),
        at_constant_feed("other", circle(1e-3), pace),
    ]
    return Scenarios.of(jobs, [True, True, False], machine, design.fed, design.preview)


@pytest.mark.slow
@pytest.mark.parametrize("drift", [1e-6, 3e-2])
def test_it_counts_what_single_runs_show(drift, machine, monkeypatch):
    """The second observer integrates so fast that late plants diverge under the model of none.

    No limit holds the control: a loop that rings within its limits does not diverge.
    """
    machine = replace(machine, limits=MachineLimits())
    monkeypatch.setattr(robustness, "MEMBERS", FEW)
    monkeypatch.setattr(robustness, "SIDE_BY_SIDE", 3)
    design = design_for(machine, Simulate(preview=10))
    controller = design.build(design.start._replace(drift=drift))
    seen = scenarios(machine, design)
    found = robustness.robust_test(controller, machine, seen, design.fed, seed=3)
    family = machine.random_family(FEW, 3)
    errors, lost = np.zeros((2, FEW)), np.zeros((2, FEW), bool)
    for c, job in enumerate(seen.jobs_seen(True)):
        reference = job.reference(machine.model.dt, design.preview)
        for k in range(FEW):
            metrics = score(simulate(member(family, k), controller, reference), reference)
            errors[c, k], lost[c, k] = metrics.rms_contour_error, metrics.diverged
    assert found.members == FEW and found.diverged == lost.any(axis=0).sum()
    kept = np.where(lost, -1.0, errors)
    assert found.error == pytest.approx(kept.max(), rel=1e-6)
    contour, plant = np.unravel_index(np.argmax(kept), kept.shape)
    assert found.contour == ("arc", "line")[contour]
    assert found.plant == machine.random_names(FEW, 3)[plant]
    assert (found.diverged > 0) is (drift > 1e-3)


def test_members_lie_within_the_stated_intervals(machine):
    family = machine.random_family(400, 1)
    gained = family.plant.plant  # behind counts and encoders
    gains, late = np.asarray(gained.gains), np.asarray(gained.plant.samples)
    assert gains.min() >= 0.9 and gains.max() <= 1.1 and np.ptp(gains) > 0.19
    assert late.min() >= 0 and late.max() <= 2 and np.ptp(late) > 1.9
    assert np.any(late % 1 > 0.1)


def test_the_corners_of_gains_and_delay_are_among_them(machine):
    family = machine.random_family(50, 1).plant.plant  # behind counts and encoders
    gains, late = np.asarray(family.gains), np.asarray(family.plant.samples)
    members = np.round(np.column_stack([gains, late]), 12).tolist()
    for corner in product((0.9, 1.1), (0.9, 1.1), (0.0, 2.0)):
        assert list(corner) in members


def test_a_machine_that_is_known_exactly_has_no_random_members(machine):
    known = replace(machine, gain=0.0, delay=0)
    assert known.random_family(10, 0) is None
