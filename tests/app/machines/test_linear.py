"""The X-Y table as the commands see it."""

from dataclasses import replace

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.linalg import block_diag

from jcontour.analysis.uncertain_loops import ResponseUncertainty
from jcontour.app.catalogue.choices import machine_named
from jcontour.app.commands.loops.check_bound import bounds_of, box_of, promised
from jcontour.app.machines.from_file import linear_machine
from jcontour.app.machines.linear import xy_table_machine
from jcontour.app.machines.uncertainty import GainMember, Uncertainty
from jcontour.linear.plant import LinearPlant
from jcontour.linear.transformations import with_input_delay
from jcontour.plants.xy_table import FrictionXYTable, xy_table
from jcontour.simulation.evaluation import member


@pytest.mark.parametrize("known", [0.1, 0.4])
def test_the_force_that_is_proven_for_is_no_less_than_the_friction_of_any_member(known):
    """Way lost to friction in 20 ms from 40 mm/s, over that lost to the force at the control."""
    rough = replace(slides(0, friction=0.2), friction_known_to=known)
    force = bounds_of(rough, None, None).force

    def way(machine, gain, control):
        plant = machine.member(GainMember("", np.full(2, gain), 0.0))
        state = plant.initial_state(jnp.zeros(2), jnp.full(2, 4e-5))
        for _ in range(20):
            state = plant.step(state, jnp.full(2, control))
        return np.asarray(plant.output(state))

    shares = []
    for gain in (0.9, 1.0, 1.1):
        free, rubbed = way(rough.frictionless, gain, 0.0), way(rough, gain, 0.0)
        shares.append((free - rubbed) / (free - way(rough.frictionless, gain, -force)))
    np.testing.assert_allclose(shares[0], 1.0, rtol=1e-6)
    assert np.all(np.array(shares[1:]) < 0.91)


def test_a_drive_that_takes_a_position_stands_still_where_its_part_begins():
    """Whatever its gain and delay; a gain that acts at rest too would bring a jump of a fifth."""
    model = with_input_delay(
        LinearPlant(np.diag([0.9, 0.8]), np.diag([0.1, 0.2]), np.eye(2), 1e-3), 1
    )
    machine = replace(linear_machine(model, "drives"), uncertainty=Uncertainty(0.2, 2))
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
    return replace(machine, known_delay=known_delay, uncertainty=Uncertainty(0.1, 1), **more)


@pytest.mark.slow
@pytest.mark.parametrize("known_delay", [0, 2])
def test_friction_stops_every_plant_of_the_family_and_no_linear_one(known_delay):
    """From 40 mm/s under no control, by v^2 / (2 gain force); the force varies by a tenth."""
    rough, start = slides(known_delay, friction=0.2), np.array([4e-5, -4e-5])
    drawn = rough.random_family(2, 0)
    ways = np.array([1.0, -1.0]) * 0.04**2 / (2 * 0.2 * np.array([2.0, 1.0]))
    plants = [*rough.smooth_family()[1:3], *rough.true_family()[2:], member(drawn, 0)]
    np.testing.assert_allclose(coasted(rough.true_family()[0], start), ways, rtol=0.05)
    shares = np.array([coasted(plant, start) for plant in plants]) / ways
    assert np.all((0.95 / 1.1 < shares) & (shares < 1.05 / 0.9)), shares
    free = replace(rough, stribeck=(0.2, 1e-3)).frictionless
    assert free.mechanics is rough.model
    for plant in (rough.exact_family()[-1], rough.nominal(), free.true_family()[1]):
        np.testing.assert_allclose(coasted(plant, start), 500 * start, rtol=1e-9)


def test_friction_of_an_axis_whose_control_waits_waits_with_it():
    """The second axis moves as without its delay, two samples later."""
    rough = slides(0, friction=0.2)
    mass = LinearPlant([[1.0, 1e-3], [0.0, 1.0]], [[5e-7], [1e-3]], [[1.0, 0.0]], 1e-3)
    late = with_input_delay(mass, 2)
    first = [[1.0, 1e-3], [0.0, 1.0]], [[1e-6], [2e-3]], [[1.0, 0.0]]
    joined = LinearPlant(*map(block_diag, first, (late.A, late.B, late.C)), 1e-3)
    waits = replace(linear_machine(joined, "one waits"), friction=0.2)
    pushes = 0.5 * np.sin(np.arange(300)[:, None] / [30.0, 40.0])
    at_once, later = (np.array([*moved(one.mechanics, pushes)]) for one in (rough, waits))
    np.testing.assert_allclose(later[:, 0], at_once[:, 0], atol=1e-15)
    np.testing.assert_allclose(later[2:, 1], at_once[:-2, 1], atol=1e-12)


