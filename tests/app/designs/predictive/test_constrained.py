"""Which controllers keep to limits, and the controller that chooses its own speed."""

from dataclasses import replace

import numpy as np
import pytest

from jcontour.app.catalogue.choices import design_for, machine_named
from jcontour.app.designs.predictive.constrained import (
    limited_lq,
    speed_limit,
    usual_change,
)
from jcontour.app.flags.loops import Simulate
from jcontour.controllers.lq.contouring_lq import LQWeights, OutputTerminal
from jcontour.controllers.observers.kalman import offset_free_gain
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
    with pytest.raises(ValueError, match="mpcc chooses its own speed.*jcontour simulate"):
        design_for(machine_named("xy-table"), Simulate(controller="mpcc"))
