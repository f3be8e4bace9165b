import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.linalg import expm

from jcontour.linear.plant import steady_motion
from jcontour.plants.gantry.gantry import EquationOfMotion
from jcontour.plants.gantry.motor_coordinates import MotorEncoders, motor_model, motor_schedule
from jcontour.plants.gantry.parameters import thesis_gantry, untwisted

DT, HEAD = 2e-3, -0.31


def test_model_is_the_derivative_of_the_equation_of_motion_in_the_motors_coordinates(odd_gantry):
    """By automatic differentiation and SciPy: unequal drives, an off-centre head."""
    rest, still = untwisted(odd_gantry, jnp.array([HEAD, 0.0]), jnp.zeros(2)), jnp.zeros(3)
    motion = EquationOfMotion.of(odd_gantry)

    def rates(state, control) -> jax.Array:
        return jnp.concatenate(
            [state[3:], jnp.stack(motion.acceleration(state[:3], state[3:], control))]
        )

    T = np.asarray(jax.jit(jax.jacfwd(MotorEncoders(odd_gantry)))(rest))
    A, B = map(np.asarray, jax.jit(jax.jacfwd(rates, (0, 1)))(rest, still))
    discrete = expm(DT * np.block([[A, B], [np.zeros((3, 9))]]))
    C = np.pad(np.asarray(jax.jit(jax.jacfwd(odd_gantry.tool))(rest[:3])), ((0, 0), (0, 3)))
    model = motor_model(odd_gantry, HEAD, DT)
    np.testing.assert_allclose(
        model.A, T @ discrete[:6, :6] @ np.linalg.inv(T), rtol=1e-9, atol=1e-11
    )
    np.testing.assert_allclose(model.B, T @ discrete[:6, 6:], rtol=1e-9, atol=1e-14)
    np.testing.assert_allclose(model.C, C @ np.linalg.inv(T), rtol=1e-12, atol=1e-14)


def test_steady_motion_is_what_the_encoders_read(odd_gantry):
    position, increment = jnp.array([0.2, -0.05]), jnp.array([3e-4, -5e-4])
    read = MotorEncoders(odd_gantry)(untwisted(odd_gantry, position, increment / DT))
    model = motor_model(odd_gantry, 0.2, DT)
    np.testing.assert_allclose(
        steady_motion(model).state(position, increment), read, rtol=0, atol=1e-15
    )
    np.testing.assert_allclose(model.output(read), position, rtol=0, atol=1e-15)


def test_points_outside_the_beam_are_refused(odd_gantry):
    with pytest.raises(
        ValueError, match=r"points: the head runs from -0.6 to 0.6 m along the beam, received 0.7 m"
    ):
        motor_schedule(odd_gantry, [0.0, 0.7], DT)
    with pytest.raises(ValueError, match="head: the head runs"):
        motor_model(odd_gantry, -0.61, DT)


def test_models_between_two_points_are_of_second_order():
    """Half the distance of the points, a quarter of the interpolation error."""
    p, middle = thesis_gantry(), 0.05
    wanted = motor_model(p, middle, DT).A

    def error(gap):
        schedule = motor_schedule(p, [middle - gap, middle + gap], DT)
        found = schedule.along(jnp.array([[middle, 0.0]])).A[0]
        return float(jnp.abs(found - wanted).max())

    assert error(0.1) / error(0.05) == pytest.approx(4.0, rel=0.1)
