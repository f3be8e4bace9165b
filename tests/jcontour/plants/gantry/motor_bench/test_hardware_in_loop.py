import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.plants.friction import Friction
from jcontour.plants.gantry.gantry import EquationOfMotion, Gantry
from jcontour.plants.gantry.motor_bench.back_to_back_motors import BackToBackMotors, servo_bench
from jcontour.plants.gantry.motor_bench.hardware_in_loop import Emulated, HardwareInLoop
from jcontour.plants.gantry.parameters import thesis_gantry

DT = 2e-3
M_A, B_A, K_A = 0.05, 0.3, 0.5  # [kg m], [N s], [N m/A]
F_C, F_S, V_S = 0.02, 0.01, 1.0  # [N m], [N m], [rad/s]
RADIUS = 0.02


def bench(coulomb=F_C, stribeck=F_S, viscous=B_A):
    friction = Friction(coulomb, stribeck, V_S, viscous * RADIUS)
    return BackToBackMotors(
        inertia=M_A * RADIUS, radius=RADIUS, torque_constant=K_A, friction=friction
    )


def accelerations(p, x, u):
    """q'' of the gantry."""
    return np.array(jax.jit(EquationOfMotion.acceleration)(EquationOfMotion.of(p), x[:3], x[3:], u))


def advance(plant, state, currents):
    """State after every sample, the start included."""

    def step(state, u):
        after = plant.step(state, u)
        return after, after

    return jax.device_get(jax.jit(lambda: jax.lax.scan(step, state, currents))()[1])


def test_one_step_by_hand(odd_gantry):
    """(5.48) with the bench's exact response in place of forward Euler.

    The printed sum agrees within the error of forward Euler.
    """
    plant, p = HardwareInLoop(Gantry(odd_gantry, DT, substeps=20), bench(0.0, 0.0)), odd_gantry
    k_M, b_M = float(p.head_constant / p.head_mass), float(p.head_viscous / p.head_mass)
    first = Emulated(
        jnp.array([0.2, -0.1, 2e-3, 0.15, 0.3, -0.04]), jnp.array([1]), jnp.array([[0.4, 0.1]])
    )
    before, now = jnp.array([3.0, -1.0, 2.0]), jnp.array([-5.0, 1.0, 1.0])
    second = plant.step(first, before)
    third = plant.step(second, now)
    x, v = np.asarray(first.gantry), [float(state.gantry[3]) for state in (first, second, third)]
    _, beam, turn = accelerations(p, first.gantry, before)
    d_x = (
        x[0] * x[5] ** 2 - np.sin(x[2]) * beam - float(p.tool_offset) * turn
    )  # d_x of section 5.3.1
    pushed = k_M * float(before[0]) + (B_A / M_A - b_M) * v[0] + d_x
    kept = np.exp(-B_A / M_A * DT)
    assert v[2] == pytest.approx(kept * v[1] + (1 - kept) * M_A / B_A * pushed, rel=1e-11)
    euler = (1 - DT * B_A / M_A) * v[1] + DT * pushed
    assert abs(v[2] - euler) < 1.01 * (DT * B_A / M_A) ** 2 / 2 * (
        abs(v[1]) + abs(pushed) * M_A / B_A
    )
    np.testing.assert_allclose(second.sent[0, 0], 3.0)
    torque = K_A * (0.4 - 0.1)
    assert v[1] == pytest.approx(kept * v[0] + (1 - kept) * torque / B_A, rel=1e-11)


def test_the_bench_is_the_head_but_for_its_dry_friction(odd_gantry):
    """(5.47) at the instant of sending: d_x is exact, and what is missing is F_fn / M_A."""
    plant = HardwareInLoop(Gantry(odd_gantry, DT), bench(), 0)

    @jax.jit
    def of_the_bench(mode, x, u):
        torque = K_A * (u[0] - plant.load_current(x, u))
        return plant.bench.acceleration(mode, x[3:4], torque)

    random = np.random.default_rng(0)
    for mode in (-1, 1) * 5:
        x = random.uniform([-0.5, -1, -0.1, 0, -1, -1], [0.5, 1, 0.1, 1, 1, 1])
        x[3] *= mode
        u = random.uniform(-10, 10, 3)
        found = of_the_bench(np.array([mode]), x, u)
        dry = mode * (F_C + F_S / (1 + (x[3] / RADIUS / V_S) ** 2))
        np.testing.assert_allclose(
            found, accelerations(odd_gantry, x, u)[0] - dry / M_A, rtol=1e-11, atol=1e-11
        )


