import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.linalg import solve_discrete_are

from jcontour._arrays import placed
from jcontour.controller import Controller, Wrapper
from jcontour.controllers.feedback.state_feedback import StateFeedback, lq_gain, moving_target
from jcontour.controllers.lq.contouring_lq import ContouringLQ, LQWeights
from jcontour.controllers.observers.kalman import (
    FilterObserver,
    OffsetFreeObserver,
    OffsetFreeWithLoad,
    PredictorObserver,
    kalman_gain,
    offset_free_gain,
)
from jcontour.geometry.contours import line
from jcontour.linear.plant import spectral_radius
from jcontour.motion.point_to_point import PointToPoint
from jcontour.motion.references import along, in_time
from jcontour.plants.actuation import Disturbed, Saturated
from jcontour.plants.encoders import Encoders, Sensed
from jcontour.plants.linear_machines import bridgeport
from jcontour.simulation.closed_loop import prepared, simulate


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
    A, C = np.asarray(plant.A), np.asarray(plant.C)
    assert spectral_radius(A - A @ L @ C) < 1


def test_kalman_gain_with_a_deviation_for_each_channel(coupled_plant):
    plant = coupled_plant(6, 4, 2)
    L = np.asarray(kalman_gain(plant, [0.3, 2.0], [0.5, 0.1]))
    np.testing.assert_allclose(L, scipy_gain(plant, [0.3, 2.0], [0.5, 0.1]), rtol=1e-8, atol=1e-10)


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
    start = two_axes.initial_state(np.asarray(reference.position)[0], reference.start_increment)
    rollout = simulate(Encoders(two_axes), form(law, two_axes, L), reference, start + error)
    actual = np.asarray(rollout.state) - np.asarray(rollout.memory.estimate)
    for row in actual:
        np.testing.assert_allclose(row, error, rtol=0, atol=1e-15)
        error = (A - A @ np.asarray(L) @ C) @ error
    assert np.abs(error).max() < 1e-3 * np.abs(actual[0]).max()


def test_filter_uses_the_current_measurement_and_predictor_does_not(two_axes, law, reference):
    L = kalman_gain(two_axes, 0.01, 1e-6)
    row = jax.tree.map(lambda leaf: np.asarray(leaf)[0], prepared(law, reference))
    for form, uses in ((FilterObserver, True), (PredictorObserver, False)):
        controller = form(law, two_axes, L)
        memory = controller.initial_memory(reference)
        controls = [
            controller.step(memory, row, jnp.asarray(y))[1] for y in ([0.0, 0.0], [1e-6, 0.0])
        ]
        assert (np.abs(controls[0] - controls[1]).max() > 0) == uses


MOTOR = np.eye(4)[:2]
NOISE = (0.05, np.array([1e-6, 1e-3]))


@pytest.fixture(scope="module")
def thesis_feedback(thesis_model):
    gain = lq_gain(thesis_model, np.diag([1e7, 1e3, 1e7, 1.0]), np.eye(1))
    return StateFeedback(gain, moving_target(thesis_model))


def test_offset_free_gain_is_scipys_with_the_disturbance_as_a_state(thesis_model):
    A, B = np.asarray(thesis_model.A), np.asarray(thesis_model.B)
    whole, seen = (
        np.block([[A, B], [np.zeros((1, 4)), np.ones((1, 1))]]),
        np.hstack([MOTOR, np.zeros((2, 1))]),
    )
    scale = np.diag([1e6, 1e3])  # of the measurements, for SciPy's sake
    W = np.block(
        [[B @ B.T * 0.05**2, np.zeros((4, 1))], [np.zeros((1, 4)), np.full((1, 1), 0.02**2)]]
    )
    P = solve_discrete_are(whole.T, (scale @ seen).T, W, np.eye(2))
    wanted = (
        P @ seen.T @ scale @ np.linalg.inv(scale @ seen @ P @ seen.T @ scale + np.eye(2)) @ scale
    )
    np.testing.assert_allclose(
        offset_free_gain(thesis_model, MOTOR, 0.05, 0.02, [1e-6, 1e-3]),
        wanted,
        rtol=1e-7,
        atol=1e-9,
    )


