"""Machines as laps see them: what is read, linear models, noise, and a machine that has none."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.app.catalogue.choices import design_for, job_named
from jcontour.app.flags.loops import Simulate
from jcontour.app.jobs.job import Pace
from jcontour.app.machines.families import Member
from jcontour.app.machines.flexible_axis import biaxial_machine, thesis_machine
from jcontour.app.machines.gantry import gantry_machine
from jcontour.app.machines.linear import bridgeport_machine
from jcontour.app.machines.own_plant import machine_of
from jcontour.app.runs.loops.learned_machines import (
    Setting,
    linear_nominal,
    noisy,
    read_anew,
    setting,
)
from jcontour.controllers.feedback.cascade import Cascade, CascadeGains
from jcontour.geometry.contours import circle, line
from jcontour.motion.references import along, in_time
from jcontour.plants.flexible_axis.axis import SmoothFlexibleAxis, thesis_axis
from jcontour.plants.gantry.motor_coordinates import MotorEncoders
from jcontour.sensors import motors
from jcontour.simulation.closed_loop import simulate

DT = 1e-3


@pytest.fixture(scope="module")
def axis():
    """The thesis's axis under its cascade, a short move."""
    reference = in_time(
        line([0.0], [0.05]), lambda t: 0.05 * np.clip(t / 0.1, 0, 1), 0.15, DT, 1, dwell=0.05
    )
    cascade = Cascade(CascadeGains(30.0, 55.67, 0.04), motors(1), DT)
    return Setting(thesis_machine(), cascade, "outputs", reference)


@pytest.fixture(scope="module")
def gantry():
    """The gantry's cascade on a circle of 10 mm left of the beam's centre."""
    machine = gantry_machine()
    design = design_for(machine, Simulate(controller="cascade"))
    path = circle(10e-3, centre=(-0.4, 0.0))
    reference = along(path, 2e-5 * np.arange(60), DT, design.preview, at_rest=True)
    return Setting(machine, design.build(design.start), design.fed, reference)


def test_linear_members_are_named_like_the_family(axis):
    assert len(axis.machine.linear_family("outputs", axis.path)) == len(axis.machine.family_names)
    for machine in (biaxial_machine(), bridgeport_machine(), gantry_machine()):
        one = Setting(machine, axis.controller, "outputs", axis.reference)
        assert len(machine.linear_family("outputs", one.path)) == len(machine.family_names)
    assert Member("nominal", 1.0, 1.0, 0) == axis.machine.members[0]


def test_noise_is_within_half_a_count_and_another_in_every_lap(axis):
    half = axis.machine.encoder_resolution / 2
    first, again, second = (
        np.asarray(noisy(axis, 0)(np.asarray(k)).plant.noise) for k in (0, 0, 1)
    )
    np.testing.assert_array_equal(first, again)
    assert np.abs(first).max() <= half and not np.array_equal(first, second)
    assert not np.any(first[:, 1:])


def test_positions_are_found_in_what_is_measured():
    state = np.arange(8.0)
    table = bridgeport_machine()
    np.testing.assert_array_equal(table.positions("outputs")(state[:2]), [0.0, 1.0])
    np.testing.assert_array_equal(table.positions("state")(state), table.model.output(state))
    axes = biaxial_machine().positions("outputs")
    np.testing.assert_array_equal(axes((state[:2], state[2:4])), [0.0, 1.0])


def test_a_gantry_reads_its_tool_from_its_motors():
    """Head 0.3 m along a beam that is turned by a hundredth."""
    parameters = gantry_machine().parameters
    state = jnp.array([0.3, 0.25, 0.01, 0.1, 0.2, 0.3])
    found = gantry_machine().positions("outputs")(MotorEncoders(parameters)(state))
    d, sine, cosine = float(parameters.tool_offset), np.sin(0.01), np.cos(0.01)
    wanted = [0.3 * cosine + d * sine, 0.25 + 0.3 * sine - d * cosine]
    np.testing.assert_allclose(found, wanted, rtol=1e-12)


