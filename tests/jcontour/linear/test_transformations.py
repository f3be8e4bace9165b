"""Linear plants made from linear plants, against SciPy and the plants themselves."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.signal import cont2discrete

from jcontour.linear.transformations import with_input_delay, with_input_gains, zoh
from jcontour.plants.delays import Delayed
from jcontour.plants.gantry.gantry import thesis_gantry
from jcontour.plants.gantry.linear_models import motor_model


def test_zoh_is_that_of_scipy():
    states, random = 6, np.random.default_rng(6)
    A, B = random.standard_normal((states, states)), random.standard_normal((states, 2))
    A[0] = 0.0  # singular: no closed form through the inverse
    discretise = jax.jit(zoh)
    for dt in (1e-3, 0.7):
        wanted = cont2discrete((A, B, np.eye(states), np.zeros((states, 2))), dt)
        found = discretise(A, B, dt)
        np.testing.assert_allclose(found[0], wanted[0], rtol=1e-12, atol=1e-14)
        np.testing.assert_allclose(found[1], wanted[1], rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize("samples", [1, 3])
def test_delay_in_the_model_is_the_delay_of_the_wrapper(samples, coupled_plant, run):
    plant = coupled_plant(1, 4, 2)
    model, wrapped = with_input_delay(plant, samples), Delayed(plant, samples, 3, 2)
    random = np.random.default_rng(2)
    x, controls = random.standard_normal(4), random.standard_normal((9, 2))
    _, outputs = run(model, np.append(x, np.zeros(2 * samples)), controls)

    @jax.jit
    def outputs_of(start, controls):
        return jax.lax.scan(lambda z, u: (wrapped.step(z, u), wrapped.output(z)), start, controls)[
            1
        ]

    found = outputs_of((x, np.zeros((3, 2))), controls)
    np.testing.assert_allclose(found, outputs[:-1], rtol=1e-12, atol=1e-13)


def test_no_delay_is_the_plant_itself(two_axes):
    assert with_input_delay(two_axes, 0) is two_axes
    with pytest.raises(ValueError, match="samples.*-1"):
        with_input_delay(two_axes, -1)


def test_input_gains_scale_columns_of_b(two_axes):
    np.testing.assert_array_equal(
        with_input_gains(two_axes, (1.1, 0.5)).B, np.asarray(two_axes.B) * [1.1, 0.5]
    )
    np.testing.assert_array_equal(with_input_gains(two_axes, 2.0).B, 2.0 * np.asarray(two_axes.B))


@pytest.mark.parametrize("samples", [1, 3])
def test_given_maps_of_steady_motion_gain_the_control_that_carries_it_on(samples):
    """On a gantry, whose axes are coupled: nothing but the place changes from sample to sample."""
    model = motor_model(thesis_gantry(), 0.0, 1e-3)
    late = with_input_delay(model, samples)
    position, increment = jnp.array([0.2, -0.1]), jnp.array([1e-4, 2e-4])
    state = late.initial_state(position, increment)
    np.testing.assert_allclose(state[:6], model.initial_state(position, increment), rtol=1e-12)
    control = state[6:9]
    for k in (1, 2):
        state = late.step(state, control)
        wanted = late.initial_state(position + k * increment, increment)
        np.testing.assert_allclose(state, wanted, rtol=1e-9, atol=1e-12)
