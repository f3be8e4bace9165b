"""Which controllers keep to limits, and the controller that chooses its own speed."""

from dataclasses import replace

import numpy as np
import pytest

from jcontour.app.catalogue.choices import design_for, machine_named
from jcontour.app.designs.predictive.constrained import (
    limited_lq,
    speed_limit,
    traverser,
    usual_change,
    waiting_reference,
)
from jcontour.app.flags.loops import Simulate, Trace
from jcontour.controllers.lq.contouring_lq import LQWeights, OutputTerminal
from jcontour.controllers.observers.kalman import offset_free_gain
from jcontour.geometry.contours import circle
from jcontour.host.observed import ObservedHost, OffsetFreeGain, OffsetFreeHost
from jcontour.linear.transformations import with_input_delay
from jcontour.mpc.tracking.forms import OffsetFreeForm
from jcontour.mpc.tracking.limits import Limits
from jcontour.mpc.tracking.tracking_mpc import TrackingMPC
from jcontour.qp.solvers import DAQP

KINDS = {
    "contouring-lq": OffsetFreeHost,
    "contouring-lq-kalman": ObservedHost,
    "contouring-lq-state": TrackingMPC,
    "contouring-lq-predictor": type(None),
    "preview-lq": type(None),
}


@pytest.mark.parametrize("name", KINDS)
def test_what_has_the_cost_and_the_filter_has_a_constrained_form(name):
    design = design_for(machine_named("bridgeport"), Simulate(controller=name, preview=3))
    found = design.constrained(design.start, Limits.within(control=10.0), DAQP())
    assert type(found) is KINDS[name]


def test_behind_an_observer_of_the_load_it_is_told_of_the_load(two_axes):
    model = with_input_delay(two_axes, 1)
    observer = OffsetFreeGain(offset_free_gain(model, model.C, 0.1, 0.1, 1e-6), model.C)
    weights, limits = LQWeights(3.0, 50.0, 2e-8), Limits.within(control=10.0)
    found = limited_lq(model, weights, 4, OutputTerminal(), observer, limits, DAQP())
    assert isinstance(found, OffsetFreeHost) and isinstance(found.controller, TrackingMPC)
    assert isinstance(found.controller.form, OffsetFreeForm) and found.preview == 4


def test_of_a_machine_file_the_model_is_the_plant(machine_file):
    made = traverser(machine_named(str(machine_file)), circle(1e-3), Trace())
    assert made.hosted.every == 1 and made.hosted.plant is made.hosted.model
    np.testing.assert_array_equal(made.mpcc._upper[-2:], [300.0, 300.0])


@pytest.mark.slow
def test_the_table_is_looked_at_between_the_samples_of_its_controller():
    made = traverser(machine_named("xy-table"), circle(1e-2), Trace())
    assert made.hosted.every == 4 and made.hosted.model.dt == 4e-3
    assert made.controller.every == 4 and made.hosted.plant.dt == 1e-3


@pytest.mark.parametrize(
    ("flags", "says"),
    [
        (Trace(period_ms=2.5), "^period-ms: needs a whole number of samples of 1 ms"),
        (Trace(horizon=101), "^horizon: at most 100 steps, received 101"),
        (Trace(q_contour=-1.0), "^q-contour: needs to be finite"),
        (Trace(max_control=float("inf")), "^max-control: needs to be finite"),
    ],
)
def test_faults_have_the_names_of_flags(flags, says):
    with pytest.raises(ValueError, match=says):
        traverser(machine_named("xy-table"), circle(1e-2), flags)


def test_the_weight_on_changes_keeps_the_share_of_the_limit_that_lam_s_table_has(machine_file):
    """R u_max^2 = 60 * 0.5^2 in the units of any control; a given weight is taken as it is."""
    table, mill = machine_named("xy-table"), machine_named("bridgeport")
    assert usual_change(table, np.array(0.25)) == (60.0, 60.0)  # a lower --max-control is none
    of_mill = traverser(mill, circle(1e-3), Trace()).mpcc.weights.control_matrix(2)
    np.testing.assert_allclose(of_mill, np.diag(15.0 / np.asarray(mill.limits.control) ** 2))
    given = traverser(mill, circle(1e-3), Trace(r_control=7.0)).mpcc.weights.control_matrix(2)
    np.testing.assert_array_equal(given, 7.0 * np.eye(2))
    without = machine_named("flexible-axes")
    assert set(usual_change(without, np.array(2.0))) == {15.0 / 4}


def test_a_path_is_no_faster_than_what_every_axis_may_run_at():
    """Lam's 0.25 m/s, or the least limit of the axes below it; a flag is taken as it is."""
    mill = machine_named("jcontour/app/machines/example.json")
    assert speed_limit(machine_named("xy-table")) == 0.25
    assert speed_limit(mill) == pytest.approx(0.2) and speed_limit(mill, 300.0) == 0.3
    slow = replace(mill, limits=mill.limits._replace(speed=np.array([0.15, 0.05])))
    made = traverser(slow, circle(1e-3), Trace())
    assert made.speed_limit == 0.05
    np.testing.assert_allclose(made.mpcc._upper[:7], 0.05 * 4e-3 / 1e-3)  # mm per 4 ms
    longest = waiting_reference(made).steps * made.hosted.plant.dt
    assert longest == pytest.approx(2 * np.pi * 1e-3 / (0.02 * 0.05), rel=1e-3)


def test_a_controller_that_chooses_its_speed_is_not_tuned():
    with pytest.raises(ValueError, match="mpcc chooses its own speed.*jcontour trace"):
        design_for(machine_named("xy-table"), Simulate(controller="mpcc"))
