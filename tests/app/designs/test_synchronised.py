"""Synchronised axes by name: their models, their pairs, how they follow, what is warned of."""

import numpy as np
import pytest

from jcontour.app.catalogue.choices import design_for
from jcontour.app.designs.gantry import MOTORS
from jcontour.app.designs.synchronised import axes_of, drives_of
from jcontour.app.flags.loops import Simulate
from jcontour.app.machines.flexible_axis import biaxial_machine
from jcontour.app.machines.gantry import gantry_machine

ASKED = Simulate(controller="synchronised")


@pytest.fixture(scope="module")
def axes():
    return biaxial_machine()


@pytest.fixture(scope="module")
def gantry():
    return gantry_machine()


@pytest.mark.slow
def test_axes_are_masses_with_viscous_friction(axes, gantry):
    first = axes_of(axes)
    np.testing.assert_allclose(first.gain, [79.33 / 40.0, 60.0 / 20.5], rtol=1e-12)
    np.testing.assert_allclose(first.pole, [250.9 / 40.0, 150.0 / 20.5], rtol=1e-12)
    p, drives = gantry.parameters, drives_of(gantry)
    both = float(p.drive_mass_1 + p.drive_mass_2 + p.beam_mass + p.head_mass)
    np.testing.assert_allclose(drives.gain[1:], float(p.drive_constant) / (both / 2), rtol=1e-12)
    np.testing.assert_allclose(drives.gain[0], float(p.head_constant / p.head_mass), rtol=1e-12)


@pytest.mark.slow
def test_a_gantry_has_its_y_drives_as_the_pair(axes, gantry):
    design = design_for(gantry, ASKED)
    assert design.name == "gantry-synchronised"
    controller = design.build(design.start)
    assert controller.controller.pair == (1, 2)
    np.testing.assert_array_equal(controller.kinematics, MOTORS)
    gains = controller.controller.gains.proportional
    assert gains[1] == gains[2] != gains[0]
    two = design_for(axes, ASKED)
    assert two.name == "synchronised" and two.build(two.start).pair == (0, 1)
    assert two.preview == design.preview == 2


@pytest.mark.slow
@pytest.mark.parametrize("name", ["axes", "gantry"])
def test_a_coupling_above_its_bound_is_warned_of(name, request):
    machine = request.getfixturevalue(name)
    with pytest.warns(UserWarning, match="coupling: beta is 1000"):
        design_for(machine, Simulate(controller="synchronised", weights=("coupling=1000",)))
