"""What every built-in machine says of itself."""

import numpy as np
import pytest

from jcontour._arrays import placed
from jcontour.app.catalogue.entries import MACHINES
from jcontour.sensors import row


@pytest.mark.parametrize("name", MACHINES)
def test_units_of_the_sensors_tell_positions_from_speeds(name):
    machine = MACHINES[name]()
    plant, still = machine.nominal(), np.zeros(len(machine.axes))
    here, there = (
        np.asarray(row(plant.measure(plant.initial_state(placed(still + place), placed(still)))))
        for place in (0.0, 1e-3)
    )
    assert here.size == len(machine.sensed)
    assert set(machine.sensed) <= {"m", "m/s"}
    moved = [1e-3 if unit == "m" else 0.0 for unit in machine.sensed]
    np.testing.assert_allclose(there - here, moved, atol=1e-9)
