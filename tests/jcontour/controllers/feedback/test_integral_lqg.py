import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.linalg import solve_discrete_are

from jcontour.analysis.stability import frozen_spectral_radii
from jcontour.controllers.feedback.integral_lqg import (
    IntegralLQG,
    integral_lq_gains,
    positions_of,
    with_integrals,
)
from jcontour.controllers.feedback.state_feedback import StateFeedback, lq_gain, moving_target
from jcontour.controllers.observers.kalman import (
    FilterObserver,
    OffsetFreeObserver,
    kalman_gain,
    offset_free_gain,
)
from jcontour.geometry.contours import line
from jcontour.linear.transformations import with_input_gains
from jcontour.motion.point_to_point import PointToPoint
from jcontour.motion.references import along, in_time
from jcontour.plants.flexible_axis.axis import AxisParameters, FlexibleAxis, thesis_axis
from jcontour.plants.flexible_axis.models import zoh_model
from jcontour.plants.friction import Friction
from jcontour.plants.wrappers.disturbances import Disturbed
from jcontour.plants.wrappers.encoders import Sensed
from jcontour.plants.wrappers.saturation import Saturated
from jcontour.sensors import motors
from jcontour.simulation.closed_loop import simulate

DT = 1e-3
NOISE = [1e-6, 1e-3]  # of an encoder, and of its difference
Q, Q_I, R = np.diag([1e7, 1e3, 1e7, 1.0]), np.array([[1e10]]), np.eye(1)


def pair():
    """Two different axes without dry friction and cogging."""
    drag = Friction(0.0, 0.0, 1.0, [250.9, 100.0])
    return AxisParameters(
        [39.62, 20.0],
        [0.38, 2.0],
        [2908.0, 9e3],
        [2.1, 30.0],
        [79.33, 60.0],
        drag,
        [[0.0]] * 2,
        [[0.0]] * 2,
        [0.1, 0.1],
    )


def designed(model, axes=1, limit=np.inf):
    measured, sensors = np.eye(4 * axes)[: 2 * axes], motors(axes)
    weights = (np.kron(Q, np.eye(axes)), np.kron(Q_I, np.eye(axes)), np.eye(axes))
    K, K_i = integral_lq_gains(model, positions_of(sensors, measured), *weights)
    L = kalman_gain(model, 0.05, np.repeat(NOISE, axes), measured)
    return IntegralLQG(
        StateFeedback(K, moving_target(model)), K_i, model, L, measured, sensors, limit
    )


MODEL = zoh_model(thesis_axis(), DT)
MOTOR = np.eye(4)[:2]
LQG = designed(MODEL)
MACHINE = Sensed(MODEL, lambda x: x[:2])


def test_gains_are_those_of_scipys_riccati_equation():
    A, B = np.asarray(MODEL.A), np.asarray(MODEL.B)
    A = np.block([[A, np.zeros((4, 1))], [DT * MOTOR[:1], np.ones((1, 1))]])
    B, weight = (
        np.vstack([B, np.zeros((1, 1))]),
        np.block([[Q, np.zeros((4, 1))], [np.zeros((1, 4)), Q_I]]),
    )
    P = solve_discrete_are(A, B, weight, R)
    wanted = np.linalg.solve(R + B.T @ P @ B, B.T @ P @ A)
    np.testing.assert_allclose(np.hstack([LQG.feedback.gain, LQG.integral_gain]), wanted, rtol=1e-7)


def test_poles_of_the_loop_are_those_of_the_feedback_and_of_the_filter():
    """Separation: the frozen loop of machine, filter and integral, against the two problems apart."""
    task = along(line([0.0], [0.1]), 1e-4 * np.arange(2), DT, 1, at_rest=False)
    whole = with_integrals(MODEL, MOTOR[:1])
    feedback = np.linalg.eigvals(
        whole.A - whole.B @ np.hstack([LQG.feedback.gain, LQG.integral_gain])
    )
    filtering = np.linalg.eigvals(MODEL.A - MODEL.A @ LQG.filter_gain @ MOTOR)
    wanted = np.abs(np.concatenate([feedback, filtering])).max()
    assert frozen_spectral_radii(MACHINE, LQG, task)[0] == pytest.approx(wanted, abs=1e-9)


