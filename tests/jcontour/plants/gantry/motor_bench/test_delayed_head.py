import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.signal import cont2discrete

from jcontour.linear.plant import steady_motion
from jcontour.plants.gantry.gantry import Gantry
from jcontour.plants.gantry.motor_bench.back_to_back_motors import servo_bench
from jcontour.plants.gantry.motor_bench.delayed_head import delayed_head_model, twist_damping
from jcontour.plants.gantry.motor_bench.hardware_in_loop import HardwareInLoop
from jcontour.plants.gantry.parameters import thesis_gantry

DT = 2e-3


def head():
    """(b_A / M_A, k_x / M_e) of the two machines."""
    bench, p = servo_bench(), thesis_gantry()
    return float(bench.friction.viscous[0] / bench.inertia[0]), float(p.head_constant / p.head_mass)


def sampled(method):
    viscous, gain = head()
    return cont2discrete(
        (
            np.array([[0, 1], [0, -viscous]]),
            np.array([[0], [gain]]),
            np.eye(1, 2),
            np.zeros((1, 1)),
        ),
        DT,
        method,
    )[:2]


def test_it_is_the_delayed_zero_order_hold_of_scipy():
    model = delayed_head_model(thesis_gantry(), servo_bench(), DT)
    A, B = sampled("zoh")
    np.testing.assert_allclose(
        model.A, np.block([[A, B], [np.zeros((1, 3))]]), rtol=1e-12, atol=1e-18
    )
    np.testing.assert_array_equal(model.B, [[0], [0], [1]])
    np.testing.assert_array_equal(model.C, [[1, 0, 0]])


def test_how_far_the_printed_forward_euler_is():
    (viscous, gain), model = head(), delayed_head_model(thesis_gantry(), servo_bench(), DT)
    exact, (A, B) = np.asarray(model.A), sampled("euler")
    np.testing.assert_allclose(A, [[1, DT], [0, 1 - DT * viscous]], rtol=1e-12)
    assert exact[1, 1] - A[1, 1] == pytest.approx((DT * viscous) ** 2 / 2, rel=1e-2)
    assert B[0] == 0 and exact[0, 2] == pytest.approx(DT**2 * gain / 2, rel=1e-2)


def test_it_predicts_a_bench_whose_friction_is_its_own():
    """Without dry friction and twist, and with b_x / M_e = b_A / M_A, nothing is left to F_Nx."""
    p, bench = thesis_gantry(), servo_bench()
    p = eqx.tree_at(lambda p: p.head_viscous, p, p.head_mass * head()[0])
    bench = eqx.tree_at(
        lambda b: (b.friction.coulomb, b.friction.stribeck), bench, (jnp.zeros(1), jnp.zeros(1))
    )
    p = eqx.tree_at(lambda p: p.tool_offset, p, jnp.zeros(()))
    plant, model = HardwareInLoop(Gantry(p, DT), bench), delayed_head_model(p, bench, DT)
    state = plant.initial_state(np.zeros(2), np.array([1e-4, 0.0]))
    expected = jnp.array([0.0, 0.05, 0.0])
    for current in (2.0, -3.0, 1.0, 5.0):
        state, expected = (
            plant.step(state, jnp.array([current, 0, 0])),
            model.step(expected, jnp.array([current])),
        )
        np.testing.assert_allclose(
            [*state.gantry[jnp.array([0, 3])], state.sent[0, 0]], expected, rtol=1e-9
        )


def test_steady_motion_needs_what_the_friction_takes():
    model, (viscous, gain) = delayed_head_model(thesis_gantry(), servo_bench(), DT), head()
    np.testing.assert_allclose(
        np.asarray(steady_motion(model).Sv)[:, 0],
        [0, 1 / DT, viscous / gain / DT],
        rtol=1e-9,
        atol=1e-9,
    )


@pytest.mark.parametrize(
    ("dt", "delay", "grows"),
    [
        (2e-3, 1, True),
        pytest.param(2e-3, 0, True, marks=pytest.mark.slow),
        pytest.param(2.5e-4, 1, False, marks=pytest.mark.slow),
    ],
)
def test_damping_of_the_twist_is_that_of_the_eigenvalues(dt, delay, grows):
    """c = -2 J_0 times the growth rate of the beam's mode; M_e d^2 / J_0 is 3 %."""
    p = thesis_gantry()
    bench = eqx.tree_at(
        lambda b: (b.friction.coulomb, b.friction.stribeck),
        servo_bench(),
        (jnp.zeros(1), jnp.zeros(1)),
    )
    plant = HardwareInLoop(Gantry(p, dt), bench, delay)
    start = plant.initial_state(np.zeros(2), np.array([0.05 * dt, 0.0]))

    def sample(z):
        moved = start._replace(gantry=start.gantry + z[:6], sent=start.sent + z[6:].reshape(-1, 2))
        after = plant.step(moved, jnp.zeros(3))
        return jnp.concatenate([after.gantry, after.sent.reshape(-1)])

    away = 1e-5 * jnp.eye(6 + 2 * delay)
    rows = jax.jit(jax.vmap(sample))(jnp.concatenate([away, -away]))
    eigenvalues = np.linalg.eigvals((rows[: len(away)] - rows[len(away) :]) / 2e-5)
    mode = eigenvalues[np.argmax(np.abs(np.angle(eigenvalues)) * (np.abs(eigenvalues) > 0.5))]
    found = -2 * float(p.inertia(0.0) * np.log(np.abs(mode))) / dt
    frequency = float(jnp.sqrt(2 * p.joint_stiffness / p.inertia(0.0)))
    all_late = float(p.head_mass * p.tool_offset**2) * frequency
    assert found == pytest.approx(float(twist_damping(plant)), abs=0.05 * all_late)
    assert (found < 0) is grows
