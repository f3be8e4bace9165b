"""What the catalogue says of its entries."""

import pytest

from experiments.catalogue import CONTROLLERS, MACHINES, controllers_for, design_for, machine_named
from experiments.options import Simulate

ALONG_CONTOURS = {name for name, entry in CONTROLLERS.items() if entry.on == "flexible-axes"}
TAKES_ALSO = {"flexible-axes": "flexible-axis", "gantry-friction": "gantry"}  # machine -> another whose controllers suit it


@pytest.mark.parametrize("name", MACHINES)
def test_an_unknown_controller_is_answered_with_those_of_the_machine(name):
    machine, kinds = machine_named(name), {name, TAKES_ALSO.get(name)}
    suited = [controller for controller, entry in CONTROLLERS.items() if entry.on in kinds]
    assert controllers_for(machine) == suited and machine.usual.controller in suited
    with pytest.raises(ValueError, match=f"none named 'magic'; give one of {', '.join(suited)}$"):
        design_for(machine, Simulate(controller="magic"))


def test_controllers_of_a_machine_file(machine_file):
    assert controllers_for(machine_named(str(machine_file))) == controllers_for(machine_named("bridgeport"))


@pytest.mark.parametrize("controller", sorted(ALONG_CONTOURS))
def test_a_contour_needs_two_axes(controller):
    with pytest.raises(ValueError, match=f"{controller} needs 2 axes, for a contour; .* has 1"):
        design_for(machine_named("flexible-axis"), Simulate(controller=controller))