def test_the_shaft_sticks_until_the_head_would_pull_harder():
    """By M_A x_h'' of the gantry against f_c + f_s."""
    plant, p = HardwareInLoop(Gantry(thesis_gantry(), DT), bench(), 0), thesis_gantry()
    rest = plant.initial_state(np.array([0.1, 0.0]), np.zeros(2))
    full = (F_C + F_S) / (M_A * accelerations(p, rest.gantry, jnp.array([1.0, 0, 0]))[0])
    held, moved = (plant.step(rest, jnp.array([share * full, 0, 0])) for share in (0.999, 1.001))
    assert held.mode == 0 and held.gantry[3] == 0 and held.gantry[0] == rest.gantry[0]
    assert moved.mode == 1 and moved.gantry[3] > 0


def test_it_comes_to_rest_and_the_beam_goes_on():
    plant = HardwareInLoop(Gantry(thesis_gantry(), DT), bench(), 1)
    start = eqx.filter_jit(plant.initial_state)(np.zeros(2), np.array([5e-5, 2e-4]))
    states = advance(plant, start, np.zeros((100, 3)))
    assert int(start.mode[0]) == 1 and states.mode[-1] == 0 and states.gantry[-1, 3] == 0
    assert states.gantry[-1, 4] > 0.05


def test_the_delay_is_one_sample_of_the_head_and_none_of_the_drives():
    """If the load follows from the current alone, the head is exactly one sample late."""
    p = eqx.tree_at(
        lambda p: (p.tool_offset, p.head_viscous),
        thesis_gantry(),
        (jnp.array(0.0), thesis_gantry().head_mass * B_A / M_A),
    )
    gantry, none = Gantry(p, DT), jnp.zeros(2)
    currents = jnp.asarray(np.random.default_rng(1).uniform(-8, 8, (30, 1)) * [1, 0, 0])
    at_once, late = (HardwareInLoop(gantry, bench(0.0, 0.0), delay) for delay in (0, 1))
    now, later = (
        advance(plant, plant.initial_state(none, none), currents) for plant in (at_once, late)
    )
    np.testing.assert_array_equal(later.gantry[0], late.initial_state(none, none).gantry)
    np.testing.assert_allclose(later.gantry[1:], now.gantry[:-1], rtol=1e-12, atol=1e-15)
    np.testing.assert_array_equal(later.sent[:, 0, 0], currents[:, 0])
    driven = late.step(late.initial_state(none, none), jnp.array([5.0, 2.0, 2.0]))
    np.testing.assert_allclose(
        driven.gantry,
        gantry.step(gantry.initial_state(none, none), jnp.array([0, 2.0, 2.0])),
        rtol=1e-12,
    )


def test_it_starts_under_the_load_of_a_coasting_head():
    """Whatever the delay, the first sample brakes it as b_x does, not as b_A does."""
    p = thesis_gantry()
    for delay in (0, 2):
        plant = HardwareInLoop(Gantry(p, 2.5e-4), bench(0.0, 0.0), delay)
        begin, step = eqx.filter_jit(plant.initial_state), eqx.filter_jit(plant.step)
        start = begin(np.array([0.1, 0.2]), np.array([5e-5, -1e-5]))
        np.testing.assert_allclose(plant.output(start), [0.1, 0.2], rtol=1e-14)
        np.testing.assert_array_equal(
            plant.measure(start),
            plant.gantry.initial_state(np.array([0.1, 0.2]), np.array([5e-5, -1e-5])),
        )
        slower = (np.asarray(step(start, np.zeros(3)).gantry)[3] - 0.2) / 2.5e-4
        wanted = accelerations(p, np.asarray(start.gantry), np.zeros(3))[0]
        np.testing.assert_allclose(slower, wanted, rtol=2e-3)


@pytest.mark.parametrize("bad", [-1, 0.5, np.nan])
def test_bad_delays_are_named(bad):
    with pytest.raises(ValueError, match="^delay: needs a whole number of samples, at least zero"):
        HardwareInLoop(Gantry(thesis_gantry(), DT), servo_bench(), bad)