LOADS = {"load": (1.0, 0.5), "input gain": (0.8, 0.0), "both": (1.2, -0.3)}
KALMAN = kalman_gain(MODEL, 0.05, NOISE, MOTOR)
FEEDBACK = StateFeedback(lq_gain(MODEL, Q, R), moving_target(MODEL))
OFFSET_FREE = OffsetFreeObserver(
    FEEDBACK, MODEL, offset_free_gain(MODEL, MOTOR, 0.05, 0.05, NOISE), MOTOR
)


@pytest.mark.parametrize(("gain", "load"), LOADS.values(), ids=LOADS)
def test_neither_a_load_nor_a_wrong_input_gain_leaves_a_lag(gain, load):
    """Tool and motor on a ramp, where plain LQG lags."""
    ramp = along(line([0.0], [1.0]), 1e-4 * np.arange(2000), DT, 1, at_rest=False)
    machine = Disturbed(
        Sensed(with_input_gains(MODEL, [gain]), lambda x: x[:2]), jnp.full((1, 1), load)
    )
    plain = FilterObserver(FEEDBACK, MODEL, KALMAN, measured=MOTOR)
    lags = [
        abs(float(simulate(machine, law, ramp).output[-1, 0] - ramp.position[1999, 0]))
        for law in (plain, LQG, OFFSET_FREE)
    ]
    assert lags[0] > 1e-5 and max(lags[1:]) < 1e-8


def test_two_axes_are_each_on_their_own():
    model = zoh_model(pair(), DT)
    law = designed(model, axes=2)
    task = in_time(line([0.0, 0.0], [0.03, -0.04]), PointToPoint(0.05, 0.1, 4.0), 1.8, DT)
    machine = Disturbed(FlexibleAxis(pair(), DT), jnp.array([[0.5, -0.2]]))
    run = simulate(machine, law, task)
    np.testing.assert_allclose(run.output[-1], [0.03, -0.04], rtol=0, atol=1e-6)
    apart = np.kron(np.ones((1, 4)), np.ones((2, 2)) - np.eye(2)).astype(bool)
    assert np.abs(law.feedback.gain[apart]).max() < 1e-9 * np.abs(law.feedback.gain).max()


def test_at_its_limit_it_does_not_wind_up():
    """A fifth of the current that the first moment asks for: told of the limit it settles, untold it swings for ever."""
    rest = along(line([0.0], [0.1]), np.zeros(1500), DT, 1, at_rest=True)
    machine, start = (
        Saturated(MACHINE, jnp.array([2.0])),
        MODEL.initial_state(jnp.array([-0.02]), jnp.zeros(1)),
    )
    unaware, aware = (
        simulate(machine, law, rest, start) for law in (LQG, designed(MODEL, limit=2.0))
    )
    assert np.abs(unaware.control).max() > 10.0 and np.abs(aware.control).max() == 2.0
    assert np.abs(unaware.output[-200:]).max() > 0.02
    assert aware.output.max() < 0.008 and np.abs(aware.output[-200:]).max() < 5e-4


def test_gradient_reaches_the_weights():
    task = in_time(line([0.0], [0.01]), PointToPoint(0.01, 0.1, 4.0), 0.2, DT)
    machine = Disturbed(MACHINE, jnp.full((1, 1), 0.5))

    def cost(logarithms):
        K, K_i = integral_lq_gains(
            MODEL, MOTOR[:1], Q, jnp.exp(logarithms[:1])[None], jnp.exp(logarithms[1:])[None]
        )
        law = IntegralLQG(
            StateFeedback(K, moving_target(MODEL)), K_i, MODEL, KALMAN, MOTOR, motors(1)
        )
        return 1e6 * jnp.mean((simulate(machine, law, task).output - task.position[:-1]) ** 2)

    at = np.log([1e10, 1.0])
    run, slope = jax.jit(cost), jax.jit(jax.grad(cost))(at)
    for i in range(2):
        step = 1e-5 * np.eye(2)[i]
        np.testing.assert_allclose(slope[i], (run(at + step) - run(at - step)) / 2e-5, rtol=1e-5)


def test_bad_input_is_named():
    def law(**changes):
        named = {
            "feedback": LQG.feedback,
            "integral_gain": LQG.integral_gain,
            "model": MODEL,
            "filter_gain": KALMAN,
            "measured": MOTOR,
        }
        return IntegralLQG(**{**named, "sensors": motors(1), **changes})

    for changes, words in [
        (
            {"integral_gain": -LQG.integral_gain},
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
            law(**changes)
    with pytest.raises(ValueError, match="^dt: "):
        LQG.initial_memory(in_time(line([0.0], [0.01]), PointToPoint(0.01, 0.1, 4.0), 1.5, 2e-3))
