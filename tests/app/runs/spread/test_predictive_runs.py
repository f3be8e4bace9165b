"""Runs of single designs, and how they end."""

from dataclasses import replace

import numpy as np
import pytest

from jcontour.app.catalogue.choices import machine_named
from jcontour.app.designs.predictive.sweep_designs import Case, PredictiveDesign
from jcontour.app.machines.machine import Hosted
from jcontour.app.runs.spread.predictive_runs import Ending, predictive_run
from jcontour.geometry.contours import circle
from jcontour.host.loop import reported_loop
from jcontour.linear.transformations import with_input_gains
from jcontour.plants.xy_table import xy_table
from jcontour.simulation.traversal import traversal_score

LINE = circle(2e-3)
USUAL = PredictiveDesign({}, 4, 100.0)


def case_of(controller, **changed):
    return Case(controller, replace(machine_named("xy-table"), **changed), LINE)


@pytest.mark.slow
@pytest.mark.parametrize("controller", ["mpcc", "tracking-mpc"])
def test_numbers_are_those_of_the_run(controller):
    case = case_of(controller)
    found = predictive_run((case, USUAL))
    hosted = case.hosted(USUAL)
    run = reported_loop(hosted.plant, hosted.controller, hosted.reference)
    output = np.asarray(run.rollout.output)
    score = traversal_score(LINE, output, hosted.plant.dt)
    assert found.ending is Ending.ARRIVED
    np.testing.assert_allclose(
        [found.time_s, found.rms_um, found.peak_um],
        [score.time, 1e6 * score.rms, 1e6 * score.peak],
        rtol=1e-6,  # the nearest points are sought from other starts
    )
    assert found.limited == run.report.active_fraction and found.residual <= 1e-8


def reversed_drives(period):
    return Hosted(with_input_gains(xy_table(1e-3), np.array([-1.0, -1.0])), xy_table(4e-3), 4)


@pytest.mark.parametrize(
    ("case", "design", "ending"),
    [
        (case_of("mpcc"), PredictiveDesign({"q_theta": 0.0}, 4, 500.0), Ending.LATE),  # at rest
        # the paper's largest reward 200 times over: theta ends its lap, the tool is at its start
        (
            Case("mpcc", machine_named("xy-table"), circle(1e-3)),
            PredictiveDesign({"q_theta": 1000.0}, 7, 250.0),
            Ending.OUTRUN,
        ),
        (case_of("tracking-mpc", with_friction=reversed_drives), USUAL, Ending.DIVERGED),
    ],
)
def test_a_run_that_does_not_arrive_says_how_it_ended(case, design, ending):
    found = predictive_run((case, design))
    assert found.ending is ending and np.isnan(found.time_s)
