"""Linear plants made from linear plants, against SciPy and the plants themselves."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.signal import cont2discrete

from jcontour.linear.transformations import velocity_form, with_input_delay, with_input_gains, zoh
from jcontour.plants.actuation import Delayed
from jcontour.plants.gantry.gantry import thesis_gantry
from jcontour.plants.gantry.linear_models import motor_model
from jcontour.plants.linear_machines import bridgeport
from jcontour.plants.xy_table import xy_table
from tests.reference_data import numbers_of


def test_zoh_is_that_of_scipy():
    states, random = 6, np.random.default_rng(6)
    A, B = random.standard_normal((states, states)), random.standard_normal((states, 2))
    A[0] = 0.0  # singular: no closed form through the inverse
    discretise = jax.jit(zoh)
    for dt in (1e-3, 0.7):
        wanted = cont2discrete((A, B, np.eye(states), np.zeros((states, 2))), dt)
        actual = discretise(A, B, dt)
        np.testing.assert_allclose(actual[0], wanted[0], rtol=1e-12, atol=1e-14)
        np.testing.assert_allclose(actual[1], wanted[1], rtol=1e-12, atol=1e-14)


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

    actual = outputs_of((x, np.zeros((3, 2))), controls)
    np.testing.assert_allclose(actual, outputs[:-1], rtol=1e-12, atol=1e-13)


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


DATA = numbers_of("mpcc/reference")


@pytest.mark.parametrize("dt", (0.004, 0.001))
def test_eigenvalues_are_the_reference_ones(dt):
    moduli = np.sort(np.abs(np.linalg.eigvals(np.asarray(velocity_form(xy_table(dt)).A))))
    np.testing.assert_allclose(
        moduli, DATA["plant"][f"zoh_{dt}"]["eig_velocity_form_abs"], rtol=0, atol=1e-9
    )


@pytest.mark.parametrize(
    "make", (partial(xy_table, 0.004), bridgeport), ids=("table", "bridgeport")
)
def test_predicts_the_plant_whose_control_is_one_sample_late_even_under_a_constant_load(make):
    plant = make()
    rng = np.random.default_rng(0)
    A, B, C = (np.asarray(matrix) for matrix in (plant.A, plant.B, plant.C))
    n, p = plant.states, plant.inputs
    controls, load = rng.normal(size=(40, p)), 1e-4 * rng.normal(size=n)
    x = [rng.normal(size=n)]
    for k in range(39):
        x.append(
            A @ x[-1] + B @ controls[k] + load
        )  # control k acts during [k, k + 1): the model calls it u(k - 1)
    model = velocity_form(plant)
    state = np.concatenate([x[1] - x[0], controls[1] - controls[0], C @ x[1]])
    for k in range(1, 39):
        np.testing.assert_allclose(model.output(state), C @ x[k], rtol=1e-9, atol=1e-9)
        state = np.asarray(model.step(state, controls[k + 1] - controls[k]))
