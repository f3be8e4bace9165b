import jax
import numpy as np

from jcontour._arrays import placed
from jcontour.plants.gantry.feedback_linearisation import (
    EncoderLinearisation,
    coupling_currents,
    linearising_currents,
    motor_currents,
    uncoupled_acceleration,
)
from jcontour.plants.gantry.gantry import EquationOfMotion
from jcontour.plants.gantry.linear_models import MotorEncoders, control_oriented

HEAD = 0.25
LOW = np.array([0.15, -0.1, -0.05, -0.5, -0.5, -0.6, -10, -10, -10])
HIGH = -LOW * [
    -7 / 3,
    1,
    1,
    1,
    1,
    1,
    1,
    1,
    1,
]  # head from 0.15 to 0.35 m, angles and rates far beyond a machine's: terms stand out


def drawn(seed):
    z = np.random.default_rng(seed).uniform(LOW, HIGH)
    return z[:6], z[6:]


def numbers(p):
    return {name: float(value) for name, value in vars(p).items()}


rates = jax.jit(EquationOfMotion.acceleration)
linearising = jax.jit(linearising_currents)
coupling = jax.jit(coupling_currents)
uncoupled = jax.jit(uncoupled_acceleration)


def moved(p, state, control):
    return np.array(rates(EquationOfMotion.of(p), state[:3], state[3:], control))


def brackets(p, state, acceleration):
    """Those of (5.30), (5.32), (5.34) as the thesis prints them."""
    (x, _, th), (dx, _, w), (ddx, ddy, ddth) = (
        np.asarray(state[:3]),
        np.asarray(state[3:]),
        np.asarray(acceleration),
    )
    d, s, c = float(p.tool_offset), np.sin(th), np.cos(th)
    along = -x * w**2 + d * ddth + ddy * s
    across = s * ddx + d * s * ddth - x * s * w**2 + 2 * dx * c * w + d * w**2 * c
    return np.array([along, across, d * ddx + d * s * ddy + 2 * w * dx * x])


def dropped(p, state, control, acceleration):
    """Terms beside the brackets that the linear model lacks, as forces on its right side.

    `control` is the whole current.
    """
    n, (x, _, th), (_, _, w) = numbers(p), np.asarray(state[:3]), np.asarray(state[3:])
    less, imbalance, L = (
        1 - np.cos(th),
        (n["drive_mass_1"] - n["drive_mass_2"]) * n["half_span"],
        n["half_span"],
    )
    m = n["head_mass"] * x - imbalance
    across = less * m * acceleration[2] - imbalance * np.sin(th) * w**2
    turning = less * m * acceleration[1] - 2 * n["lateral_stiffness"] * L**2 * np.sin(th) * less
    turning -= less * n["drive_constant"] * L * (control[2] - control[1])
    turning += 2 * n["drive_viscous"] * L**2 * w * np.sin(th) ** 2
    return np.array([0.0, across, turning])


def test_currents_are_those_of_the_thesis(odd_gantry):
    n = numbers(odd_gantry)
    constants = np.array(
        [n["head_constant"], n["drive_constant"], n["drive_constant"] * n["half_span"]]
    )
    for seed in range(5):
        state, acceleration = drawn(seed)
        found = coupling(odd_gantry, state[:3], state[3:], tuple(acceleration))
        np.testing.assert_allclose(
            found,
            n["head_mass"] * brackets(odd_gantry, state, acceleration) / constants,
            rtol=1e-12,
            atol=1e-13,
        )


def test_motors_share_sum_and_difference():
    i_x, i_1, i_2 = np.asarray(motor_currents(placed(np.array([7.0, 3.0, -5.0]))))
    assert (i_x, i_1 + i_2, i_2 - i_1) == (7.0, 3.0, -5.0)


def test_accelerations_are_those_of_the_control_oriented_model(odd_gantry):
    for seed in range(5):
        state, control = drawn(seed)
        A, B, _ = (np.asarray(matrix) for matrix in control_oriented(odd_gantry, state[0]))
        found = uncoupled(odd_gantry, state[:3], state[3:], control)
        np.testing.assert_allclose(found, (A @ state + B @ control)[3:], rtol=1e-10, atol=1e-9)


def test_a_plant_of_the_nominal_parameters_moves_as_the_model_but_for_what_is_dropped(odd_gantry):
    """M (q'' - a) is exactly the sum of the terms that the module's text drops.

    The angles are large enough to see it; uncompensated it is far more.
    """
    motion = EquationOfMotion.of(odd_gantry)
    for seed in range(10):
        state, control = drawn(seed)
        whole = control + linearising(odd_gantry, state, control)
        model = np.array(uncoupled(odd_gantry, state[:3], state[3:], control))
        mass = np.asarray(motion.mass_matrix(placed(state[:3])))
        off = mass @ (moved(odd_gantry, state, whole) - model)
        wanted = dropped(odd_gantry, state, np.asarray(whole), model)
        np.testing.assert_allclose(off, wanted, rtol=1e-8, atol=1e-8 * np.abs(wanted).max())


def test_encoders_tell_as_much_as_the_state(odd_gantry):
    state, control = drawn(0)
    encoders = MotorEncoders(odd_gantry)
    np.testing.assert_allclose(encoders.state(encoders(placed(state))), state, rtol=1e-12)
    found = EncoderLinearisation(odd_gantry)(encoders(placed(state)), placed(control))
    np.testing.assert_allclose(found, linearising(odd_gantry, state, control), rtol=1e-10)
