"""Which controllers suit a machine, and which of them a name means."""

import json
from dataclasses import replace
from pathlib import Path

import jax
import numpy as np
import pytest

from jcontour.app.catalogue.choices import (
    controllers_for,
    design_for,
    first_machine,
    job_named,
    machine_named,
    seeing_all,
)
from jcontour.app.catalogue.contours import CONTOURS
from jcontour.app.catalogue.controllers import CONTROLLERS
from jcontour.app.catalogue.machines import (
    FLEXIBLE_AXES,
    FLEXIBLE_AXIS,
    GANTRY,
    GANTRY_WITH_FRICTION,
    GANTRY_WITHOUT_FRICTION,
    LIMITED,
    LINEAR,
    MACHINES,
)
from jcontour.app.flags.loops import Simulate
from jcontour.app.jobs.pace import Pace
from jcontour.app.plain_numbers import WholePath
from jcontour.motion.references import along
from jcontour.simulation.closed_loop import prepared

THESIS_AXIS = Path(__file__).parents[3] / "jcontour" / "app" / "machines" / "thesis-axis.json"
ALONG_CONTOURS = {name for name, entry in CONTROLLERS.items() if entry.suits is FLEXIBLE_AXES}
SUITED = {  # machine -> the kinds that it is of
    "bridgeport": [LINEAR, LIMITED],
    "xy-table": [LINEAR, LIMITED],
    "emps": [LINEAR, LIMITED],
    "flexible-axis": [FLEXIBLE_AXIS],
    "flexible-axes": [FLEXIBLE_AXIS, FLEXIBLE_AXES],
    "gantry": [GANTRY, GANTRY_WITHOUT_FRICTION],
    "gantry-friction": [GANTRY, GANTRY_WITH_FRICTION],
}


@pytest.mark.parametrize(
    "name",
    [pytest.param(n, marks=[pytest.mark.slow] * (n == "gantry")) for n in MACHINES],
)
def test_an_unknown_controller_is_answered_with_those_of_the_machine(name):
    machine = machine_named(name)
    suited = [one for one, entry in CONTROLLERS.items() if entry.suits in SUITED[name]]
    assert controllers_for(machine) == suited and machine.usual.controller in suited
    with pytest.raises(ValueError, match=f"none named 'magic'; give one of {', '.join(suited)}$"):
        design_for(machine, Simulate(controller="magic"))


@pytest.mark.parametrize(
    ("machine", "asked", "meant"),
    [
        ("gantry", "cascade", "gantry-cascade"),
        ("gantry-friction", "cascade", "gantry-friction-cascade"),
        ("gantry-friction", "gantry-cascade", "gantry-cascade"),
        pytest.param(
            "gantry-friction", "scheduled-lq", "gantry-scheduled-lq", marks=pytest.mark.slow
        ),
        ("flexible-axis", "cascade", "cascade"),
    ],
)
def test_a_short_name_means_the_controller_of_the_machine(machine, asked, meant):
    assert design_for(machine_named(machine), Simulate(controller=asked)).name == meant


def test_every_name_has_its_maker_and_every_maker_its_name():
    made = {name for entry in CONTROLLERS.values() for name in entry.designs()}
    assert made == set(CONTROLLERS)
    assert all(name in entry.designs() for name, entry in CONTROLLERS.items())
    assert {name for entry in CONTOURS.values() for name in entry.tasks()} == set(CONTOURS)
    assert all(name in entry.tasks() for name, entry in CONTOURS.items())


@pytest.mark.parametrize(
    ("controller", "machine"),
    [
        ("preview-lq", "bridgeport"),
        ("lqr", "flexible-axis"),
        ("task-frame", "flexible-axes"),
        ("gantry-cascade", "gantry"),
        ("gantry-friction-cascade", "gantry-friction"),
    ],
)
def test_the_first_machine_that_a_controller_suits(controller, machine):
    assert first_machine(controller) == machine


