import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.plants.flexible_axis.axis import FlexibleAxis, thesis_axis
from jcontour.plants.wrappers.delays import Delayed, LateSensors
from jcontour.plants.wrappers.disturbances import Disturbed
from jcontour.plants.wrappers.encoders import CountingEncoders, Encoders, FineEncoders, Quantised
from jcontour.plants.wrappers.saturation import Saturated
from jcontour.plants.wrappers.wrapper import unwrapped
from jcontour.sensors import Sensors, motors


def run(plant, state, controls):
    """Outputs, measurements and last state."""
    outputs, (measurements,), last = run_any(plant, state, controls)
    return outputs, measurements, last


def run_any(plant, state, controls):
    """The same, with the leaves of the measurements in a list."""

    def step(state, control):
        return plant.step(state, control), (plant.output(state), plant.measure(state))

    last, (outputs, measurements) = jax.lax.scan(step, state, jnp.asarray(controls))
    return np.asarray(outputs), [np.asarray(leaf) for leaf in jax.tree.leaves(measurements)], last


@pytest.fixture(scope="module")
def start(two_axes):
    return two_axes.initial_state(jnp.array([1e-3, 2e-3]), jnp.array([1e-5, 0.0]))


@pytest.fixture(scope="module")
def controls():
    return 1e-2 * np.random.default_rng(0).standard_normal((8, 2))


@pytest.fixture(scope="module")
def plain(two_axes, start, controls):
    return run(two_axes, start, controls)


def test_encoders_measure_the_outputs(two_axes, start, controls, plain):
    outputs, measurements, last = run(Encoders(two_axes), start, controls)
    np.testing.assert_array_equal(outputs, plain[0])
    np.testing.assert_array_equal(measurements, plain[0])
    np.testing.assert_array_equal(last, plain[2])


def test_quantised_measures_whole_counts_and_moves_as_before(two_axes, start, controls, plain):
    count = 0.8e-6
    outputs, measurements, _ = run(Quantised(Encoders(two_axes), count), start, controls)
    np.testing.assert_array_equal(outputs, plain[0])
    np.testing.assert_allclose(measurements / count, np.round(plain[0] / count), atol=1e-9)
    for bad in (0.0, -1e-6, float("nan")):
        with pytest.raises(ValueError, match="resolution"):
            Quantised(two_axes, bad)


def test_counting_encoders_count_and_difference(two_axes, start, controls, plain):
    count = 0.8e-6
    plant = CountingEncoders(two_axes, Sensors((0, 2)), count)
    first = plant.initial_state(jnp.array([1e-3, 2e-3]), jnp.array([1e-5, 0.0]))
    outputs, (position, speed), _ = run_any(plant, first, controls)
    np.testing.assert_array_equal(outputs, plain[0])
    wanted = count * np.round(plain[1][:, [0, 2]] / count)
    before = count * np.round((np.array([[1e-3, 2e-3]]) - [[1e-5, 0.0]]) / count)
    np.testing.assert_allclose(position, wanted, rtol=1e-13)
    np.testing.assert_allclose(
        speed, np.diff(np.concatenate([before, wanted]), axis=0) / two_axes.dt, rtol=0, atol=1e-12
    )
    with pytest.raises(ValueError, match="^resolution"):
        CountingEncoders(two_axes, Sensors((0, 2)), 0.0)


@pytest.mark.parametrize("samples", [0, 1, 2])
def test_late_sensors_show_what_was(samples):
    """Motor of the flexible axis under a push; before the start it moved steadily."""
    axis, push = FlexibleAxis(thesis_axis(), 1e-3), np.full((6, 1), 3.0)
    at, increment = jnp.array([0.01]), jnp.array([1e-4])
    _, now, _ = run_any(axis, axis.initial_state(at, increment), push)
    plant = LateSensors(axis, jnp.asarray(samples), 2)
    _, late, _ = run_any(plant, plant.initial_state(at, increment), push)
    for k in range(2):
        np.testing.assert_array_equal(late[k][samples:], now[k][: 6 - samples])
    np.testing.assert_allclose(
        late[0][:samples, 0], [0.01 - 1e-4 * (samples - k) for k in range(samples)], rtol=1e-13
    )


def test_noise_is_there_before_the_counts_of_a_late_motor():
    noise = jnp.array([[0.6e-6, 9.0]])
    inside = Disturbed(FlexibleAxis(thesis_axis(), 1e-3), noise=noise)
    plant = LateSensors(CountingEncoders(inside, motors(1), 1e-6), jnp.asarray(1), 1)
    position, speed = plant.measure(plant.initial_state(jnp.array([0.02]), jnp.zeros(1)))
    np.testing.assert_allclose(position, [0.020001], rtol=1e-12)
    np.testing.assert_allclose(speed, [0.0], atol=1e-12)
    seen, fast = inside.measure(inside.initial_state(jnp.array([0.02]), jnp.zeros(1)))
    np.testing.assert_allclose([seen[0], fast[0]], [0.0200006, 9.0], rtol=1e-12)


