"""LQ under limits as a design: what it is, where it begins, what it stores, who gets none."""

import json
from dataclasses import replace

import numpy as np
import pytest

from jcontour.app.catalogue.choices import design_for, machine_named
from jcontour.app.flags.loops import Simulate
from jcontour.app.flags.tuning import Tune
from jcontour.app.runs.tuning.problem import tuning_run
from jcontour.controllers.lq.contouring_lq import ContouringLQ
from jcontour.controllers.observers.kalman import OffsetFreeWithLoad
from jcontour.geometry.contours import line
from jcontour.motion.feed_laws import constant_feed
from jcontour.motion.references import along
from jcontour.mpc.tracking.constrained_lq import ConstrainedLQ
from jcontour.mpc.tracking.limits import Limits
from jcontour.mpc.tracking.tracking_mpc import TrackingMPC
from jcontour.qp.solvers import DAQP

FLAGS = Simulate(controller="constrained-lq", preview=3)


@pytest.fixture(scope="module")
def machine():
    return machine_named("jcontour/app/machines/example.json")


@pytest.fixture(scope="module")
def design(machine):
    return design_for(machine, FLAGS)


@pytest.mark.slow
def test_it_keeps_to_every_limit_of_the_machine(machine, design):
    controller = design.build(design.start)
    assert type(controller) is OffsetFreeWithLoad and type(controller.controller) is ConstrainedLQ
    rows = controller.controller.rows
    np.testing.assert_array_equal(rows.upper[0, :4], [250.0, 250.0, 60.0, 60.0])
    assert rows.soft.tolist() == [False] * 4 + [True] * (len(rows.soft) - 4)
    assert np.nanmax(rows.upper[np.isfinite(rows.upper)]) == pytest.approx(250.0)
    bounds = set(np.round(rows.upper[-1, 4:], 12))  # for gains 10 % larger, and 3 % below
    assert bounds == {round(limit / 1.1 / 1.03, 12) for limit in (0.2, 3.0, 2.5)}


def test_it_begins_where_the_controller_without_limits_begins(machine, design):
    free = design_for(machine, Simulate(preview=3))
    assert design.start == free.start and design.free() == free.free()
    assert design.tunable().late == free.tunable().late


@pytest.mark.slow
def test_the_search_has_no_limits_of_the_machine_but_the_loop_has():
    flags = Tune(parts=("circle",), plant="jcontour/app/machines/example.json", preview=3)
    free = {name for name in tuning_run(flags).limits if name.endswith("_use")}
    assert free == {"speed_use", "acceleration_use", "control_use", "increment_use"}
    run = tuning_run(replace(flags, controller="constrained-lq"))
    assert not any(name.endswith("_use") for name in run.limits)
    assert run.problem.axis_limits is not None


@pytest.mark.slow
@pytest.mark.parametrize("name", ["bridgeport", "jcontour/app/machines/example.json"])
def test_the_search_ends_where_dearer_errors_change_the_gains_no_more(name):
    """A first loop is far from there: a factor of ten changes half of its gains."""
    machine = machine_named(name)
    design = design_for(machine, Simulate(controller="constrained-lq")).tunable()
    path = line([0.0, 0.0], [10e-3, 5e-3])
    arc = constant_feed(path, 0.05, machine.model.dt)
    reference = along(path, arc, machine.model.dt, design.preview, at_rest=False)

    def gains(more):
        start = design.start
        weights = start | {name: more * start[name] for name in ("alpha", "beta")}
        return np.asarray(
            ContouringLQ(design.model, design.loop.cost(weights), design.preview)
            .prepare(reference)
            .F[0]
        )

    def change(more):
        return np.abs(gains(10 * more) - gains(more)).max() / np.abs(gains(more)).max()

    farthest = np.exp(design.space["alpha"].reach)
    assert design.space["beta"].reach == design.space["alpha"].reach
    assert change(1.0) > 0.4
    assert change(farthest) < 2e-3


def test_verify_replays_it_on_the_host(design):
    limits = Limits.within(control=100.0)
    host = design.constrained(design.start, limits, DAQP())
    assert type(host.controller) is TrackingMPC


def test_its_observer_is_stored(design, tmp_path):
    design.save(design.build(design.start), None, tmp_path)
    stored = json.loads((tmp_path / "observer.json").read_text())
    np.testing.assert_array_equal(stored["A"], design.model.A)
    assert design.files.keys() == {"observer.json"}


def test_a_machine_without_limits_is_answered(machine):
    free = replace(machine, limits=type(machine.limits)())
    with pytest.raises(ValueError, match="constrained-lq needs .* that states limits"):
        design_for(free, FLAGS)
