"""What the catalogue says of its entries."""

import pytest

from experiments.catalogue import CONTROLLERS, MACHINES, controllers_for, design_for, machine_named
from experiments.options import Simulate

FOR_SEVERAL_AXES = {name for name, entry in CONTROLLERS.items() if entry.on == "flexible-axes"}


@pytest.mark.parametrize("name", MACHINES)
def test_controllers_of_a_machine(name):
    """An unknown one is answered with them; every other one is refused, unless it is the contour of several axes that it lacks."""
    machine = machine_named(name)
    suited = controllers_for(machine)
    assert machine.usual.controller in suited
    with pytest.raises(ValueError, match=f"none named 'magic'; give one of {', '.join(suited)}$"):
        design_for(machine, Simulate(controller="magic"))
    for other in CONTROLLERS.keys() - set(suited):
        if f"{name}-{other}" in suited:  # called without the machine's name
            continue
        if other in FOR_SEVERAL_AXES and name == "flexible-axis":
            continue
        with pytest.raises(ValueError, match=f"{other} needs"):
            design_for(machine, Simulate(controller=other))


def test_controllers_of_a_machine_file(machine_file):
    assert controllers_for(machine_named(str(machine_file))) == controllers_for(machine_named("bridgeport"))
    assert FOR_SEVERAL_AXES.isdisjoint(controllers_for(machine_named("flexible-axis")))
    assert set(controllers_for(machine_named("flexible-axes"))) > FOR_SEVERAL_AXES
