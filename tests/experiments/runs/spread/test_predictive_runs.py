"""Runs of single designs, and how they end."""

from dataclasses import replace

import numpy as np
import pytest

from experiments.catalogue.choices import machine_named
from experiments.designs.predictive.sweep_designs import Case, PredictiveDesign
from experiments.machines.machine import Hosted
from experiments.runs.spread.predictive_runs import Ending, predictive_run
from jcontour.geometry.contours import circle
from jcontour.geometry.periodic_splines import polar_lobes
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


@pytest.mark.slow
def test_lam_s_run_is_found_again():
    """Numbers by a program that shares no code with this one: see `test_lam`."""
    lobes = polar_lobes(30e-3, 10e-3, 4)
    case = Case("mpcc", machine_named("xy-table"), lobes)
    found = predictive_run((case, PredictiveDesign({"q_theta": 0.3}, 7, 250.0)))
    assert found.time_s == pytest.approx(2.13, rel=5e-3)
    assert found.rms_um == pytest.approx(0.0427 * 400, rel=5e-3)  # % of 40 mm


@pytest.mark.slow
def test_a_tool_that_stands_still_is_late():
    found = predictive_run((case_of("mpcc"), PredictiveDesign({"q_theta": 0.0}, 4, 500.0)))
    assert found.ending is Ending.LATE and np.isnan(found.time_s)


@pytest.mark.slow
def test_a_tool_whose_controller_alone_goes_round_is_outrun():
    """The paper's largest reward 200 times over: theta ends its lap, the tool is at its start."""
    case = Case("mpcc", machine_named("xy-table"), circle(1e-3))
    found = predictive_run((case, PredictiveDesign({"q_theta": 1000.0}, 7, 250.0)))
    assert found.ending is Ending.OUTRUN and np.isnan(found.time_s)


def reversed_drives(period):
    return Hosted(with_input_gains(xy_table(1e-3), np.array([-1.0, -1.0])), xy_table(4e-3), 4)


@pytest.mark.slow
def test_a_run_far_from_its_path_has_diverged():
    found = predictive_run((case_of("tracking-mpc", with_friction=reversed_drives), USUAL))
    assert found.ending is Ending.DIVERGED and np.isnan(found.rms_um)
