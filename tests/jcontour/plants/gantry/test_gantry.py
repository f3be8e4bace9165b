import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.plants.encoders import Sensed
from jcontour.plants.friction import runge_kutta
from jcontour.plants.gantry.gantry import (
    EquationOfMotion,
    Gantry,
    GantryParameters,
    check_on_beam,
    thesis_gantry,
)
from tests.reference_data import numbers_of

DT = 2e-3


def drawn(seed):
    """A state q, q' and currents of working size, the twist far beyond it."""
    random = np.random.default_rng(seed)
    q = random.uniform([-0.8, -1, -0.1], [0.8, 1, 0.1])
    return q, random.uniform(-1, 1, 3), random.uniform(-10, 10, 3)


def test_reference_samples(reference_gantry):
    motion, plant = EquationOfMotion.of(reference_gantry), Gantry(reference_gantry, 2.5e-4)

    @jax.jit
    def quantities(q, v, u):
        state = jnp.concatenate([q, v])
        equation = (
            motion.mass_matrix(q),
            motion.bias(q, v),
            motion.forces(q, v, u),
            motion.acceleration(q, v, u),
        )
        return (
            *equation,
            sum(lagrangian(reference_gantry, q, v)),
            plant.output(state),
            plant.step(state, u),
        )

    for sample in numbers_of("gantry/samples")["samples"]:
        *found, after = quantities(*(np.array(sample[key]) for key in ("q", "qd", "u")))
        for value, key in zip(found, ("M", "bias", "Q", "qdd", "energy", "tool"), strict=True):
            np.testing.assert_allclose(value, sample[key], rtol=1e-13)
        np.testing.assert_allclose(after, sample["rk4_step_0p25ms"], rtol=0, atol=1e-15)


def lagrangian(p, q, v):
    """K and P of (5.1)-(5.3) from the positions of the parts."""

    def parts(q):
        x, y, theta = q
        sine, cosine, L, d = jnp.sin(theta), jnp.cos(theta), p.half_span, p.tool_offset
        first, second = (
            jnp.stack([-L * cosine - p.joint_length, y - L * sine]),
            jnp.stack([L * cosine + p.joint_length, y + L * sine]),
        )
        return (
            first,
            second,
            jnp.stack([0 * y, y]),
            jnp.stack([x * cosine + d * sine, y + x * sine - d * cosine]),
        )

    masses = (p.drive_mass_1, p.drive_mass_2, p.beam_mass, p.head_mass)
    kinetic = sum(
        m * speed @ speed / 2
        for m, speed in zip(masses, jax.jvp(parts, (q,), (v,))[1], strict=True)
    )
    inertia = p.beam_mass * ((2 * p.half_span) ** 2 + (2 * p.half_width) ** 2) / 12
    springs = (
        p.joint_stiffness * q[2] ** 2
        + p.lateral_stiffness * p.half_span**2 * (1 - jnp.cos(q[2])) ** 2
    )
    return kinetic + inertia * v[2] ** 2 / 2, springs


@pytest.mark.parametrize("machine", ["reference_gantry", "odd_gantry"])
def test_the_closed_form_is_that_of_the_energies(machine, request):
    """Lagrange's equation by automatic differentiation.

    With the virtual work of the three motors and their friction.
    """
    p = request.getfixturevalue(machine)
    motion = EquationOfMotion.of(p)

    @jax.jit
    def derived(q, v, u):
        def momentum(q):
            return jax.grad(lambda v: lagrangian(p, q, v)[0])(v)

        mass = jax.hessian(lambda v: lagrangian(p, q, v)[0])(v)
        gradient = jax.grad(lambda q: lagrangian(p, q, v)[0] - lagrangian(p, q, v)[1])(q)
        bias = jax.jvp(momentum, (q,), (v,))[1] - gradient
        motors, speeds = jax.jvp(lambda q: p.motors(jnp.concatenate([q, v]))[:3], (q,), (v,))
        constants = jnp.stack([p.head_constant, p.drive_constant, p.drive_constant])
        pushes = (
            constants * u - jnp.stack([p.head_viscous, p.drive_viscous, p.drive_viscous]) * speeds
        )
        work = jax.vjp(lambda q: p.motors(jnp.concatenate([q, v]))[:3], q)[1](pushes)[0]
        return mass, bias, work

    @jax.jit
    def closed_form(q, v, u):
        return (
            motion.mass_matrix(q),
            motion.bias(q, v),
            motion.forces(q, v, u),
            motion.acceleration(q, v, u),
        )

    for seed in range(20):
        mass, bias, work = jax.device_get(derived(*drawn(seed)))
        found = closed_form(*drawn(seed))
        for value, wanted in zip(
            found, (mass, bias, work, np.linalg.solve(mass, work - bias)), strict=True
        ):
            np.testing.assert_allclose(value, wanted, rtol=1e-11)


