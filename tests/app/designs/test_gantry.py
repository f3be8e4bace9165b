"""Controllers of the gantry by name: what they build, how they follow, what is refused."""

import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.app.catalogue.choices import design_for, job_named
from jcontour.app.catalogue.entries import CONTROLLERS, design_class
from jcontour.app.designs.gantry import GANTRY
from jcontour.app.flags.loops import Simulate
from jcontour.app.jobs.job import Pace
from jcontour.app.machines.gantry import friction_gantry_machine, gantry_machine
from jcontour.simulation.closed_loop import simulate
from jcontour.simulation.metrics import score

NAMES = [name for name in CONTROLLERS if design_class(name).needs == GANTRY]


@pytest.fixture(scope="module")
def machine():
    return gantry_machine()


@pytest.mark.slow
def test_a_machines_own_controller_goes_first(machine):
    assert design_for(machine, Simulate(controller="cascade")).name == "gantry-cascade"
    assert (
        design_for(machine, Simulate(controller="gantry-scheduled-lq")).name
        == "gantry-scheduled-lq"
    )
    assert design_for(machine, Simulate()).name == "gantry-offset-free-lq"


@pytest.mark.slow
def test_both_drives_of_y_have_the_same_gains(machine):
    """Feedforward alone: the acceleration of each axis times its gain."""
    design = design_for(machine, Simulate(controller="cascade"))
    np.testing.assert_allclose(
        design.start["inertia"], [40.0 / 60, 165.4792603698147 / 120], rtol=1e-12
    )
    reference = job_named("ring-left", Pace(machine, None, None)).reference(machine.model.dt, 1)
    plan = design.build(
        {**design.start, "inertia": jnp.array([0.5, 0.8]), "viscous": jnp.zeros(2)}
    ).prepare(reference)
    acceleration = np.diff(np.asarray(reference.position), 2, axis=0) / machine.model.dt**2
    np.testing.assert_allclose(
        plan.control[1:], acceleration[:, [0, 1, 1]] * [0.5, 0.8, 0.8], rtol=0, atol=1e-8
    )


@pytest.mark.slow
def test_the_weight_on_the_difference_keeps_the_drives_together(machine):
    """Dear enough, it leaves nothing that twists the beam."""
    design = design_for(machine, Simulate(controller="contouring-lq"))
    reference = job_named("eight-right", Pace(machine, None, None)).reference(
        machine.model.dt, design.preview
    )
    plan = design.build({**design.start, "difference": 1e12}).prepare(reference)
    assert np.abs(plan.F[:, 1] - plan.F[:, 2]).max() < 1e-6 * np.abs(plan.F).max()


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
@pytest.mark.filterwarnings("ignore:.* does not read --preview")
def test_starts_follow_on_every_plant_of_the_true_family(machine, name):
    design = design_for(machine, Simulate(controller=name, preview=20))
    reference = job_named("cushion-right", Pace(machine, None, None)).reference(
        machine.model.dt, design.preview
    )
    for plant in machine.true_family():
        metrics = score(simulate(plant, design.build(design.start), reference), reference)
        assert not metrics.diverged and metrics.rms_contour_error < 2e-4


@pytest.mark.slow
def test_on_a_machine_with_friction_the_cascade_is_fed_it_and_the_rest_is_the_gantrys():
    rubbing = friction_gantry_machine()
    design = design_for(rubbing, Simulate(controller="cascade"))
    assert design.name == "gantry-friction-cascade"
    assert design_for(rubbing, Simulate(controller="contouring-lq")).name == "gantry-contouring-lq"
    assert design_for(rubbing, Simulate()).name == "gantry-offset-free-lq"
    np.testing.assert_allclose(design.start["coulomb"], [14.0 / 60, 22.0 / 60], rtol=1e-12)
    reference = job_named("ring-left", Pace(rubbing, None, None)).reference(rubbing.model.dt, 1)
    gains = ({**design.start, "coulomb": dry} for dry in (jnp.array([0.2, 0.3]), jnp.zeros(2)))
    fed, unfed = (design.build(each).prepare(reference).control for each in gains)
    signs = np.sign(np.diff(np.asarray(reference.position), axis=0))[: len(fed)]
    np.testing.assert_allclose(
        fed - unfed, signs[:, [0, 1, 1]] * [0.2, 0.3, 0.3], rtol=0, atol=1e-12
    )
