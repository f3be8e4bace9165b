import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from jcontour.plants.flexible_axis.axis import FlexibleAxis, Motion, SmoothFlexibleAxis, thesis_axis
from jcontour.plants.flexible_axis.linear_motor import DrivenAxis, LinearMotor, thesis_motor
from jcontour.plants.friction import Friction

PERIOD, DT = 1e-4, 1e-3
R, L, K_E, TAU = 12.51, 10.7e-3, 52.89, 0.0875


def frictionless():
    none = jnp.zeros((1, 3))
    replaced = (Friction(0.0, 0.0, 1.0, 0.0), none, none)
    return eqx.tree_at(
        lambda p: (p.friction, p.cogging_sine, p.cogging_cosine), thesis_axis(), replaced
    )


def driven(axis=FlexibleAxis, parameters=None, period=PERIOD, dt=DT, **options):
    return DrivenAxis(
        axis(thesis_axis() if parameters is None else parameters, period),
        thesis_motor(),
        dt,
        **options,
    )


def advance(motor, *arguments):
    return jax.device_get(jax.jit(LinearMotor.advance, static_argnums=4)(motor, *arguments))


def test_the_winding_follows_its_equations():
    """(3.3), (3.4) written out in real numbers, against an adaptive integrator."""
    speed, voltage, start, h = 0.7, np.array([-6.0, 60.0]), np.array([0.5, -2.0]), 3e-4
    w = np.pi * speed / TAU

    def rates(_, x):
        d, q = x[:2]
        return [
            (voltage[0] - R * d + w * L * q) / L,
            (voltage[1] - R * q - w * L * d - K_E * speed) / L,
            d,
            q,
        ]

    exact = solve_ivp(rates, (0, h), [*start, 0, 0], method="DOP853", rtol=1e-12, atol=1e-14).y[
        :, -1
    ]
    after, mean = advance(
        thesis_motor(),
        np.array([start[0] + 1j * start[1]]),
        np.array([voltage[0] + 1j * voltage[1]]),
        np.array([speed]),
        h,
    )
    np.testing.assert_allclose([after[0].real, after[0].imag], exact[:2], rtol=1e-10)
    np.testing.assert_allclose([mean[0].real, mean[0].imag], exact[2:] / h, rtol=1e-10)


def test_force_is_what_the_voltage_pays_for():
    """3/2 Re(u conj i) over a period: copper, field and k_t i_q v, nothing else."""
    motor, speed, h = thesis_motor(), np.array([0.4]), 1e-3
    rng = np.random.default_rng(1)
    current, voltage = (
        np.array([a + 1j * b]) for a, b in rng.normal(size=(2, 2)) * np.array([[2.0], [30.0]])
    )
    parts, spent, copper, work, start = 100, 0.0, 0.0, 0.0, current
    for _ in range(parts):
        after, mean = advance(motor, current, voltage, speed, h / parts)
        middle = advance(motor, current, voltage, speed, h / parts / 2)[0]
        squares = (np.abs(current) ** 2 + 4 * np.abs(middle) ** 2 + np.abs(after) ** 2) / 6
        spent += 1.5 * (voltage * mean.conj()).real * h / parts
        copper += 1.5 * R * squares * h / parts
        work += np.asarray(motor.force_constant) * mean.imag * speed * h / parts
        current = after
    field = 0.75 * L * (np.abs(current) ** 2 - np.abs(start) ** 2)
    np.testing.assert_allclose(spent, copper + work + field, rtol=1e-9)


