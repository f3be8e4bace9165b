"""Which controllers suit a machine, and which of them a name means."""

import json
from dataclasses import replace
from pathlib import Path

import jax
import numpy as np
import pytest

from jcontour.app.catalogue import entries
from jcontour.app.catalogue.choices import (
    controllers_for,
    design_for,
    job_named,
    machine_named,
    seeing_all,
)
from jcontour.app.catalogue.entries import (
    CONTOURS,
    CONTROLLERS,
    MACHINES,
    design_class,
    line_of,
)
from jcontour.app.designs.design import Needs
from jcontour.app.designs.flexible_axis import AxisCascade
from jcontour.app.flags.loops import Simulate
from jcontour.app.jobs.pace import Pace
from jcontour.app.machines.linear import LinearMachine
from jcontour.app.plain_numbers import WholePath
from jcontour.motion.references import along, from_samples
from jcontour.plants import Encoders
from jcontour.simulation.closed_loop import prepared, simulate
from tests.plants import first_machine
from tests.small_loops import OnPositions
from tuning.parameters import Weight

THESIS_AXIS = Path(__file__).parents[3] / "jcontour" / "app" / "machines" / "thesis-axis.json"
NEEDS = {name: design_class(name).needs.words for name in CONTROLLERS}
LINEAR = "a machine given by A, B, C"
LIMITED = f"{LINEAR} that states limits"
AXES, AXIS = "two flexible axes or more, for a contour", "a flexible axis"
ANY = f"{LINEAR}, flexible axes or a gantry"
GOVERNED = f"limits of the controls: {ANY}"
SUITED = {  # machine -> the kinds that it is of
    "bridgeport": [LINEAR, LIMITED, GOVERNED],
    "xy-table": [LINEAR, LIMITED, GOVERNED],
    "emps": [LINEAR, LIMITED, GOVERNED],
    "flexible-axis": [AXIS],
    "flexible-axes": [AXIS, AXES],
    "gantry": ["a gantry", "a gantry without dry friction", GOVERNED],
    "gantry-friction": ["a gantry", "a gantry with dry friction", GOVERNED],
}


@pytest.mark.parametrize(
    "name",
    [pytest.param(n, marks=[pytest.mark.slow] * (n == "gantry")) for n in MACHINES],
)
def test_an_unknown_controller_is_answered_with_those_of_the_machine(name):
    machine = machine_named(name)
    suited = [one for one, needs in NEEDS.items() if needs in [*SUITED[name], ANY]]
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


def test_every_name_has_its_class_and_every_class_its_line():
    assert all(design_class(name).__doc__.startswith(line_of(name)) for name in CONTROLLERS)
    assert len(set(CONTROLLERS.values())) == len(CONTROLLERS)


def test_every_name_of_a_contour_has_its_maker():
    made = {name for entry in CONTOURS.values() for name in entry.load()}
    assert made == set(CONTOURS) and all(name in CONTOURS[name].load() for name in CONTOURS)


def test_a_plain_controller_may_be_in_the_list(monkeypatch):
    loaded = entries.loaded
    monkeypatch.setitem(CONTROLLERS, "seen", ":Seen")
    monkeypatch.setattr(
        entries, "loaded", lambda place: Seen if place == ":Seen" else loaded(place)
    )
    machine = machine_named("bridgeport")
    assert "seen" in controllers_for(machine) and "seen" not in controllers_for(
        machine_named("gantry")
    )
    found = design_for(machine, Simulate(controller="seen", preview=4, weights=("gain=3",)))
    assert found.units() == {"gain": "A/m"} and found.preview == 4
    assert found.build(found.start).gain == 3 and found.line == "Proportional loop of two axes"


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

    def fail(self):
        raise ValueError("a fault of ours")

    monkeypatch.setattr(AxisCascade, "starts", fail)
    machine = machine_named("flexible-axis")
    assert "cascade" in controllers_for(machine)
    with pytest.raises(ValueError, match="a fault of ours"):
        design_for(machine, Simulate(controller="cascade"))


class Seen(OnPositions):
    """Proportional loop of two axes.

    A controller that describes itself, without a design.
    """

    gain: float
    weights = (Weight("gain", "A/m"),)
    needs = Needs("a linear machine of two axes", "linear")

    @classmethod
    def for_model(cls, model, preview):
        return cls(1.0, preview=preview)

    def step(self, memory, plan, measurement):
        return memory, self.gain * (plan - measurement)


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


