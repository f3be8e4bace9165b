import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.linalg import solve_discrete_are

from jcontour._arrays import placed
from jcontour.analysis.stability import frozen_spectral_radii
from jcontour.controllers.feedback.state_feedback import (
    IntegralLQG,
    StateFeedback,
    integral_lq_gains,
    lq_gain,
    moving_target,
    positions_of,
    quasi_steady_target,
    with_integrals,
)
from jcontour.controllers.observers.kalman import (
    FilterObserver,
    OffsetFreeObserver,
    kalman_gain,
    offset_free_gain,
)
from jcontour.geometry.contours import line
from jcontour.linear.plant import LinearPlant
from jcontour.linear.transformations import with_input_gains
from jcontour.motion.point_to_point import PointToPoint
from jcontour.motion.references import along, in_time
from jcontour.plants.actuation import Disturbed, Saturated
from jcontour.plants.encoders import Sensed
from jcontour.plants.flexible_axis.axis import zoh_model
from jcontour.sensors import motors
from jcontour.simulation.closed_loop import simulate

DT = 1e-3


Q, R = np.diag([1e7, 1e3, 1e7, 1.0]), np.array([[2.0]])


def test_gain_and_closed_loop_poles_are_those_of_scipys_riccati_equation(thesis_model):
    A, B = np.asarray(thesis_model.A), np.asarray(thesis_model.B)
    P = solve_discrete_are(A, B, Q, R)
    wanted = np.linalg.solve(R + B.T @ P @ B, B.T @ P @ A)
    K = lq_gain(thesis_model, Q, R)
    np.testing.assert_allclose(K, wanted, rtol=1e-9)
    poles = [np.sort_complex(np.linalg.eigvals(A - B @ gain)) for gain in (np.asarray(K), wanted)]
    np.testing.assert_allclose(*poles, rtol=0, atol=1e-9)


def test_targets_of_a_coupled_machine(coupled_plant):
    """Against their definition: the model carries on a steady motion by itself."""
    model = coupled_plant(3, 5, 2)
    y, dy = np.array([0.3, -0.2]), np.array([0.01, 0.02])
    t = jax.device_get(moving_target(model))
    x, u = t.state @ y + t.state_moving @ dy, t.control @ y + t.control_moving @ dy
    np.testing.assert_allclose(np.asarray(model.C) @ x, y, rtol=1e-10)
    np.testing.assert_allclose(
        model.step(x, u), t.state @ (y + dy) + t.state_moving @ dy, rtol=1e-9, atol=1e-12
    )
    rest = jax.device_get(quasi_steady_target(model))
    np.testing.assert_allclose(
        model.step(rest.state @ y, rest.control @ y), rest.state @ y, rtol=1e-10
    )
    assert not np.any(rest.state_moving) and not np.any(rest.control_moving)


def test_the_moving_target_follows_a_ramp_and_the_thesiss_lags(thesis_model):
    reference = along(line([0.0], [0.1]), 1e-4 * np.arange(800), DT, 1, at_rest=False)
    K = lq_gain(thesis_model, Q, R)
    lags = [
        abs(
            float(
                simulate(thesis_model, StateFeedback(K, target), reference).output[-1, 0]
                - reference.position[799, 0]
            )
        )
        for target in (moving_target(thesis_model), quasi_steady_target(thesis_model))
    ]
    A, B = np.asarray(thesis_model.A), np.asarray(thesis_model.B)
    rest, motion = quasi_steady_target(thesis_model), moving_target(thesis_model)
    closed = A - B @ np.asarray(
        K
    )  # at rest relative to the ramp: x = closed x + B K x_d - motion of the frame
    away = np.linalg.solve(
        np.eye(4) - closed, B @ (np.asarray(K) @ motion.state_moving + motion.control_moving) * 1e-4
    )
    assert lags[0] < 1e-9 and rest.state.shape == (4, 1)
    np.testing.assert_allclose(lags[1], abs(away[2, 0]), rtol=1e-6)