def test_fine_encoders_are_counting_ones_with_tiny_counts(two_axes, start, controls, plain):
    sensors = Sensors(position=(0, 2))
    begin = (jnp.array([1e-3, 2e-3]), jnp.array([1e-5, 0.0]))
    fine, counting = FineEncoders(two_axes, sensors), CountingEncoders(two_axes, sensors, 1e-13)
    found, wanted = (
        run_any(plant, plant.initial_state(*begin), controls) for plant in (fine, counting)
    )
    np.testing.assert_array_equal(found[0], plain[0])
    for a, b in zip(found[1], wanted[1], strict=True):
        np.testing.assert_allclose(a, b, rtol=0, atol=2e-10)
    np.testing.assert_allclose(found[1][1][0], [1e-2, 0.0], atol=1e-12)


def test_saturated_clips_each_control(two_axes, start, controls):
    limit = np.array([5e-3, 1.0])
    found = run(Saturated(two_axes, jnp.asarray(limit)), start, controls)
    wanted = run(two_axes, start, np.clip(controls, -limit, limit))
    np.testing.assert_array_equal(found[0], wanted[0])
    assert np.abs(controls[:, 0]).max() > limit[0]


@pytest.mark.parametrize("samples", [0, 1, 2])
def test_delayed_is_the_plant_under_shifted_controls(samples, two_axes, start, controls):
    plant = Delayed(two_axes, jnp.asarray(samples), 2, 2)
    state = plant.initial_state(jnp.array([1e-3, 2e-3]), jnp.array([1e-5, 0.0]))
    outputs, measurements, last = run(plant, state, controls)
    wanted = run(two_axes, start, np.concatenate([np.zeros((samples, 2)), controls])[:8])
    np.testing.assert_allclose(outputs, wanted[0], rtol=1e-14)
    np.testing.assert_allclose(last[0], wanted[2], rtol=1e-14, atol=1e-20)
    np.testing.assert_array_equal(last[1], controls[:-3:-1])
    assert measurements.shape == (8, 4)


@pytest.mark.parametrize("limit", [[1.0, -1.0], [np.nan, 1.0]])
def test_a_limit_below_zero_is_refused(limit, two_axes):
    with pytest.raises(ValueError, match="limit"):
        Saturated(two_axes, jnp.array(limit))


def test_delay_line_needs_a_place(two_axes):
    with pytest.raises(ValueError, match="depth"):
        Delayed(two_axes, 0, 0, 2)


@pytest.mark.parametrize("samples", [3, -1])
def test_a_delay_that_the_line_does_not_hold_is_refused(samples, two_axes):
    with pytest.raises(ValueError, match="samples"):
        Delayed(two_axes, samples, 2, 2)


def test_disturbed_adds_rows_and_holds_the_last(two_axes, start, controls):
    random = np.random.default_rng(1)
    force, noise = 1e-3 * random.standard_normal((3, 2)), 1e-6 * random.standard_normal((8, 2))
    plant = Disturbed(Encoders(two_axes), jnp.asarray(force), jnp.asarray(noise))
    state = plant.initial_state(jnp.array([1e-3, 2e-3]), jnp.array([1e-5, 0.0]))
    outputs, measurements, last = run(plant, state, controls)
    wanted = run(two_axes, start, controls + force[np.minimum(np.arange(8), 2)])
    np.testing.assert_allclose(outputs, wanted[0], rtol=1e-14)
    np.testing.assert_allclose(measurements, wanted[0] + noise, rtol=1e-14)
    assert int(last[1]) == 8


def test_wrappers_nest(two_axes, start, controls):
    limit = jnp.array([5e-3, 5e-3])
    plant = Encoders(Saturated(Delayed(two_axes, jnp.asarray(1), 2, 2), limit))
    state = plant.initial_state(jnp.array([1e-3, 2e-3]), jnp.array([1e-5, 0.0]))
    outputs, measurements, _ = run(plant, state, controls)
    late = np.concatenate([np.zeros((1, 2)), np.clip(controls, -limit, limit)])[:8]
    np.testing.assert_allclose(measurements, run(two_axes, start, late)[0], rtol=1e-14)
    np.testing.assert_array_equal(outputs, measurements)
    assert plant.dt == two_axes.dt


def test_unwrapped_is_the_machine_and_its_own_state(two_axes, start):
    delayed = Delayed(Saturated(two_axes, jnp.ones(2)), jnp.asarray(1), 2, 2)
    wrapped = LateSensors(
        CountingEncoders(Disturbed(delayed), Sensors(range(2)), 1e-6), jnp.asarray(1), 2
    )
    state = wrapped.initial_state(jnp.array([1e-3, 2e-3]), jnp.array([1e-5, 0.0]))
    machine, own = unwrapped(wrapped, state)
    assert machine is two_axes
    np.testing.assert_array_equal(own, start)
    np.testing.assert_array_equal(wrapped.output(state), two_axes.output(start))
    assert unwrapped(two_axes, start)[1] is start
