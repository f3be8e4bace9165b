"""Which controllers suit a machine, and which of them a name means."""

import json
from pathlib import Path

import pytest

from experiments.catalogue.choices import controllers_for, design_for, machine_named
from experiments.catalogue.controllers import CONTROLLERS
from experiments.catalogue.machines import MACHINES
from experiments.options import Simulate

THESIS_AXIS = Path(__file__).parents[3] / "experiments" / "machines" / "thesis-axis.json"
ALONG_CONTOURS = {name for name, entry in CONTROLLERS.items() if entry.on == "flexible-axes"}
TAKES_ALSO = {
    "xy-table": "bridgeport",
    "flexible-axes": "flexible-axis",
    "gantry-friction": "gantry",
}  # machine -> another whose controllers suit it


@pytest.mark.parametrize("name", MACHINES)
def test_an_unknown_controller_is_answered_with_those_of_the_machine(name):
    machine, kinds = machine_named(name), {name, TAKES_ALSO.get(name)}
    suited = [controller for controller, entry in CONTROLLERS.items() if entry.on in kinds]
    assert controllers_for(machine) == suited and machine.usual.controller in suited
    with pytest.raises(ValueError, match=f"none named 'magic'; give one of {', '.join(suited)}$"):
        design_for(machine, Simulate(controller="magic"))


def test_controllers_of_a_machine_file(machine_file):
    assert controllers_for(machine_named(str(machine_file))) == controllers_for(
        machine_named("bridgeport")
    )


@pytest.mark.parametrize("controller", sorted(ALONG_CONTOURS))
def test_a_contour_needs_two_axes(controller):
    with pytest.raises(
        ValueError,
        match=f"{controller} needs two flexible axes or more, for a contour; flexible-axis takes cascade",
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

    def fail(name, machine, flags):
        raise ValueError("a fault of ours")

    monkeypatch.setitem(CONTROLLERS, "cascade", CONTROLLERS["cascade"]._replace(make=fail))
    machine = machine_named("flexible-axis")
    assert "cascade" in controllers_for(machine)
    with pytest.raises(ValueError, match="a fault of ours"):
        design_for(machine, Simulate(controller="cascade"))
