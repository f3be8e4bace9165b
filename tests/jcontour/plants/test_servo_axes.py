"""Servos side by side against SciPy's discretisation."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.signal import cont2discrete

from jcontour.plants.servo_axes import servo_axes


def sampled(gain, pole, dt):
    A, B = np.array([[0, 1], [0, -pole]]), np.array([[0], [gain]])
    return cont2discrete((A, B, np.eye(2), np.zeros((2, 1))), dt)[:2]


@pytest.mark.parametrize(("dt", "poles"), [(2e-3, (10.0, 12.0)), (1e-2, (0.1, 300.0))])
def test_blocks_are_sampled_exactly(dt, poles):
    plant = servo_axes([50.0, 40.0], poles, dt)
    found = np.asarray(plant.A), np.asarray(plant.B)
    for axis, (gain, pole) in enumerate(zip((50.0, 40.0), poles, strict=True)):
        A, B = sampled(gain, pole, dt)
        rows = slice(2 * axis, 2 * axis + 2)
        np.testing.assert_allclose(found[0][rows, rows], A, rtol=1e-11, atol=1e-15)
        np.testing.assert_allclose(found[1][rows, axis : axis + 1], B, rtol=1e-9)
    assert np.count_nonzero(plant.A) == 6 and np.count_nonzero(plant.B) == 4


def test_one_pole_stands_for_all_axes_and_the_start_is_in_motion():
    plant = servo_axes([50.0, 40.0, 30.0], 10.0, 2e-3)
    state = plant.initial_state(np.array([1.0, 2.0, 3.0]), np.array([2e-3, 0.0, -4e-3]))
    np.testing.assert_allclose(state, [1.0, 1.0, 2.0, 0.0, 3.0, -2.0], atol=1e-12)


def test_numbers_may_be_traced():
    @jax.jit
    def reached(gain, pole):
        plant = servo_axes(gain, pole, 1e-2)
        return plant.output(plant.step(jnp.zeros(4), jnp.ones(2)))[1]

    gain, pole = np.array([50.0, 40.0]), np.array([10.0, 20.0])
    slope = jax.jit(jax.grad(reached, argnums=1))(gain, pole)
    h = np.array([0.0, 1e-4])
    difference = np.subtract(reached(gain, pole + h), reached(gain, pole - h)) / 2e-4
    np.testing.assert_allclose(slope, [0.0, difference], rtol=1e-7)


@pytest.mark.parametrize(
    ("gain", "pole", "dt"),
    [([0.0], 1.0, 1e-3), ([1.0], -1.0, 1e-3), ([1.0], 1.0, 0.0), ([np.nan], 1.0, 1e-3)],
)
def test_bad_numbers(gain, pole, dt):
    with pytest.raises(ValueError, match="needs to be above zero"):
        servo_axes(gain, pole, dt)


@pytest.mark.parametrize(("gain", "pole"), [(1.0, 1.0), ([1.0, 2.0], [1.0, 2.0, 3.0])])
def test_bad_shapes(gain, pole):
    with pytest.raises(ValueError, match="one number for each axis"):
        servo_axes(gain, pole, 1e-3)
