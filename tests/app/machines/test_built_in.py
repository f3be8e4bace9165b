"""The X-Y table as a machine of the catalogue."""

import numpy as np

from jcontour.app.machines.built_in import xy_table_machine
from jcontour.plants.xy_table import FrictionXYTable, xy_table


def test_a_controller_on_the_host_meets_friction():
    hosted = xy_table_machine().hosted()
    assert isinstance(hosted.plant, FrictionXYTable) and hosted.plant.dt == 1e-3
    assert hosted.every == 4 and hosted.model.dt == 4e-3
    np.testing.assert_array_equal(hosted.model.A, xy_table(4e-3).A)


def test_its_current_is_limited():
    machine = xy_table_machine()
    assert machine.limits.control.tolist() == [0.5, 0.5] and machine.control_unit == "A"
