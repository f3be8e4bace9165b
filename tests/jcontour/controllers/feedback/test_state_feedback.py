import jax
import numpy as np
import pytest
from scipy.linalg import solve_discrete_are

from jcontour.controllers.feedback.state_feedback import (
    StateFeedback,
    lq_gain,
    moving_target,
    quasi_steady_target,
)
from jcontour.geometry.contours import line
from jcontour.linear.plant import LinearPlant
from jcontour.motion.references import along
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
