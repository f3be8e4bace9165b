"""Which controllers keep to limits, and the controller that chooses its own speed."""

from dataclasses import replace

import numpy as np
import pytest

from jcontour.app.catalogue.choices import design_for, machine_named
from jcontour.app.designs.predictive import (
    PREDICTIVE,
    PredictiveDesign,
    limited_lq,
    speed_limit,
    usual_change,
)
from jcontour.app.flags.loops import Simulate
from jcontour.controllers.lq.contouring_lq import LQWeights, OutputTerminal
from jcontour.controllers.observers.kalman import offset_free_gain
from jcontour.geometry.contours import circle
from jcontour.host.held import OneSampleLate
from jcontour.host.observed import ObservedHost, OffsetFreeHost
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
    gain = np.asarray(offset_free_gain(model, model.C, 0.1, 0.1, 1e-6))
    weights, limits = LQWeights(3.0, 50.0, 2e-8), Limits.within(control=10.0)
    found = limited_lq(model, weights, 4, OutputTerminal(), limits, DAQP(), gain, True)
    assert isinstance(found, OffsetFreeHost) and isinstance(found.controller, TrackingMPC)
    assert isinstance(found.controller.form, OffsetFreeForm) and found.preview == 4


def test_the_weight_on_changes_keeps_the_share_of_the_limit_that_lam_s_table_has():
    """R u_max^2 = 60 * 0.5^2 in the units of any control."""
    table, mill = machine_named("xy-table"), machine_named("bridgeport")
    assert usual_change(table) == (60.0, 60.0)
    np.testing.assert_allclose(usual_change(mill), 15.0 / np.asarray(mill.limits.control) ** 2)
    with pytest.raises(ValueError, match="flexible-axes states no limit on its controls"):
        usual_change(machine_named("flexible-axes"))


def test_a_path_is_no_faster_than_what_every_axis_may_run_at():
    """Lam's 0.25 m/s, or the least limit of the axes below it."""
    mill = machine_named("jcontour/app/machines/example.json")
    assert speed_limit(machine_named("xy-table")) == 0.25
    assert speed_limit(mill) == pytest.approx(0.2)
    slow = replace(mill, limits=mill.limits._replace(speed=np.array([0.15, 0.05])))
    assert speed_limit(slow) == 0.05


def test_a_controller_that_chooses_its_speed_is_not_tuned():
    with pytest.raises(
        ValueError, match="mpcc, .*chooses its own speed: nothing.*jcontour simulate"
    ):
        design_for(machine_named("xy-table"), Simulate(controller="mpcc"))


def hosted(controller, design, machine="xy-table"):
    return PREDICTIVE[controller].hosted(machine_named(machine), circle(1e-2), design)


def test_mpcc_runs_at_the_period_of_its_controller_and_waits_long_enough():
    """Lam's table: 4 ms on a plant of 1 ms; 0.25 m/s is 1 mm in a step of the controller."""
    made = hosted("mpcc", PredictiveDesign({"q_theta": 2.0}, 5, 250.0))
    mpcc = made.controller.controller
    assert made.controller.every == 4 and made.plant.dt == 1e-3 and mpcc.model.dt == 4e-3
    assert mpcc.weights.progress == 2.0 and mpcc.weights.contour_error == 100.0
    np.testing.assert_allclose(mpcc._upper[:5], 1.0)
    longest = made.reference.steps * made.plant.dt
    assert longest == pytest.approx(2 * np.pi * 1e-2 / (0.02 * 0.25), rel=1e-3)


def test_without_a_word_the_weights_are_those_of_the_machine():
    """15 / u_max^2 of the mill, Lam's own on his table."""
    mill = "jcontour/app/machines/example.json"
    made = hosted("mpcc", PredictiveDesign({}, 5, 100.0), mill).controller.controller
    np.testing.assert_allclose(made.weights.control_matrix(2), 15.0 / 250.0**2 * np.eye(2))
    made = hosted("mpcc", PredictiveDesign({"r_control": 3.0}, 5, 100.0), mill)
    np.testing.assert_array_equal(
        made.controller.controller.weights.control_matrix(2), 3.0 * np.eye(2)
    )
    made = hosted("tracking-mpc", PredictiveDesign({}, 5, 100.0), mill)
    weights = made.controller.controller.controller.weights
    np.testing.assert_allclose(weights.increment, 15.0 / 250.0**2)


def test_tracking_keeps_its_speed_and_the_usual_weights():
    made = hosted("tracking-mpc", PredictiveDesign({"increment": 6.0}, 5, 100.0))
    late = made.controller.controller
    assert isinstance(late, OneSampleLate) and made.controller.preview == 5 * made.controller.every
    weights = late.controller.weights
    assert (weights.output, weights.contour, weights.increment) == (1e8, 0.0, 6.0)
    arc = np.asarray(made.reference.arc)
    np.testing.assert_allclose(np.diff(arc[:100]), 0.1 * made.plant.dt)