def test_the_beam_alone_obeys_its_two_lines(odd_gantry):
    """(5.8), (5.9) under any x_h'': the head's line is somebody else's."""
    motion = EquationOfMotion.of(odd_gantry)
    acceleration, of_beam = (
        eqx.filter_jit(motion.acceleration),
        eqx.filter_jit(motion.beam_acceleration),
    )

    @jax.jit
    def lines(q, v, u, along):
        whole = jnp.stack([along, *motion.beam_acceleration(q, v, u, along)])
        forces = jnp.stack(motion.forces(q, v, u))
        return motion.mass_matrix(q) @ whole + jnp.stack(motion.bias(q, v)) - forces

    for seed in range(10):
        q, v, u = drawn(seed)
        along = np.random.default_rng(seed).normal()
        np.testing.assert_allclose(np.asarray(lines(q, v, u, along))[1:], 0, atol=1e-10)
        free = acceleration(q, v, u)
        np.testing.assert_allclose(of_beam(q, v, u, free[0]), free[1:], rtol=1e-10)


def test_energy_changes_by_the_work_of_the_motors_and_their_friction(odd_gantry):
    """The work is one more state under the same integrator; currents switch at every sample."""
    plant, motion = Gantry(odd_gantry, 1e-3, substeps=100), EquationOfMotion.of(odd_gantry)
    currents = np.random.default_rng(3).uniform(-8, 8, (50, 3))
    start = np.array([0.3, -0.2, 0.004, 0.2, -0.1, 0.05])

    def energy(q, v):
        return sum(lagrangian(odd_gantry, q, v))

    def sample(carry, u):
        def rates(extended):
            q, v = extended[:3], extended[3:6]
            power = sum(
                force * speed for force, speed in zip(motion.forces(q, v, u), v, strict=True)
            )
            return jnp.stack([*v, *motion.acceleration(q, v, u), power])

        extended, alone = carry
        extended = jax.lax.fori_loop(0, 100, lambda _, x: runge_kutta(rates, x, 1e-5), extended)
        return (extended, plant.step(alone, u)), energy(extended[:3], extended[3:6]) - extended[6]

    begin = (np.append(start, 0.0), start)
    (extended, alone), balance = jax.device_get(
        jax.jit(lambda: jax.lax.scan(sample, begin, currents))()
    )
    np.testing.assert_allclose(extended[:6], alone, rtol=1e-12, atol=1e-14)
    first = float(energy(start[:3], start[3:]))
    assert abs(extended[6]) > 0.1 * first
    np.testing.assert_allclose(balance, first, rtol=1e-9)


def test_reference_closed_loop(gantry_path, gantry_loop, reference_gantry):
    data, plant = numbers_of("gantry/closed_loop"), Gantry(reference_gantry, DT)
    position, velocity, on_circle = gantry_path
    start = plant.initial_state(position[0], np.zeros(2))
    run = jax.jit(lambda: gantry_loop(plant, data["controller"], position, velocity, start))
    final, states, controls, tools = jax.device_get(run())
    for sample in data["closed_loop"]["samples"]:
        k = sample["k"]
        np.testing.assert_allclose(states[k], sample["x"], rtol=0, atol=1e-11)
        np.testing.assert_allclose(controls[k], sample["u"], rtol=0, atol=1e-8)
        np.testing.assert_allclose(tools[k], sample["tool"], rtol=0, atol=1e-11)
    np.testing.assert_allclose(final, data["closed_loop"]["final_state"], rtol=0, atol=1e-11)
    error = np.where(
        on_circle, np.abs(np.linalg.norm(tools, axis=1) - 0.08), np.abs(tools[:, 0] - 0.08)
    )
    np.testing.assert_allclose(error.max(), data["closed_loop"]["max_contour"], rtol=1e-9)
    np.testing.assert_allclose(
        np.sqrt(np.mean(error**2)), data["closed_loop"]["rms_contour"], rtol=1e-9
    )


