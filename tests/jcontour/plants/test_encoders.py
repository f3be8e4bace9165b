import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jcontour._arrays import placed
from jcontour.plants.actuation import Disturbed
from jcontour.plants.encoders import CountingEncoders, Encoders, FineEncoders, Quantised
from jcontour.plants.flexible_axis.axis import FlexibleAxis, thesis_axis
from jcontour.sensors import Sensors, motors


def test_quantised_measures_whole_counts_and_moves_as_before(two_axes, start, controls, plain, run):
    count = 0.8e-6
    outputs, measurements, _ = run(Quantised(Encoders(two_axes), count), start, controls)
    np.testing.assert_array_equal(outputs, plain[0])
    np.testing.assert_allclose(measurements / count, np.round(plain[0] / count), atol=1e-9)
    for bad in (0.0, -1e-6, float("nan")):
        with pytest.raises(ValueError, match="resolution"):
            Quantised(two_axes, bad)


def test_every_position_has_its_own_count(two_axes, start, controls, plain, run, run_any):
    counts = np.array([0.8e-6, 5e-6])
    _, measurements, _ = run(Quantised(Encoders(two_axes), counts), start, controls)
    pair = CountingEncoders(two_axes, Sensors((0, 2)), (0.8e-6, 5e-6))
    first = pair.initial_state(np.array([1e-3, 2e-3]), np.array([1e-5, 0.0]))
    _, (position, speed), _ = run_any(pair, first, controls)
    for axis, count in enumerate(counts):
        _, alike, _ = run(Quantised(Encoders(two_axes), count), start, controls)
        np.testing.assert_array_equal(measurements[:, axis], alike[:, axis])
        one = CountingEncoders(two_axes, Sensors((0, 2)), count)
        _, (place, moved), _ = run_any(one, first, controls)
        np.testing.assert_array_equal(position[:, axis], place[:, axis])
        np.testing.assert_array_equal(speed[:, axis], moved[:, axis])
    assert not np.array_equal(measurements, alike)
    with pytest.raises(ValueError, match="^resolution"):
        Quantised(Encoders(two_axes), (1e-6, 0.0))


def test_counting_encoders_count_and_difference(two_axes, start, controls, plain, run_any):
    count = 0.8e-6
    plant = CountingEncoders(two_axes, Sensors((0, 2)), count)
    first = plant.initial_state(np.array([1e-3, 2e-3]), np.array([1e-5, 0.0]))
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


def measured_at_rest(plant):
    """What is measured of one axis at 20 mm."""

    @eqx.filter_jit
    def measured(plant):
        return plant.measure(plant.initial_state(jnp.array([0.02]), jnp.zeros(1)))

    return jax.device_get(measured(plant))


def test_noise_is_there_before_the_counts():
    noise = placed(np.array([[0.6e-6, 9.0]]))
    inside = Disturbed(FlexibleAxis(thesis_axis(), 1e-3), noise=noise)
    plant = CountingEncoders(inside, motors(1), 1e-6)
    position, speed = measured_at_rest(plant)
    np.testing.assert_allclose(position, [0.020001], rtol=1e-12)
    np.testing.assert_allclose(speed, [0.0], atol=1e-12)
    seen, fast = measured_at_rest(inside)
    np.testing.assert_allclose([seen[0], fast[0]], [0.0200006, 9.0], rtol=1e-12)


def test_fine_encoders_are_counting_ones_with_tiny_counts(
    two_axes, start, controls, plain, run_any
):
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