def test_bad_input_is_named(thesis_model):
    with pytest.raises(ValueError, match=r"^gain: needs shape \(1, 4\)"):
        StateFeedback(np.zeros((1, 3)), moving_target(thesis_model))
    with pytest.raises(ValueError, match="^gain: every entry"):
        StateFeedback(np.full((1, 4), np.nan), moving_target(thesis_model))
    with pytest.raises(ValueError, match="as many controls as outputs"):
        moving_target(LinearPlant(thesis_model.A, thesis_model.B, np.eye(4)[:2], DT))
    with pytest.raises(ValueError, match="cannot hold every position"):
        moving_target(
            LinearPlant(thesis_model.A, thesis_model.B, [[0.0, 1.0, 0.0, 0.0]], DT)
        )  # a speed
    with pytest.raises(ValueError, match="no stabilising solution"):
        lq_gain(LinearPlant(np.diag([1.2, 0.5]), [[0.0], [1.0]], [[1.0, 1.0]], DT), np.eye(2), R)


NOISE = [1e-6, 1e-3]  # of an encoder, and of its difference
INTEGRAL_LQG_Q, Q_I, INTEGRAL_LQG_R = np.diag([1e7, 1e3, 1e7, 1.0]), np.array([[1e10]]), np.eye(1)


def designed(model, axes=1, limit=np.inf):
    measured, sensors = np.eye(4 * axes)[: 2 * axes], motors(axes)
    weights = (np.kron(INTEGRAL_LQG_Q, np.eye(axes)), np.kron(Q_I, np.eye(axes)), np.eye(axes))
    K, K_i = integral_lq_gains(model, positions_of(sensors, measured), *weights)
    L = kalman_gain(model, 0.05, np.repeat(NOISE, axes), measured)
    return IntegralLQG(
        StateFeedback(K, moving_target(model)), K_i, model, L, measured, sensors, limit
    )


MOTOR = np.eye(4)[:2]


@pytest.fixture(scope="module")
def model(thesis_model):
    return thesis_model


@pytest.fixture(scope="module")
def lqg(model):
    return designed(model)


@pytest.fixture(scope="module")
def plant(model):
    return Sensed(model, lambda x: x[:2])


@pytest.fixture(scope="module")
def feedback(model):
    return StateFeedback(lq_gain(model, INTEGRAL_LQG_Q, INTEGRAL_LQG_R), moving_target(model))


@pytest.fixture(scope="module")
def plain_lqg(model, feedback):
    return FilterObserver(feedback, model, kalman_gain(model, 0.05, NOISE, MOTOR), measured=MOTOR)


@pytest.fixture(scope="module")
def offset_free(model, feedback):
    gain = offset_free_gain(model, MOTOR, 0.05, 0.05, NOISE)
    return OffsetFreeObserver(feedback, model, gain, MOTOR)


def test_gains_are_those_of_scipys_riccati_equation(model, lqg):
    A, B = np.asarray(model.A), np.asarray(model.B)
    A = np.block([[A, np.zeros((4, 1))], [DT * MOTOR[:1], np.ones((1, 1))]])
    B = np.vstack([B, np.zeros((1, 1))])
    weight = np.block([[INTEGRAL_LQG_Q, np.zeros((4, 1))], [np.zeros((1, 4)), Q_I]])
    P = solve_discrete_are(A, B, weight, INTEGRAL_LQG_R)
    wanted = np.linalg.solve(INTEGRAL_LQG_R + B.T @ P @ B, B.T @ P @ A)
    np.testing.assert_allclose(np.hstack([lqg.feedback.gain, lqg.integral_gain]), wanted, rtol=1e-7)