def test_controllers_of_a_machine_file(machine_file):
    assert controllers_for(machine_named(str(machine_file))) == controllers_for(
        machine_named("bridgeport")
    )


@pytest.mark.parametrize("controller", sorted(ALONG_CONTOURS))
def test_a_contour_needs_two_axes(controller):
    with pytest.raises(
        ValueError,
        match=f"{controller} needs two flexible axes or more, for a contour; "
        "flexible-axis takes cascade",
    ):
        design_for(machine_named("flexible-axis"), Simulate(controller=controller))


def test_a_machine_is_what_it_is_and_not_what_its_user_calls_it(tmp_path):
    """An axis named as if it were a gantry has an axis's controllers."""
    thesis = json.loads(THESIS_AXIS.read_text())
    path = tmp_path / "axis.json"
    path.write_text(json.dumps({**thesis, "name": "gantry-x"}))
    machine = machine_named(str(path))
    assert (
        machine.name == "gantry-x"
        and design_for(machine, Simulate(controller="cascade")).name == "cascade"
    )
    assert controllers_for(machine) == controllers_for(machine_named("flexible-axis"))


def test_a_fault_in_a_maker_is_shown(monkeypatch):
    """The controller stays in the list, and whoever asks for it is told."""

    def fail(name, line, machine, flags):
        raise ValueError("a fault of ours")

    failing = CONTROLLERS["cascade"]._replace(designs=lambda: {"cascade": fail})
    monkeypatch.setitem(CONTROLLERS, "cascade", failing)
    machine = machine_named("flexible-axis")
    assert "cascade" in controllers_for(machine)
    with pytest.raises(ValueError, match="a fault of ours"):
        design_for(machine, Simulate(controller="cascade"))


def path_job(flags):
    return job_named("circle", Pace.of(flags, machine_named(flags.plant)))


def test_the_whole_path_is_as_many_samples_as_the_run_has():
    flags = Simulate(preview=WholePath())
    job = path_job(flags)
    assert seeing_all(flags, job).preview == job.samples > 400
    assert seeing_all(Simulate(preview=7), job).preview == 7
    with pytest.raises(ValueError, match="preview: path is for the one run of simulate"):
        design_for(machine_named("bridgeport"), flags)


@pytest.mark.slow
@pytest.mark.parametrize("controller", ["contouring-lq-state", "contouring-lq-blocks"])
def test_a_longer_preview_than_the_whole_path_changes_nothing(controller):
    """The blocks are one backward sweep, against a window that every step has of its own."""
    machine, flags = machine_named("bridgeport"), Simulate(preview=WholePath())
    job = path_job(flags)

    def plan_of(asked):
        design = design_for(machine, asked)
        built = design.build(design.start)
        dt, preview = machine.model.dt, design.preview
        reference = along(job.contour, job.arc, dt, preview, job.at_rest, job.scored)
        return prepared(built, reference)

    found = plan_of(replace(seeing_all(flags, job), controller=controller))
    longer = replace(flags, preview=job.samples + 300, controller="contouring-lq-state")
    for one, other in zip(jax.tree.leaves(found), jax.tree.leaves(plan_of(longer)), strict=True):
        scale = float(np.abs(other).max())
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-12 * scale)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("controller", "given", "unread"),
    [
        ("cascade", {"alpha": 1e12, "preview": 20, "model_delay": 0}, "--preview, --alpha"),
        ("preview-lq", {"alpha": 1e12, "preview": 20, "terminal": "riccati"}, "--terminal"),
        ("contouring-lq", {"alpha": 1e12, "preview": 20, "terminal": "riccati"}, None),
    ],
)
def test_flags_that_a_controller_does_not_read_are_said(recwarn, controller, given, unread):
    design_for(machine_named("bridgeport"), Simulate(controller=controller, **given))
    told = [str(one.message) for one in recwarn]
    assert [one.partition(" does not read ")[2] for one in told] == ([unread] if unread else [])
