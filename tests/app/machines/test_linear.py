"""The X-Y table as the commands see it."""

from dataclasses import replace

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.app.machines.from_file import linear_machine
from jcontour.linear.plant import LinearPlant
from jcontour.linear.transformations import with_input_delay
from jcontour.simulation.evaluation import member


def test_a_drive_that_takes_a_position_stands_still_where_its_part_begins():
    """Whatever its gain and delay; a gain that acts at rest too would bring a jump of a fifth."""
    model = with_input_delay(
        LinearPlant(np.diag([0.9, 0.8]), np.diag([0.1, 0.2]), np.eye(2), 1e-3), 1
    )
    machine = replace(linear_machine(model, "drives"), gain=0.2, delay=2)
    place = np.array([0.03, -0.05])
    drawn = machine.random_family(1, 0)
    plants = [machine.exact_family()[1], machine.exact_family()[-1], member(drawn, 0)]
    for plant in plants:
        state = plant.initial_state(place, np.zeros(2))
        for _ in range(3):
            state = plant.step(state, place)
        np.testing.assert_allclose(plant.output(state), place, rtol=1e-12)


def slides(known_delay: int, **more):
    """Two masses, 2 and 1 m/s^2 per control unit."""
    gains, dt = np.array([2.0, 1.0]), 1e-3
    A = np.kron(np.eye(2), [[1.0, dt], [0.0, 1.0]])
    B = np.kron(np.diag(gains), [[dt**2 / 2], [dt]])
    plant = LinearPlant(A, B, np.kron(np.eye(2), [[1.0, 0.0]]), dt)
    machine = linear_machine(with_input_delay(plant, known_delay), "slides")
    return replace(machine, known_delay=known_delay, gain=0.1, delay=1, **more)


@pytest.mark.slow
@pytest.mark.parametrize("known_delay", [0, 2])
def test_friction_stops_every_plant_of_the_family_and_no_linear_one(known_delay):
    """From 40 mm/s under no control, by v^2 / (2 gain force), whatever gain and delay."""
    rough, start = slides(known_delay, friction=0.2), np.array([4e-5, -4e-5])
    drawn = rough.random_family(2, 0)
    ways = np.array([1.0, -1.0]) * 0.04**2 / (2 * 0.2 * np.array([2.0, 1.0]))
    plants = [*rough.smooth_family()[1:3], *rough.true_family()[2:], member(drawn, 0)]
    for plant in plants:
        np.testing.assert_allclose(coasted(plant, start), ways, rtol=0.05)
    for plant in (rough.exact_family()[-1], rough.nominal(), rough.frictionless.true_family()[1]):
        np.testing.assert_allclose(coasted(plant, start), 500 * start, rtol=1e-9)


def coasted(plant, increment):
    state = plant.initial_state(jnp.zeros(2), jnp.asarray(increment))
    step = eqx.filter_jit(lambda plant, state: plant.step(state, jnp.zeros(2)))
    for _ in range(500):
        state = step(plant, state)
    return np.asarray(plant.output(state))


def test_encoders_of_different_counts_are_those_of_two_machines_of_equal_ones():
    """Axis by axis: what is measured, the noise in its place, and what a filter takes for it."""
    place, still = np.array([1.23e-5, 1.23e-5]), np.zeros(2)
    counts = np.array([1e-6, 5e-6])

    def seen(resolution):
        machine = slides(0, encoder_resolution=resolution)
        drawn = member(machine.random_family(1, 0), 0)
        plants = [*machine.true_family(), *machine.smooth_family(), drawn]
        read = [np.asarray(plant.measure(plant.initial_state(place, still))) for plant in plants]
        return np.array([*read, np.broadcast_to(machine.measurement_noise, 2)])

    mixed = seen(counts)
    for axis, count in enumerate(counts):
        np.testing.assert_array_equal(mixed[:, axis], seen(count)[:, axis])
    np.testing.assert_allclose(mixed[0], [1.2e-5, 1.0e-5])


def test_noise_of_encoders_comes_before_their_counts():
    """As much as is stated, in every plant that counts; a smooth one has as much in all."""
    noise, samples = np.array([3e-7, 0.0]), 4000
    machine = slides(0, encoder_resolution=1e-7, encoder_noise=noise)
    place, still = jnp.array([1.2e-5, 1.2e-5]), jnp.zeros(2)

    def read(plant):
        """At a standstill, sample by sample."""
        state, found = plant.initial_state(place, still), []
        for _ in range(samples // 20):
            found.append(plant.measure(state))
            state = plant.step(state, still)
        return np.array(found) - np.asarray(place)

    counted = read(machine.true_family()[0])
    assert counted.std(axis=0) == pytest.approx([np.sqrt(3e-7**2 + 1e-14 / 12), 0.0], rel=0.15)
    assert np.allclose(counted / 1e-7, np.round(counted / 1e-7), atol=1e-6)
    smooth = read(machine.smooth_family()[0]).std(axis=0)
    assert smooth == pytest.approx(machine.measurement_noise, rel=0.15)
    assert machine.measurement_noise**2 == pytest.approx(noise**2 + 1e-14 / 12)
    assert "noise 0.3, 0 um" in machine.description()["Measured"]