class Cancelling(Wrapper):
    """Receives the load, and takes it from the control."""

    controller: Controller

    def initial_memory(self, reference):
        return self.controller.initial_memory(reference)

    def step(self, memory, plan, measurement):
        inner, control = self.controller.step(memory, plan, measurement.state)
        return inner, control - measurement.disturbance


def test_who_is_told_of_the_load_may_cancel_it_himself(thesis_model, thesis_feedback):
    gain = offset_free_gain(thesis_model, MOTOR, 0.05, 0.05, [1e-6, 1e-3])
    task = in_time(line([0.0], [0.01]), PointToPoint(0.01, 0.1, 4.0), 0.2, 1e-3)
    machine = Disturbed(Sensed(thesis_model, lambda x: x[:2]), placed(np.full((1, 1), 0.5)))
    wanted, actual = (
        simulate(machine, observer, task).control
        for observer in (
            OffsetFreeObserver(thesis_feedback, thesis_model, gain, MOTOR),
            OffsetFreeWithLoad(Cancelling(thesis_feedback), thesis_model, gain, MOTOR),
        )
    )
    assert np.abs(wanted).max() > 0.1
    np.testing.assert_array_equal(actual, wanted)


def test_at_a_limit_the_disturbance_is_not_mistaken(thesis_model, thesis_feedback):
    """An observer that knows the limit keeps only the rest of its wrong start.

    Untold, it takes the missing control for a load.
    """
    rest = along(line([0.0], [0.1]), np.zeros(400), 1e-3, 1, at_rest=True)
    start, gain = (
        thesis_model.initial_state(np.array([-0.02]), np.zeros(1)),
        offset_free_gain(thesis_model, MOTOR, 0.05, 0.05, [1e-6, 1e-3]),
    )
    machine = Saturated(Sensed(thesis_model, lambda x: x[:2]), np.array([2.0]))
    actual = []
    for limit in (np.inf, 2.0):
        observer = OffsetFreeObserver(thesis_feedback, thesis_model, gain, MOTOR, limit)
        run = simulate(machine, observer, rest, start)
        actual.append(np.abs(np.asarray(run.memory.disturbance)[50:]).max())
    assert actual[0] > 10.0 and actual[1] < 1.0
    with pytest.raises(ValueError, match="^limit: "):
        OffsetFreeObserver(thesis_feedback, thesis_model, gain, MOTOR, -1.0)


def test_gains_that_do_not_stabilise_are_named_with_their_eigenvalues(
    thesis_model, thesis_feedback
):
    for make in (
        lambda: FilterObserver(thesis_feedback, thesis_model, -np.ones((4, 2)), measured=MOTOR),
        lambda: PredictorObserver(thesis_feedback, thesis_model, np.zeros((4, 1))),
        lambda: OffsetFreeObserver(thesis_feedback, thesis_model, np.zeros((5, 2)), MOTOR),
    ):
        with pytest.raises(ValueError, match=r"^gain: the observer is not stable: .* they are \["):
            make()
    slow = in_time(line([0.0], [0.01]), PointToPoint(0.01, 0.1, 4.0), 1.5, 2e-3)
    gain = kalman_gain(thesis_model, *NOISE, MOTOR)
    with pytest.raises(ValueError, match="^dt: the controller is sampled every 0.001 s"):
        FilterObserver(thesis_feedback, thesis_model, gain, measured=MOTOR).initial_memory(slow)
    with pytest.raises(ValueError, match=r"^gain: needs shape \(4, 2\)"):
        FilterObserver(thesis_feedback, thesis_model, np.zeros((4, 1)), measured=MOTOR)
