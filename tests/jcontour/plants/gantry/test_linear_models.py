"""Currents for a straight beam, against the equation of motion."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.linalg import expm
from scipy.signal import cont2discrete, ss2tf

from jcontour._arrays import placed
from jcontour.linear.plant import steady_motion
from jcontour.plants.gantry import linear_models as models
from jcontour.plants.gantry.gantry import EquationOfMotion, Gantry, thesis_gantry, untwisted
from tests.reference_data import numbers_of

DT = 2e-3


def test_reference_models(reference_gantry):
    """Continuous and sampled, both parts; inputs and disturbances each in their columns."""
    for head, wanted in numbers_of("gantry/linear")["linear"].items():
        axis = models.X if head == "x_axis" else models.Y
        columns = (0,) if head == "x_axis" else (1, 2)
        model = models.control_oriented(reference_gantry, 0.3 if head == "x_axis" else float(head))
        for one, names in ((model, "ABE"), (model.sampled(DT), ("Ad", "Bd", "Ed"))):
            A, B, E = (np.asarray(matrix) for matrix in one)
            for found, name in (
                (A[np.ix_(axis, axis)], names[0]),
                (B[np.ix_(axis, columns)], names[1]),
                (E[np.ix_(axis, columns)], names[2]),
            ):
                scale = np.abs(wanted[name]).max()
                np.testing.assert_allclose(found, wanted[name], rtol=1e-10, atol=1e-13 * scale)


def test_reference_resonances(reference_gantry):
    for head, wanted in numbers_of("gantry/linear")["linear"].items():
        if head == "x_axis":
            continue
        for name, coupling in (
            ("as_printed_5.12", 0.0),
            ("full", reference_gantry.head_mass * float(head)),
        ):
            numerator, denominator = (
                np.roots(row)
                for row in models.drive_response(reference_gantry, float(head), coupling)
            )
            swinging = denominator[np.abs(denominator.imag) > 0]
            np.testing.assert_allclose(
                np.abs(numerator) / (2 * np.pi),
                wanted["i1_to_y1dot"][name]["antires_Hz"],
                rtol=1e-12,
            )
            np.testing.assert_allclose(
                np.abs(swinging) / (2 * np.pi), wanted["i1_to_y1dot"][name]["res_Hz"], rtol=1e-12
            )


def test_the_response_is_that_of_the_model(odd_gantry):
    """(5.12) with coupling and unequal drives against SciPy's transfer function."""
    head, coupling = 0.3, 17.0 * 0.3 - (13.0 - 31.0) * 0.6
    A, B, _ = (np.asarray(matrix) for matrix in models.control_oriented(odd_gantry, head))
    speed = [[0, 1, 0, -0.6]]
    numerator, denominator = ss2tf(
        A[np.ix_(models.Y, models.Y)], B[np.ix_(models.Y, (1,))], speed, [[0.0]]
    )
    s = 2j * np.pi * np.array([1.0, 10.0, 40.0, 90.0])
    ours = np.polyval(models.drive_response(odd_gantry, head, coupling)[0], s) / np.polyval(
        models.drive_response(odd_gantry, head, coupling)[1], s
    )
    np.testing.assert_allclose(
        ours, np.polyval(numerator[0], s) / np.polyval(denominator, s), rtol=1e-9
    )