def test_it_starts_in_steady_motion():
    """Under currents that balance friction the tool goes on and the beam stays straight."""
    p = thesis_gantry()
    plant, increment = Gantry(p, DT), np.array([2e-4, -1e-4])
    state = plant.initial_state(np.array([0.3, 0.1]), increment)
    step, output = eqx.filter_jit(plant.step), eqx.filter_jit(plant.output)
    place = np.asarray(output(state))
    np.testing.assert_allclose(place, [0.3, 0.1], rtol=1e-15)
    along, across = (
        float(b * v / (DT * k)) for b, v, k in zip((200, 200), increment, (60, 60), strict=True)
    )
    after = step(state, np.array([along, across, across]))
    np.testing.assert_allclose(output(after), place + increment, rtol=0, atol=1e-12)
    assert abs(np.asarray(after)[2]) < 1e-15


def test_bad_sample_periods_are_named():
    with pytest.raises(ValueError, match="does not divide the sample period"):
        Gantry(thesis_gantry(), 1.1e-3)
    with pytest.raises(ValueError, match="^dt:"):
        Gantry(thesis_gantry(), 0.0)
    assert Gantry(thesis_gantry(), 1.1e-3, substeps=4).substeps == 4


def test_the_thesis_gantry_is_that_of_the_reference_data(reference_gantry):
    for found, wanted in zip(
        jax.tree.leaves(thesis_gantry()), jax.tree.leaves(reference_gantry), strict=True
    ):
        np.testing.assert_allclose(found, wanted, rtol=1e-14)


def test_the_printed_anti_resonances():
    """|zero| of (5.12) at both head positions."""
    p = thesis_gantry()
    for head, hertz in ((0.0, 47.0), (-0.66, 45.0)):
        zeros = np.roots(
            [
                p.inertia(head) + p.half_span**2 * p.total_mass,
                4 * p.half_span**2 * p.drive_viscous,
                2 * p.joint_stiffness,
            ]
        )
        np.testing.assert_allclose(np.abs(zeros) / (2 * np.pi), hertz, rtol=1e-12)


def test_motors_stand_where_the_joints_are(odd_gantry):
    """Speeds by the chain rule, the twist from the two drives."""
    q, v = np.array([0.2, -0.4, 0.03]), np.array([0.5, -0.2, 0.7])
    found = np.asarray(odd_gantry.motors(np.concatenate([q, v])))

    @jax.jit
    def positions_and_speeds(q, v):
        def positions(q):
            return jnp.stack([q[0], q[1] - 0.6 * jnp.sin(q[2]), q[1] + 0.6 * jnp.sin(q[2])])

        return jax.jvp(positions, (q,), (v,))

    np.testing.assert_allclose(found, np.concatenate(positions_and_speeds(q, v)), rtol=1e-14)
    np.testing.assert_allclose(np.arcsin((found[2] - found[1]) / 1.2), 0.03, rtol=1e-13)
    sensed = Sensed(Gantry(odd_gantry, 1e-3), odd_gantry.motors)
    np.testing.assert_array_equal(sensed.measure(np.concatenate([q, v])), found)


@pytest.mark.parametrize(
    "name",
    [
        "drive_mass_1",
        "beam_mass",
        "head_mass",
        "half_span",
        "drive_constant",
        "head_viscous",
        "joint_stiffness",
    ],
)
def test_parameters_that_no_machine_has_are_named(name):
    numbers = {key: float(value) for key, value in vars(thesis_gantry()).items()}
    for value in (-1.0, np.nan):
        with pytest.raises(ValueError, match=f"^{name}: needs"):
            GantryParameters(**{**numbers, name: value})
    with pytest.raises(ValueError, match="^head_mass: .* above zero"):
        GantryParameters(**{**numbers, "head_mass": 0.0})


def test_a_head_outside_the_beam_is_refused():
    with pytest.raises(
        ValueError,
        match=r"^position: the head runs from -0.9 to 0.9 m along the beam, received 1.1 m",
    ):
        Gantry(thesis_gantry(), 2e-3).initial_state(np.array([1.1, 0.0]), np.zeros(2))
    with pytest.raises(ValueError, match="^path: .* -1"):
        check_on_beam("path", np.array([0.1, -1.0, 0.2]), thesis_gantry())


def test_coordinates_are_those_of_the_motors(odd_gantry):
    """Far beyond the twist of any machine, there and back."""
    state = jnp.array([0.2, -0.4, 0.3, 0.5, -0.2, 1.5])
    np.testing.assert_allclose(odd_gantry.coordinates(odd_gantry.motors(state)), state, rtol=1e-14)