def test_the_current_follows_its_command_like_a_first_order_lag():
    """On a blocked axis i/i* = bandwidth / (s + bandwidth): the PI cancels the winding."""
    bandwidth = 500.0
    blocked = eqx.tree_at(lambda p: p.friction.coulomb, thesis_axis(), jnp.array([1e4]))

    @eqx.filter_jit
    def answer(plant, steps):
        start = plant.initial_state(np.zeros(1), np.zeros(1))
        return jax.lax.fori_loop(0, steps, lambda _, s: plant.step(s, jnp.array([0.4])), start)

    for period, tolerance in (
        (5e-5, 0.02),
        (1e-5, 0.004),
    ):  # the held voltage is a delay of half a period
        plant = DrivenAxis(
            FlexibleAxis(blocked, period, substeps=1), thesis_motor(), period, bandwidth
        )
        state = jax.device_get(answer(plant, round(2e-3 / period)))
        np.testing.assert_allclose(
            state.current[0], [0, 0.4 * (1 - np.exp(-bandwidth * 2e-3))], rtol=tolerance, atol=1e-12
        )
    settled = jax.device_get(answer(plant, 10_000))
    np.testing.assert_allclose(settled.current[0], [0, 0.4], rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(settled.voltage[0], [0, 0.4 * R], rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("kind", [FlexibleAxis, SmoothFlexibleAxis])
def test_coupled_to_the_axis_against_an_adaptive_integrator(kind):
    """Ten periods, the voltage of each taken from the plant, all of (3.1)-(3.4) in one system."""
    plant = driven(kind, frictionless(), period=5e-5, dt=5e-5)
    start = plant.initial_state(np.zeros(1), np.zeros(1))
    moving = Motion(*(np.array([value]) for value in (0.0, 0.3, 1e-3, 0.25)))
    axis = (
        moving
        if kind is SmoothFlexibleAxis
        else start.axis._replace(motion=moving, mode=np.array([1]))
    )
    state, x = start._replace(axis=axis), np.array([0.0, 0.3, 1e-3, 0.25, 0.0, 0.0])
    step = eqx.filter_jit(plant.step)
    for _ in range(10):
        state = step(state, np.array([2.0]))
        u = np.asarray(state.voltage)[0]

        def rates(_, x, u=u):
            w, link = np.pi * x[1] / TAU, 2908.0 * (x[0] - x[2]) + 2.1 * (x[1] - x[3])
            return [
                x[1],
                (79.33 * x[5] - link) / 39.62,
                x[3],
                link / 0.38,
                (u[0] - R * x[4] + w * L * x[5]) / L,
                (u[1] - R * x[5] - w * L * x[4] - K_E * x[1]) / L,
            ]

        x = solve_ivp(rates, (0, 5e-5), x, method="DOP853", rtol=1e-12, atol=1e-15).y[:, -1]
    motion = state.axis if kind is SmoothFlexibleAxis else state.axis.motion
    np.testing.assert_allclose(np.concatenate(motion), x[:4], rtol=1e-7, atol=1e-9)
    np.testing.assert_allclose(np.asarray(state.current)[0], x[4:], rtol=1e-6, atol=1e-7)


def test_a_fast_current_loop_is_nearly_ideal():
    """The end effectors of both plants agree within 1 % of the way after 0.2 s."""
    ideal, real = FlexibleAxis(thesis_axis(), DT), driven()

    def end(plant):
        pulse = jnp.where(jnp.arange(200) < 100, 4.0, -1.0)[:, None]
        start = plant.initial_state(np.zeros(1), np.zeros(1))
        return plant.output(jax.lax.scan(lambda s, u: (plant.step(s, u), None), start, pulse)[0])

    wanted, found = (float(eqx.filter_jit(end)(plant)[0]) for plant in (ideal, real))
    assert wanted > 5e-3 and found != wanted
    np.testing.assert_allclose(found, wanted, rtol=0.01)


def test_at_a_steady_speed_the_voltage_is_that_of_the_winding():
    """u = R i + j (w L i + k_e v): what holds the current, d and q, at 0.4 m/s is known ahead."""
    plant, speed, current = driven(parameters=frictionless()), 0.4, np.array([[0.3, 0.4]])
    state = plant.initial_state(np.zeros(1), np.full(1, speed * DT))
    state = state._replace(current=jnp.asarray(current), integral=jnp.asarray(R * current))
    after = eqx.filter_jit(plant._period)(state, np.array([0.4]))
    d, q = current[0]
    w = np.pi * speed / TAU
    proportional = plant.bandwidth * L * np.array([-d, 0.0])  # the command has no d
    integral = R * current[0] + PERIOD * plant.bandwidth * R * np.array([-d, 0.0])
    ahead = np.array([-w * L * q, w * L * d + K_E * speed])
    np.testing.assert_allclose(
        np.asarray(after.voltage)[0], ahead + proportional + integral, rtol=1e-12
    )


def test_voltage_limit_and_its_windup():
    plant = driven(voltage_limit=20.0)
    run = eqx.filter_jit(
        lambda state, u: jax.lax.fori_loop(0, 100, lambda _, s: plant.step(s, u), state)
    )
    state = run(plant.initial_state(np.zeros(1), np.zeros(1)), np.array([5.0]))
    assert np.linalg.norm(state.voltage) == pytest.approx(20.0)
    assert np.abs(state.integral).max() < 5.0 * R
    free = driven()
    after = eqx.filter_jit(free.step)(free.initial_state(np.zeros(1), np.zeros(1)), np.array([5.0]))
    assert np.asarray(after.voltage)[0, 1] > 20.0


@pytest.mark.parametrize(
    "name", ["resistance", "inductance", "back_emf", "pole_pitch", "pole_pairs"]
)
def test_bad_windings_are_named(name):
    named = {
        "resistance": R,
        "inductance": L,
        "back_emf": K_E,
        "pole_pitch": TAU,
        "pole_pairs": 1.0,
    }
    with pytest.raises(ValueError, match=f"^{name}:"):
        LinearMotor(**(named | {name: -1.0}))


def test_bad_drives_are_named():
    with pytest.raises(ValueError, match="^dt: the period of the drive, 0.0003 s, needs to divide"):
        DrivenAxis(FlexibleAxis(thesis_axis(), 3e-4, substeps=6), thesis_motor(), DT)
    with pytest.raises(ValueError, match="^bandwidth"):
        driven(bandwidth=2e4)
    with pytest.raises(ValueError, match="^voltage_limit"):
        driven(voltage_limit=0.0)
    with pytest.raises(ValueError, match="^force_constant"):
        DrivenAxis(FlexibleAxis(thesis_axis(), PERIOD), LinearMotor(R, L, 40.0, TAU), DT)
