import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.linalg import solve_discrete_are

from jcontour.contours import line
from jcontour.controllers.contouring_lq import ContouringLQ, LQWeights
from jcontour.controllers.observers import FilterObserver, PredictorObserver, kalman_gain
from jcontour.linear import LinearPlant, spectral_radius
from jcontour.plants.bridgeport import bridgeport
from jcontour.plants.wrappers import Encoders
from jcontour.references import along
from jcontour.simulation import simulate


def scipy_gain(plant, control_noise, measurement_noise):
    """The filter Riccati equation by SciPy, lengths in units of the first deviation."""
    A, C = np.asarray(plant.A), np.asarray(plant.C)
    B = np.asarray(plant.B) * control_noise / measurement_noise[0]
    V = np.diag((np.asarray(measurement_noise) / measurement_noise[0]) ** 2)
    P = solve_discrete_are(A.T, C.T, B @ B.T, V)
    return P @ C.T @ np.linalg.inv(C @ P @ C.T + V)


def test_kalman_gain_of_the_bridgeport_is_block_diagonal_and_that_of_scipy():
    plant = bridgeport()
    L = np.asarray(kalman_gain(plant, 0.01, 0.23e-6))
    wanted = scipy_gain(plant, 0.01, [0.23e-6, 0.23e-6])
    np.testing.assert_allclose(L, wanted, rtol=0, atol=1e-7 * np.abs(wanted).max())
    assert np.abs(L[:3, 1]).max() < 1e-12 * np.abs(L).max()
    assert np.abs(L[3:, 0]).max() < 1e-12 * np.abs(L).max()
    assert spectral_radius(plant.A - plant.A @ L @ plant.C) < 1


def test_kalman_gain_with_a_deviation_for_each_channel(coupled_plant):
    plant = coupled_plant(6, 4, 2)
    L = np.asarray(kalman_gain(plant, [0.3, 2.0], [0.5, 0.1]))
    np.testing.assert_allclose(L, scipy_gain(plant, [0.3, 2.0], [0.5, 0.1]), rtol=1e-8, atol=1e-10)


def test_hidden_modes_are_refused():
    hidden = LinearPlant(np.diag([1.0, 0.5]), [[1.0], [1.0]], [[0.0, 1.0]], 1.0)
    with pytest.raises(ValueError, match="no stabilising solution"):
        kalman_gain(hidden, 1.0, 1.0)


@pytest.fixture(scope="module")
def law(two_axes):
    return ContouringLQ(two_axes, LQWeights(3.0, 5.0, 1e-6), 3)


@pytest.fixture(scope="module")
def reference():
    return along(line([0, 0], [3e-3, 4e-3]), 1e-5 * np.arange(25), 1e-3, 3, at_rest=False)


@pytest.mark.parametrize("form", [FilterObserver, PredictorObserver])
def test_estimation_error_decays_as_a_minus_alc(form, two_axes, law, reference):
    """x - xh obeys (A - A L C) whatever the controller does."""
    A, C = np.asarray(two_axes.A), np.asarray(two_axes.C)
    L = kalman_gain(two_axes, 0.01, 1e-6)
    error = 1e-4 * np.array([1.0, -2.0, 0.5, 3.0])
    start = two_axes.initial_state(reference.position[0], reference.start_increment)
    rollout = simulate(Encoders(two_axes), form(law, two_axes, L, start - error), reference, start)
    found = np.asarray(rollout.state) - np.asarray(rollout.memory.estimate)
    for row in found:
        np.testing.assert_allclose(row, error, rtol=0, atol=1e-15)
        error = (A - A @ np.asarray(L) @ C) @ error
    assert np.abs(error).max() < 1e-3 * np.abs(found[0]).max()


@pytest.mark.parametrize("form", [FilterObserver, pytest.param(PredictorObserver, marks=pytest.mark.slow)])
def test_a_perfect_start_is_state_feedback(form, two_axes, law, reference):
    controller = form(law, two_axes, kalman_gain(two_axes, 0.01, 1e-6))
    found = simulate(Encoders(two_axes), controller, reference)
    wanted = simulate(two_axes, law, reference)
    np.testing.assert_allclose(found.control, wanted.control, rtol=0, atol=1e-11 * np.abs(wanted.control).max())
    assert controller.preview == law.preview


def test_filter_uses_the_current_measurement_and_predictor_does_not(two_axes, law, reference):
    L = kalman_gain(two_axes, 0.01, 1e-6)
    row = jax.tree.map(lambda leaf: leaf[0], law.prepare(reference))
    for form, uses in ((FilterObserver, True), (PredictorObserver, False)):
        controller = form(law, two_axes, L)
        memory = controller.initial_memory(reference)
        controls = [controller.step(memory, row, jnp.asarray(y))[1] for y in ([0.0, 0.0], [1e-6, 0.0])]
        assert (np.abs(controls[0] - controls[1]).max() > 0) == uses