def test_the_tangent_is_the_derivative_of_the_equation_of_motion(odd_gantry):
    motion, head = EquationOfMotion.of(odd_gantry), 0.25

    def rates(state, control):
        return jnp.concatenate(
            [state[3:], jnp.stack(motion.acceleration(state[:3], state[3:], control))]
        )

    A, B = jax.jacfwd(rates, argnums=(0, 1))(jnp.array([head, 0.1, 0, 0, 0, 0]), jnp.zeros(3))
    found = models.tangent(odd_gantry, head)
    np.testing.assert_allclose(found.A, A, rtol=1e-12, atol=1e-9)
    np.testing.assert_allclose(found.B, B, rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(
        found.E[3:], np.linalg.inv(motion.mass_matrix(jnp.array([head, 0, 0]))), rtol=1e-12
    )


def test_the_tangent_plant_follows_the_gantry_for_small_motions():
    p, head = thesis_gantry(), 0.4
    plant, model = Gantry(p, DT, substeps=40), models.tool_plant(p, head, DT)
    A, B, _, _, _ = cont2discrete(
        (*(np.asarray(m) for m in models.tangent(p, head)[:2]), np.eye(6), np.zeros((6, 3))), DT
    )
    np.testing.assert_allclose(model.A, A, rtol=1e-10, atol=1e-10)
    np.testing.assert_allclose(model.B, B, rtol=1e-9, atol=1e-15)
    off, control = 1e-6 * np.array([1.0, 2, 0.1, 3, -2, 1]), 1e-4 * np.array([1.0, -2, 3])
    state = np.asarray(plant.initial_state(np.array([head, 0.0]), np.zeros(2)))
    tool = jax.jit(lambda x, u: plant.output(plant.step(x, u)))(state + off, control)
    off[0] += head
    moved = jax.jit(lambda x, u: model.output(model.step(x, u)))(off, control)
    np.testing.assert_allclose(tool, moved, rtol=0, atol=1e-11)


def test_a_head_beyond_the_beam_is_named():
    wanted = r"^head: the head runs from -0.9 to 0.9 m along the beam, received 1 m"
    with pytest.raises(ValueError, match=wanted):
        models.control_oriented(thesis_gantry(), 1.0)
    with pytest.raises(ValueError, match="^dt:"):
        models.tool_plant(thesis_gantry(), 0.0, -1.0)


MOTOR_COORDINATES_DT, HEAD = 2e-3, -0.31


def test_model_is_the_derivative_of_the_equation_of_motion_in_the_motors_coordinates(odd_gantry):
    """By automatic differentiation and SciPy: unequal drives, an off-centre head."""
    rest, still = untwisted(odd_gantry, jnp.array([HEAD, 0.0]), jnp.zeros(2)), jnp.zeros(3)
    motion = EquationOfMotion.of(odd_gantry)

    def rates(state, control) -> jax.Array:
        return jnp.concatenate(
            [state[3:], jnp.stack(motion.acceleration(state[:3], state[3:], control))]
        )

    T = np.asarray(jax.jit(jax.jacfwd(models.MotorEncoders(odd_gantry)))(rest))
    A, B = map(np.asarray, jax.jit(jax.jacfwd(rates, (0, 1)))(rest, still))
    discrete = expm(MOTOR_COORDINATES_DT * np.block([[A, B], [np.zeros((3, 9))]]))
    C = np.pad(np.asarray(jax.jit(jax.jacfwd(odd_gantry.tool))(rest[:3])), ((0, 0), (0, 3)))
    model = models.motor_model(odd_gantry, HEAD, MOTOR_COORDINATES_DT)
    np.testing.assert_allclose(
        model.A, T @ discrete[:6, :6] @ np.linalg.inv(T), rtol=1e-9, atol=1e-11
    )
    np.testing.assert_allclose(model.B, T @ discrete[:6, 6:], rtol=1e-9, atol=1e-14)
    np.testing.assert_allclose(model.C, C @ np.linalg.inv(T), rtol=1e-12, atol=1e-14)


def test_steady_motion_is_what_the_encoders_read(odd_gantry):
    position, increment = jnp.array([0.2, -0.05]), jnp.array([3e-4, -5e-4])
    read = models.MotorEncoders(odd_gantry)(
        untwisted(odd_gantry, position, increment / MOTOR_COORDINATES_DT)
    )
    model = models.motor_model(odd_gantry, 0.2, MOTOR_COORDINATES_DT)
    np.testing.assert_allclose(
        steady_motion(model).state(position, increment), read, rtol=0, atol=1e-15
    )
    np.testing.assert_allclose(model.output(read), position, rtol=0, atol=1e-15)


def test_points_outside_the_beam_are_refused(odd_gantry):
    with pytest.raises(
        ValueError, match=r"points: the head runs from -0.6 to 0.6 m along the beam, received 0.7 m"
    ):
        models.motor_schedule(odd_gantry, [0.0, 0.7], MOTOR_COORDINATES_DT)
    with pytest.raises(ValueError, match="head: the head runs"):
        models.motor_model(odd_gantry, -0.61, MOTOR_COORDINATES_DT)


def test_models_between_two_points_are_of_second_order():
    """Half the distance of the points, a quarter of the interpolation error."""
    p, middle = thesis_gantry(), 0.05
    wanted = models.motor_model(p, middle, MOTOR_COORDINATES_DT).A

    def error(gap):
        schedule = models.motor_schedule(p, [middle - gap, middle + gap], MOTOR_COORDINATES_DT)
        found = schedule.along(jnp.array([[middle, 0.0]])).A[0]
        return float(jnp.abs(found - wanted).max())

    assert error(0.1) / error(0.05) == pytest.approx(4.0, rel=0.1)


def test_the_beam_stays_straight_and_the_tool_accelerates_as_wanted():
    p = thesis_gantry()
    position, speed = np.array([[0.3, -0.1]]), np.array([[0.2, -0.4]])
    acceleration = np.array([[1.5, -2.0]])
    (control,) = np.asarray(
        models.straight_beam_currents(p, *map(placed, (position, speed, acceleration)))
    )
    q = np.array([0.3, -0.1 + float(p.tool_offset), 0.0])
    v = np.array([0.2, -0.4, 0.0])
    found = eqx.filter_jit(EquationOfMotion.of(p).acceleration)(q, v, control)
    np.testing.assert_allclose(found, [1.5, -2.0, 0.0], atol=1e-12)


def test_a_steady_motion_takes_its_friction_and_rest_takes_nothing():
    p, dt = thesis_gantry(), 1e-2
    steps = np.concatenate([np.zeros(3), np.ones(5)])
    position = np.cumsum(steps)[:, None] * np.array([1e-3, 2e-3])
    found = np.asarray(models.currents_along(p, placed(position), dt))
    assert found.shape == (8, 3)
    np.testing.assert_allclose(found[0], 0.0, atol=1e-12)
    head = float(p.head_viscous * 0.1 / p.head_constant)
    beam = float(p.drive_viscous * 0.2 / p.drive_constant)
    np.testing.assert_allclose(found[5], [head, beam, beam], rtol=1e-9)


def test_the_head_stays_on_the_beam():
    none = placed(np.zeros((1, 2)))
    with pytest.raises(ValueError, match="position: the head runs from"):
        models.straight_beam_currents(thesis_gantry(), placed(np.array([[1.0, 0.0]])), none, none)


DISTURBANCES_HEAD = 0.25
LOW = np.array([0.2, -0.1, -2.5e-3, -0.3, -0.3, -0.05, -10, -10, -10])
HIGH = np.array([0.3, 0.1, 2.5e-3, 0.3, 0.3, 0.05, 10, 10, 10])


acceleration, disturbed = jax.jit(EquationOfMotion.acceleration), jax.jit(models.disturbances)


def drawn(seed):
    return np.random.default_rng(seed).uniform(LOW, HIGH)


@pytest.mark.parametrize("machine", ["reference_gantry", "odd_gantry"])
def test_the_linear_model_is_exact_under_them(machine, request):
    """dx/dt = A x + B u + E d of (5.13)-(5.15) gives the accelerations of (5.7)-(5.9)."""
    p = request.getfixturevalue(machine)
    A, B, E = (np.asarray(matrix) for matrix in models.control_oriented(p, DISTURBANCES_HEAD))
    motion = EquationOfMotion.of(p)
    for seed in range(10):
        z = drawn(seed)
        wanted = np.array(acceleration(motion, *np.split(z, 3)))
        d = np.asarray(disturbed(p, DISTURBANCES_HEAD, z[:6], z[6:]))
        found = (A @ z[:6] + B @ z[6:] + E @ d)[3:]
        np.testing.assert_allclose(found, wanted, rtol=1e-10, atol=1e-10 * np.abs(wanted).max())
    assert set(models.X) | set(models.Y) == set(range(6))


def test_the_thesiss_terms(reference_gantry):
    """Section 5.3.1 term by term, with our corrections.

    M_d = 0, the terms in x_h - xbar, and the springs between drives and guides.
    """
    p = reference_gantry
    M_e, d, L, k_s = (
        float(value) for value in (p.head_mass, p.tool_offset, p.half_span, p.lateral_stiffness)
    )
    for seed in range(10):
        z = drawn(seed)
        (x, _, theta), (dx, _, turn), u = z[:3], z[3:6], z[6:]
        rates = acceleration(EquationOfMotion.of(p), *np.split(z, 3))
        ddx, ddy, ddturn = (float(a) for a in rates)
        s, c, off = np.sin(theta), np.cos(theta), x - DISTURBANCES_HEAD
        first = -M_e * (
            s * ddx
            + d * s * ddturn
            - x * s * turn**2
            + 2 * dx * c * turn
            + d * turn**2 * c
            + (x * c - DISTURBANCES_HEAD) * ddturn
        )
        drives = float(p.drive_constant) * (u[2] - u[1]) - 2 * float(p.drive_viscous) * L * c * turn
        second = -M_e * (
            d * ddx
            + (d * s + x * c - DISTURBANCES_HEAD) * ddy
            + 2 * turn * dx * x
            + (2 * DISTURBANCES_HEAD * off + off**2) * ddturn
        )
        second += (
            -2 * L**2 * k_s * s * (1 - c)
            + L * c * drives
            - L * (drives + 2 * float(p.drive_viscous) * L * (c - 1) * turn)
        )
        along = x * turn**2 - d * ddturn - s * ddy
        found = np.asarray(disturbed(p, DISTURBANCES_HEAD, z[:6], u))
        np.testing.assert_allclose(
            found, [along, first, second], rtol=1e-8, atol=1e-8 * np.abs(second)
        )
