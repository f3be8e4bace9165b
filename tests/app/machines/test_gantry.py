"""The gantry as a machine: its family, what it measures, and the contours along its beam."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jcontour._arrays import placed
from jcontour.analysis.stability import margins
from jcontour.app.catalogue.choices import design_for, job_named
from jcontour.app.catalogue.entries import CONTOURS
from jcontour.app.flags.loops import Simulate
from jcontour.app.jobs.job import Pace
from jcontour.app.machines.gantry import (
    CURRENT,
    ENCODER_RESOLUTION,
    friction_gantry_machine,
    gantry_machine,
)
from jcontour.geometry.contours import line
from jcontour.motion.references import along
from jcontour.plants.gantry.friction_gantry import SmoothFrictionGantry, StickSlipGantry
from jcontour.plants.gantry.gantry import Gantry
from jcontour.plants.gantry.mujoco_engine import GantryMuJoCo
from jcontour.simulation.closed_loop import simulate
from jcontour.simulation.evaluation import stack_plants


@pytest.fixture(scope="module")
def machine():
    return gantry_machine()


def inner(plant):
    """The gantry inside its encoders, row, delay and limits."""
    while not isinstance(plant, Gantry | GantryMuJoCo | SmoothFrictionGantry | StickSlipGantry):
        plant = plant.plant
    return plant


def test_family_is_off_by_a_fifth_and_a_tenth_and_late(machine):
    nominal, smooth, true = machine.parameters, machine.smooth_family(), machine.true_family()
    assert (
        len(smooth) == len(true) == len(machine.family_names) == 7
        and machine.family_names[0] == "nominal"
    )
    for family in (smooth, true):
        ratios = [
            (
                float(p.joint_stiffness / nominal.joint_stiffness),
                float(p.total_mass / nominal.total_mass),
                float(p.head_mass / 40.0),
            )
            for p in (inner(plant).parameters for plant in family)
        ]
        wanted = [
            (1, 1, 1),
            (1.2, 1.1, 1.1),
            (1.2, 0.9, 0.9),
            (0.8, 1.1, 1.1),
            (0.8, 0.9, 0.9),
            (1, 1, 1),
            (1, 0.9, 0.9),
        ]
        np.testing.assert_allclose(ratios, wanted, rtol=1e-12)
        stack_plants(family)
    assert [int(plant.plant.plant.plant.samples) for plant in true] == [0, 0, 0, 0, 0, 1, 1]
    with pytest.raises(ValueError, match="measures its motors"):
        machine.true_family("state")


def test_motors_are_measured_and_currents_limited(machine):
    """Y axes are homed where the tool is at zero; each motor gets at most ten amperes."""
    position, increment = jnp.array([0.3, -0.02]), jnp.array([1e-4, 2e-4])
    for plant in (machine.true_family()[0], machine.nominal()):
        start = plant.initial_state(position, increment)
        np.testing.assert_allclose(
            plant.measure(start), [0.3, -0.02, -0.02, 0.1, 0.2, 0.2], rtol=0, atol=1e-12
        )
        np.testing.assert_allclose(plant.output(start), position, rtol=0, atol=1e-12)
    plant = machine.smooth_family()[0]
    start = plant.initial_state(position, increment)
    asked, given = (
        plant.step(start, jnp.array(current))
        for current in ([1e3, -1e3, 2.0], [CURRENT, -CURRENT, 2.0])
    )
    np.testing.assert_array_equal(plant.output(asked), plant.output(given))
    np.testing.assert_array_equal(machine.limits.control, [CURRENT] * 3)


@pytest.mark.slow
def test_the_nominal_machine_shows_where_its_currents_are_saturated(machine):
    """After a jump of the reference by 5 mm, the currents are beyond their limits for a while.

    The loop is open at every sample whose current is beyond the limit, and at no other.
    """
    plant, design = (
        machine.nominal(),
        design_for(machine, Simulate(controller="contouring-lq", preview=5)),
    )
    arc = np.concatenate([np.zeros(2), np.full(60, 5e-3)])
    jump = along(line([0.0, 0.0], [0.1, 0.0]), arc, machine.model.dt, design.preview, at_rest=True)
    law = design.build(design.start)
    beyond = (np.abs(np.asarray(simulate(plant, law, jump).control)) > CURRENT).any(axis=1)
    at_jump = margins(plant, law, jump)
    assert at_jump.saturated == beyond.sum() and 10 < beyond.sum() < beyond.size - 10
    assert at_jump.spectral_radius < 1 <= at_jump.delay


def test_smooth_encoders_have_the_noise_of_counts(machine):
    """Variance is that of rounding, a twelfth of a count squared; speeds are differences."""
    plant, rows = machine.smooth_family()[0], 400
    start = plant.initial_state(jnp.array([0.3, -0.02]), jnp.zeros(2))
    _, read = jax.lax.scan(
        lambda state, _: (plant.step(state, jnp.zeros(3)), plant.measure(state)), start, length=rows
    )
    positions, speeds = np.split(np.asarray(read) - [0.3, -0.02, -0.02, 0, 0, 0], 2, axis=1)
    assert np.abs(positions).max() <= ENCODER_RESOLUTION / 2
    np.testing.assert_allclose(positions.var(axis=0), ENCODER_RESOLUTION**2 / 12, rtol=0.2)
    np.testing.assert_allclose(
        speeds[1:], np.diff(positions, axis=0) / plant.dt, rtol=0, atol=1e-12
    )


def test_contours_lie_along_the_beam(machine):
    """Where their names say, all of them on it, at the gantry's own pace or the user's."""
    names = {*machine.usual.training, *machine.usual.held_out}
    assert names == {name for name, entry in CONTOURS.items() if "gantry's beam" in entry.line}
    assert not set(machine.usual.training) & set(machine.usual.held_out)
    for name in names:
        reference = job_named(name, Pace(machine, None, None)).reference(machine.model.dt, 1)
        x, y = np.asarray(reference.position).T
        assert np.abs(x).max() < 0.9 and np.abs(y).max() <= 0.08
        side = {"left": -1, "centre": 0, "right": 1}[name.rsplit("-", 1)[1]]
        assert np.sign(np.round(np.median(x), 1)) == side
        np.testing.assert_allclose(
            np.linalg.norm(np.diff(reference.position, axis=0), axis=1), 3e-4, rtol=1e-3
        )
    slow = job_named("ring-left", Pace(machine, 0.1, None)).reference(machine.model.dt, 1)
    np.testing.assert_allclose(
        np.linalg.norm(np.diff(slow.position, axis=0), axis=1), 1e-4, rtol=1e-3
    )


def test_models_cover_the_beam(machine):
    np.testing.assert_allclose(np.asarray(machine.schedule.points)[[0, -1]], [-0.9, 0.9])
    np.testing.assert_allclose(machine.schedule.model(4).A, machine.model.A, rtol=0, atol=1e-12)


def test_machine_says_what_it_is(machine):
    assert (
        "20, 20, 85.48, 40 kg" in machine.description()["Machine"]
        and "neither tool nor twist" in machine.description()["Measured"]
    )
    assert machine.error == "contour"


def test_with_friction_the_true_family_sticks_and_nobody_else_confirms_it(machine):
    """The same machine otherwise, member by member, and what its motors measure."""
    rubbing = friction_gantry_machine()
    assert (machine.nonsmooth_effects, rubbing.nonsmooth_effects) == (
        "encoder counts",
        "stick, slip and encoder counts",
    )
    assert rubbing.name == "gantry-friction" and rubbing.family_names == machine.family_names
    assert (
        "14, 20, 24 N to break loose" in rubbing.description()["Friction"]
        and "Friction" not in machine.description()
    )
    position, increment = placed(np.array([0.3, -0.02])), placed(np.array([1e-4, 2e-4]))
    for family, kind in (
        (rubbing.smooth_family(), SmoothFrictionGantry),
        (rubbing.true_family(), StickSlipGantry),
    ):
        stack_plants(family)
        for plant, plain in zip(family, machine.smooth_family(), strict=True):
            assert isinstance(inner(plant), kind)
            assert (
                inner(plant).parameters.joint_stiffness == inner(plain).parameters.joint_stiffness
            )
            np.testing.assert_array_equal(inner(plant).friction.coulomb, [10.0, 14.0, 18.0])
        start = family[0].initial_state(position, increment)
        read = [0.3, -0.02, -0.02, 0.1, 0.2, 0.2]
        np.testing.assert_allclose(
            family[0].measure(start), read, rtol=0, atol=0.51 * ENCODER_RESOLUTION
        )


def test_random_members_lie_within_the_intervals(machine):
    family = machine.random_family(100, 2)
    late, parameters = family.plant.plant.plant, inner(family).parameters
    thesis = machine.parameters
    for name, share in (("joint_stiffness", 0.2), ("head_mass", 0.1), ("beam_mass", 0.1)):
        ratio = np.asarray(getattr(parameters, name)) / np.asarray(getattr(thesis, name))
        assert 1 - share <= ratio.min() < ratio.max() <= 1 + share and np.ptp(ratio) > 1.6 * share
    samples = np.asarray(late.samples)
    assert 0 <= samples.min() < samples.max() <= 1 and np.any((samples > 0.2) & (samples < 0.8))