def test_the_linear_gantry_is_the_gantry_on_a_small_part(gantry):
    """They differ by the head's way along the beam and by squares of the twist."""
    runs = [
        jax.jit(simulate)(plant, gantry.controller, gantry.reference)
        for plant in (linear_nominal(gantry), gantry.machine.nominal())
    ]
    moved = np.ptp(np.asarray(runs[1].output), axis=0).max()
    assert moved > 5e-4
    np.testing.assert_allclose(runs[0].output, runs[1].output, atol=2e-4 * moved)
    np.testing.assert_allclose(
        runs[0].control, runs[1].control, atol=2e-2 * float(np.abs(runs[1].control).max())
    )


def test_noise_of_a_gantry_is_on_its_motors_positions_alone(gantry):
    noise = np.asarray(noisy(gantry, 0)(jnp.asarray(0)).plant.plant.noise)
    assert noise.shape == (gantry.shape[0], 6)
    assert 0 < np.abs(noise[:, :3]).max() <= gantry.machine.resolution / 2
    assert not np.any(noise[:, 3:])


def test_a_machine_without_linear_models_is_refused(axis):
    own = machine_of(SmoothFlexibleAxis(thesis_axis(), DT), "mine")
    design = replace(design_for(thesis_machine(), Simulate()), machine=own)
    job = job_named("task-a", Pace(thesis_machine(), None, None))
    with pytest.raises(ValueError, match="flexible axes or a gantry, mine is none of them"):
        setting(design, job)


def test_noise_of_every_axis_is_within_half_a_count_of_its_own():
    machine = replace(bridgeport_machine(), encoder_resolution=np.array([1e-6, 5e-6]))
    design = design_for(machine, Simulate(preview=3))
    path = line(np.zeros(2), np.ones(2))
    reference = along(path, np.zeros(200), machine.model.dt, design.preview, at_rest=True)
    one = Setting(machine, design.build(design.start), "outputs", reference)
    largest = np.abs(np.asarray(noisy(one, 0)(jnp.asarray(0)).noise)).max(axis=0)
    halves = np.array([0.5e-6, 2.5e-6])
    assert np.all(largest <= halves) and np.all(largest > 0.9 * halves)


def table_with_noise(noise):
    """A table whose encoders have noise beside their counts, along a line at rest."""
    machine = replace(bridgeport_machine(), encoder_noise=noise)
    design = design_for(machine, Simulate(preview=3))
    path = line(np.zeros(2), np.ones(2))
    reference = along(path, np.zeros(9000), machine.model.dt, design.preview, at_rest=True)
    return Setting(machine, design.build(design.start), "outputs", reference)


def test_a_plant_of_the_family_has_other_noise_in_every_lap_alike_on_all_plants():
    """Gaussian within three deviations, of every axis its own, in all samples of the lap."""
    one = table_with_noise(np.array([3e-6, 1e-6]))
    nominal, other = one.machine.true_family("outputs")[:2]
    anew = read_anew(one, 4)
    first, again, second = (np.asarray(anew(nominal, k).plant.noise) for k in (0, 0, 1))
    assert first.shape == (9000, 2)
    np.testing.assert_array_equal(first, again)
    np.testing.assert_array_equal(first, anew(other, 0).plant.noise)
    np.testing.assert_allclose(first.std(axis=0), [2.96e-6, 0.986e-6], rtol=0.03)
    assert np.all(np.abs(first) <= np.array([9e-6, 3e-6]))
    assert np.all(np.abs(np.mean(first * second, axis=0)) < 0.05 * first.var(axis=0))
    assert not np.array_equal(first, read_anew(one, 5)(nominal, 0).plant.noise)


def test_encoders_that_only_count_are_the_same_in_every_lap():
    plant = bridgeport_machine().true_family("outputs")[0]
    assert read_anew(table_with_noise(0.0), 0)(plant, 3) is plant