@pytest.mark.parametrize("controller", ["linear-cascade-feedforward", "contouring-lq"])
def test_known_friction_is_fed_forward(tmp_path, machine_fields, controller):
    """The machine then runs nearly as one without friction."""
    (tmp_path / "rough.json").write_text(json.dumps(machine_fields | {"friction": 3.0}))
    machine, flags = machine_named(str(tmp_path / "rough.json")), Simulate(controller=controller)
    assert isinstance(machine, LinearMachine)
    design, job = design_for(machine, flags), job_named("circle", Pace.of(flags, machine))
    reference = job.reference(machine.model.dt, design.preview)

    def places(plant, build):
        return np.asarray(simulate(Encoders(plant), build(design.start), reference).output)

    smooth = places(machine.model, design.build)
    fed = np.abs(places(machine.mechanics, design.complete) - smooth)
    unfed = np.abs(places(machine.mechanics, design.build) - smooth)
    assert fed.mean() < 0.35 * unfed.mean()
    assert "in the direction 0 samples ahead" in design.lines(design.start)[-1]


def test_a_reversed_friction_leaves_a_mode_calm(tmp_path, machine_fields):
    """A ramp of its period: what rings behind a jump cancels."""
    radius, turn = 0.998, 2 * np.pi / 20  # 25 Hz at 2 ms
    gain = (1 - 2 * radius * np.cos(turn) + radius**2) / 2
    A = np.kron(np.eye(2), [[2 * radius * np.cos(turn), 1.0], [-(radius**2), 0.0]])
    B, C = np.kron(np.eye(2), [[gain], [gain]]), np.kron(np.eye(2), [[1.0, 0.0]])
    matrices = {"A": A.tolist(), "B": B.tolist(), "C": C.tolist(), "friction": 0.01}
    (tmp_path / "soft.json").write_text(json.dumps(machine_fields | matrices))
    machine = machine_named(str(tmp_path / "soft.json"))
    design = design_for(machine, Simulate(controller="linear-cascade-feedforward"))
    there = np.concatenate([np.arange(60), np.arange(60)[::-1]]) * 1e-4
    path, along_x = np.stack([there, 0 * there], 1), np.tile([1.0, 0.0], (120, 1))
    reference = from_samples(path, along_x, 2e-3, design.preview)
    controls = design.complete(design.start).against(reference)[:, 0]

    def rings(controls):
        x, places = np.linalg.solve(np.eye(4) - A, 0.01 * B[:, 0]), []
        for control in [*controls, *np.full(40, controls[-1])]:
            x = A @ x + B[:, 0] * control
            places.append(x[0])
        return np.ptp(places[-40:])

    jump = 0.01 * np.where(np.arange(len(controls)) < 60, 1.0, -1.0)
    assert rings(controls) < 0.1 * rings(jump)


def test_a_machine_that_is_sampled_faster_is_looked_ahead_as_long(tmp_path, machine_fields):
    """5 ms where that is more than 10 samples; a number that is given stays."""
    (tmp_path / "fast.json").write_text(json.dumps(machine_fields | {"dt": 0.25e-3}))
    fast, slow = machine_named(str(tmp_path / "fast.json")), machine_named("xy-table")
    previews = [
        design_for(machine, Simulate(controller="contouring-lq", preview=given)).preview
        for machine, given in ((fast, None), (fast, 10), (slow, None))
    ]
    assert previews == [20, 10, 10]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("controller", "given", "unread"),
    [
        ("cascade", {"preview": 20, "model_delay": 0}, "--preview, --model-delay"),
        ("preview-lq", {"alpha": 1e12, "preview": 20, "terminal": "riccati"}, "--terminal"),
        ("contouring-lq", {"alpha": 1e12, "preview": 20, "terminal": "riccati"}, None),
    ],
)
def test_flags_that_a_controller_does_not_read_are_said(recwarn, controller, given, unread):
    design_for(machine_named("bridgeport"), Simulate(controller=controller, **given))
    told = [str(one.message) for one in recwarn]
    assert [one.partition(" does not read ")[2] for one in told] == ([unread] if unread else [])


def test_a_weight_that_a_controller_lacks_is_refused_with_those_that_it_has():
    for given in ({"alpha": 1e12}, {"weights": ("alpha=1e12",)}):
        with pytest.raises(ValueError, match="no weight 'alpha'; known are position, velocity"):
            design_for(machine_named("flexible-axis"), Simulate(controller="cascade", **given))
