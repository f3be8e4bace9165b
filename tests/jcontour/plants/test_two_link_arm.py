"""The two-link arm: its Lagrangian, its energy, its kinematics both ways."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from jcontour.arrays import placed
from jcontour.plants.two_link_arm import Joints, TwoLinkArm

energy = jax.jit(TwoLinkArm.energy)


def lagrangian(arm, angle, speed):
    """Kinetic energy from the speeds of the centres of mass, an independent way."""

    def centres(q):
        both = jnp.cumsum(q)
        one = arm.centre[0] * jnp.stack([jnp.cos(q[0]), jnp.sin(q[0])])
        elbow = arm.length[0] * jnp.stack([jnp.cos(q[0]), jnp.sin(q[0])])
        two = elbow + arm.centre[1] * jnp.stack([jnp.cos(both[1]), jnp.sin(both[1])])
        return jnp.stack([one, two])

    moved = jax.jvp(centres, (angle,), (speed,))[1]
    turning = jnp.stack([speed[0], speed[0] + speed[1]])
    return jnp.sum(arm.mass * jnp.sum(moved**2, axis=1) + arm.inertia * turning**2) / 2


def some_state(seed=0):
    random = np.random.default_rng(seed)
    return Joints(random.uniform(-2, 2, 2), random.uniform(-3, 3, 2))


@jax.jit
def by_lagrange(arm, q, v, torque):
    """Acceleration of the arm, and d/dt dL/dq' - dL/dq under it; all derivatives automatic."""

    def momentum(q, v):
        return jax.grad(lambda w: lagrangian(arm, q, w))(v)

    a = arm.acceleration(Joints(q, v), torque)
    change = jax.jvp(momentum, (q, v), (v, a))[1]
    return a, change - jax.grad(lambda p: lagrangian(arm, p, v))(q)


@pytest.mark.parametrize("seed", range(3))
def test_the_equations_are_those_of_lagrange(seed):
    """d/dt dL/dq' - dL/dq = tau - b q'."""
    arm, (q, v) = TwoLinkArm(mass=(5.0, 3.0), inertia=(0.1, 0.07)), some_state(seed)
    torque = np.array([1.5, -0.7])
    a, forces = by_lagrange(arm, q, v, torque)
    lost = np.asarray(arm.viscous) * v
    np.testing.assert_allclose(forces, torque - lost, atol=1e-12)
    np.testing.assert_allclose(
        energy(arm, Joints(q, v)), jax.jit(lagrangian)(arm, q, v), rtol=1e-13
    )
    np.testing.assert_allclose(jax.jit(TwoLinkArm.torque)(arm, Joints(q, v), a), torque, atol=1e-12)


def test_energy_stays_without_friction_and_torque():
    arm = TwoLinkArm(viscous=0.0)
    state = some_state()
    run = jax.jit(lambda s: jax.lax.fori_loop(0, 2000, lambda _, x: arm.step(x, jnp.zeros(2)), s))
    np.testing.assert_allclose(energy(arm, run(state)), energy(arm, state), rtol=1e-10)


@pytest.mark.slow
def test_work_is_energy_and_friction():
    """Over a second under torques that move; the integrals by SciPy along its own solution."""
    arm, (q, v) = TwoLinkArm(dt=1e-2), some_state(1)

    def slopes(t, z):
        torque = 2 * np.array([np.sin(3 * (t // 1e-2) * 1e-2), 0.5])
        state = Joints(jnp.asarray(z[:2]), jnp.asarray(z[2:4]))
        a = np.asarray(arm.acceleration(state, jnp.asarray(torque)))
        lost = float(np.sum(np.asarray(arm.viscous) * z[2:4] ** 2))
        return [*z[2:4], *a, torque @ z[2:4] - lost]

    z = np.array([*q, *v, 0.0])
    state = Joints(q, v)
    for k in range(20):
        span = (k * 1e-2, (k + 1) * 1e-2)
        mid = span[0] + 1e-9
        z = solve_ivp(lambda t, z, mid=mid: slopes(mid, z), span, z, rtol=1e-11, atol=1e-12).y[
            :, -1
        ]
        state = arm.step(state, jnp.asarray(2 * np.array([np.sin(3 * (mid // 1e-2) * 1e-2), 0.5])))
    np.testing.assert_allclose(np.concatenate(state), z[:4], atol=1e-8)
    np.testing.assert_allclose(arm.energy(state) - arm.energy(Joints(q, v)), z[4], atol=1e-8)


@jax.jit
def forward(arm, angle):
    return arm.tool(angle), arm.jacobian(angle), jax.jacfwd(arm.tool)(angle)


@pytest.mark.parametrize("tool", [[0.4, 0.3], [-0.2, 0.5], [0.05, -0.3]])
def test_kinematics_both_ways(tool):
    arm, tool = TwoLinkArm(), np.array(tool)
    angle = np.asarray(jax.jit(TwoLinkArm.angles)(arm, tool))
    back, jacobian, slope = jax.device_get(forward(arm, angle))
    np.testing.assert_allclose(back, tool, atol=1e-14)
    assert angle[1] > 0
    np.testing.assert_allclose(jacobian, slope, atol=1e-14)
    state = jax.jit(TwoLinkArm.initial_state)(arm, tool, np.array([1e-4, -2e-4]))
    np.testing.assert_allclose(jacobian @ np.asarray(state.speed), [0.1, -0.2], atol=1e-12)


@pytest.mark.parametrize("tool", [[0.8, 0.0], [0.05, 0.0]])
def test_out_of_reach(tool):
    with pytest.raises(ValueError, match="out of reach.*reaches from 0.1 to 0.7 m"):
        TwoLinkArm().angles(placed(np.array(tool, float)))


@pytest.mark.parametrize("numbers", [{"mass": (0.0, 1.0)}, {"viscous": -1.0}, {"dt": 0.0}])
def test_bad_numbers(numbers):
    with pytest.raises(ValueError, match="needs to be above zero"):
        TwoLinkArm(**numbers)