def moved(plant, pushes):
    """Places under some controls, from rest."""
    state = plant.initial_state(jnp.zeros(2), jnp.zeros(2))
    for push in pushes:
        yield np.asarray(plant.output(state))
        state = plant.step(state, jnp.asarray(push))


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
        state, measurements = plant.initial_state(place, still), []
        for _ in range(samples // 20):
            measurements.append(plant.measure(state))
            state = plant.step(state, still)
        return np.array(measurements) - np.asarray(place)

    counted = read(machine.true_family()[0])
    assert counted.std(axis=0) == pytest.approx([np.sqrt(3e-7**2 + 1e-14 / 12), 0.0], rel=0.15)
    assert np.allclose(counted / 1e-7, np.round(counted / 1e-7), atol=1e-6)
    smooth = read(machine.smooth_family()[0]).std(axis=0)
    assert smooth == pytest.approx(machine.measurement_noise, rel=0.15)
    assert machine.measurement_noise**2 == pytest.approx(noise**2 + 1e-14 / 12)
    assert "noise 0.3, 0 um" in machine.description()["Measured"]


def test_bounds_come_from_the_machine_where_none_is_given():
    table = promised(machine_named("xy-table"))
    assert bounds_of(table, None, None) == pytest.approx((0.005, 0.5e-6), rel=1e-12)
    for friction in (0.02, 0.001):  # a tenth more behind the smallest input gain
        bounds = bounds_of(replace(table, friction=friction), None, None)
        largest = friction * 1.1 / (1 - table.uncertainty.gain)
        assert bounds == pytest.approx((largest, 0.5e-6), rel=1e-12)
    assert bounds_of(table, 0.0, 2.0) == pytest.approx((0.0, 2e-6), rel=1e-12)


def test_every_encoder_errs_by_half_a_count_of_its_own():
    table = promised(machine_named("xy-table"))
    mixed = replace(table, encoder_resolution=np.array([1e-6, 5e-6]))
    bounds = bounds_of(mixed, None, None)
    assert bounds.encoder == pytest.approx((0.5e-6, 2.5e-6))
    box = box_of(mixed.exact_family()[0], bounds, mixed, "outputs")
    assert box.noise == pytest.approx(np.array([0.5e-6, 2.5e-6]))
    assert bounds_of(mixed, None, 3.0).encoder == pytest.approx(3e-6)
    with pytest.raises(ValueError, match="half a count, 0.5, 2.5 um, received 1"):
        bounds_of(mixed, None, 1.0)


def test_noise_errs_by_three_deviations_beside_half_a_count():
    noisy = replace(promised(machine_named("xy-table")), encoder_noise=np.array([2e-6, 0.0]))
    assert bounds_of(noisy, None, None).encoder == pytest.approx((6.5e-6, 0.5e-6))
    with pytest.raises(ValueError, match="half a count and 3 deviations of noise, 6.5, 0.5 um"):
        bounds_of(noisy, None, 1.0)


def test_friction_that_is_not_known_is_told_where_no_force_is_given():
    rough = replace(promised(machine_named("xy-table")), friction=None)
    assert bounds_of(rough, 0.1, None).force == 0.1  # warnings are errors here
    with pytest.warns(UserWarning, match="its dry friction is not known.*give --force"):
        assert bounds_of(rough, None, None).force == pytest.approx(0.005)


@pytest.mark.parametrize(
    ("force", "encoder_um", "words"),
    [(-0.1, None, "force: "), (float("inf"), None, "force: "), (None, -1.0, "encoder-um: a bound"),
     (None, 0.4, "encoder-um: rounding alone errs by half a count, 0.5 um, received 0.4")],
)  # fmt: skip
def test_a_bound_that_is_none_is_told(force, encoder_um, words):
    with pytest.raises(ValueError, match=words):
        bounds_of(promised(machine_named("xy-table")), force, encoder_um)


@pytest.mark.parametrize("name", ["gantry", "flexible-axis"])
def test_a_machine_that_is_not_linear_is_refused(name):
    with pytest.raises(ValueError, match=f"plant: {name}.* is not linear"):
        promised(machine_named(name))


def test_a_response_that_is_doubted_is_not_in_the_promise():
    table = promised(machine_named("xy-table"))
    response = ResponseUncertainty(np.array([0.1]), np.full((1, 2), 0.2))
    unsure = replace(table, uncertainty=Uncertainty(0.1, 2, response))
    with pytest.warns(UserWarning, match="uncertainty.response. is not in what is promised"):
        promised(unsure)


def test_a_controller_on_the_host_meets_friction():
    hosted = xy_table_machine().hosted()
    assert isinstance(hosted.plant, FrictionXYTable) and hosted.plant.dt == 1e-3
    assert hosted.every == 4 and hosted.model.dt == 4e-3
    np.testing.assert_array_equal(hosted.model.A, xy_table(4e-3).A)


def test_its_current_is_limited():
    machine = xy_table_machine()
    assert machine.limits.control.tolist() == [0.5, 0.5] and machine.control_unit == "A"