def test_poles_of_the_loop_are_those_of_the_feedback_and_of_the_filter(model, plant, lqg):
    """Separation: the loop of machine, filter and integral against the two problems apart."""
    task = along(line([0.0], [0.1]), 1e-4 * np.arange(2), DT, 1, at_rest=False)
    whole = with_integrals(model, placed(MOTOR[:1]))
    gain = np.hstack([lqg.feedback.gain, lqg.integral_gain])
    feedback = np.linalg.eigvals(np.asarray(whole.A) - np.asarray(whole.B) @ gain)
    A = np.asarray(model.A)
    filtering = np.linalg.eigvals(A - A @ np.asarray(lqg.filter_gain) @ MOTOR)
    wanted = np.abs(np.concatenate([feedback, filtering])).max()
    assert frozen_spectral_radii(plant, lqg, task)[0] == pytest.approx(wanted, abs=1e-9)


LOADS = {"load": (1.0, 0.5), "input gain": (0.8, 0.0), "both": (1.2, -0.3)}


@pytest.mark.slow
@pytest.mark.parametrize(("gain", "load"), LOADS.values(), ids=LOADS)
def test_neither_a_load_nor_a_wrong_input_gain_leaves_a_lag(
    model, plain_lqg, lqg, offset_free, gain, load
):
    """Tool and motor on a ramp, where plain LQG lags."""
    ramp = along(line([0.0], [1.0]), 1e-4 * np.arange(2000), DT, 1, at_rest=False)
    weaker = Sensed(with_input_gains(model, [gain]), lambda x: x[:2])
    machine = Disturbed(weaker, jnp.full((1, 1), load))

    def lag(controller):
        output = simulate(machine, controller, ramp).output
        return abs(float(output[-1, 0] - ramp.position[1999, 0]))

    assert lag(plain_lqg) > 1e-5
    assert lag(lqg) < 1e-8 and lag(offset_free) < 1e-8


def test_two_axes_are_each_on_their_own(two_flexible_axes):
    law = designed(zoh_model(two_flexible_axes, DT), axes=2)
    apart = np.kron(np.ones((1, 4)), np.ones((2, 2)) - np.eye(2)).astype(bool)
    assert np.abs(law.feedback.gain[apart]).max() < 1e-9 * np.abs(law.feedback.gain).max()


def test_at_its_limit_it_does_not_wind_up(model, plant, lqg):
    """A fifth of the current that the first moment asks for.

    A filter that knows the limit settles; else it swings for ever.
    """
    rest = along(line([0.0], [0.1]), np.zeros(1500), DT, 1, at_rest=True)
    machine = Saturated(plant, np.array([2.0]))
    start = model.initial_state(np.array([-0.02]), np.zeros(1))
    unaware = jax.device_get(simulate(machine, lqg, rest, start))
    aware = jax.device_get(simulate(machine, designed(model, limit=2.0), rest, start))
    assert np.abs(unaware.control).max() > 10.0 and np.abs(aware.control).max() == 2.0
    assert np.abs(unaware.output[-200:]).max() > 0.02
    assert aware.output.max() < 0.008 and np.abs(aware.output[-200:]).max() < 5e-4


def test_bad_input_is_named_of_integral_lqg(model, lqg):
    def controller(**changes):
        named = {
            "feedback": lqg.feedback,
            "integral_gain": lqg.integral_gain,
            "model": model,
            "filter_gain": lqg.filter_gain,
            "measured": MOTOR,
        }
        return IntegralLQG(**{**named, "sensors": motors(1), **changes})

    for changes, words in [
        (
            {"integral_gain": -lqg.integral_gain},
            r"^integral_gain: the loop is not stable: .* they are \[",
        ),
        ({"integral_gain": np.zeros((1, 2))}, r"^integral_gain: needs shape \(1, 1\)"),
        (
            {"filter_gain": np.zeros((4, 2))},
            r"^filter_gain: the observer is not stable: .* they are \[",
        ),
        ({"limit": 0.0}, "^limit: needs to be above zero"),
    ]:
        with pytest.raises(ValueError, match=words):
            controller(**changes)
    with pytest.raises(ValueError, match="^dt: "):
        lqg.initial_memory(in_time(line([0.0], [0.01]), PointToPoint(0.01, 0.1, 4.0), 1.5, 2e-3))
