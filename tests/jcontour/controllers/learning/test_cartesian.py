"""Learning at the tool of an arm: error and energy of every cycle."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jcontour._arrays import placed
from jcontour.controllers.learning.cartesian import CartesianControl, cartesian_cycles
from jcontour.controllers.learning.laps import PType, learn
from jcontour.motion.references import from_samples
from jcontour.plants.arms import TwoLinkArm

DT, STEPS, CYCLES = 2e-3, 800, 12
GAINS = (6000.0, 300.0)  # [N/m], [N s/m]
LAW = PType(0.9, lead=1, smoothing=2)


@pytest.fixture(scope="module")
def ring():
    """A circle of 60 mm radius in 1.6 s, from rest to rest."""
    share = np.arange(STEPS + 1) / STEPS
    angle = 2 * np.pi * (share - np.sin(2 * np.pi * share) / (2 * np.pi))
    position = np.array([0.35, 0.3]) + 0.06 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    tangent = np.stack([-np.sin(angle), np.cos(angle)], axis=1)
    return from_samples(position, tangent, DT, preview=1, in_motion=False)


@pytest.fixture(scope="module")
def cycles(ring):
    arm = TwoLinkArm()
    control = CartesianControl(arm, *GAINS, jnp.zeros((STEPS, 2)), DT)
    run = cartesian_cycles(lambda lap: arm, control, ring)
    return arm, run, learn(run, LAW, CYCLES, jnp.zeros((STEPS, 2)))[0]


def energy_of(arm, angles, torques):
    """Work of the torques over a cycle, each held over its sample [J]."""
    return float(np.sum(torques * np.diff(angles, axis=0)))


@pytest.mark.slow
def test_the_energy_comes_to_that_of_the_inverse_dynamics(cycles, ring):
    """Work per cycle from the torques; at rest at both ends, friction along the path is all."""
    arm, _, laps = cycles
    q = np.asarray(jax.vmap(arm.angles)(jnp.asarray(ring.position)))
    v = np.gradient(q, DT, axis=0)
    ideal = float(np.sum(np.asarray(arm.viscous) * v**2) * DT)
    actual = []
    for lap in (0, CYCLES - 1):
        tool = np.asarray(laps.output[lap])
        angles = np.asarray(jax.vmap(arm.angles)(jnp.asarray(tool)))
        actual.append(energy_of(arm, angles, np.asarray(laps.control[lap])[:-1]))
    assert abs(actual[1] - ideal) < 0.02 * ideal
    assert abs(actual[1] - ideal) < abs(actual[0] - ideal)


def test_other_masses_are_learned_as_well(ring):
    """The law knows lengths only: heavier links, the same law."""
    heavy = TwoLinkArm(mass=(12.0, 6.0), inertia=(0.18, 0.06), viscous=(1.0, 0.6))
    control = CartesianControl(TwoLinkArm(), *GAINS, np.zeros((STEPS, 2)), DT)
    run = cartesian_cycles(lambda lap: heavy, control, ring)
    laps, _ = learn(run, LAW, CYCLES, placed(np.zeros((STEPS, 2))))
    away = np.asarray(laps.output) - np.asarray(ring.position)[:STEPS]
    rms = np.sqrt(np.mean(np.sum(away**2, axis=2), axis=1))
    assert rms[-1] < 0.05 * rms[0]


def test_a_spring_and_a_damper_at_the_tool(ring):
    arm = TwoLinkArm()
    control = CartesianControl(arm, *GAINS, jnp.ones((STEPS, 2)), DT)
    plan = jax.tree.map(lambda rows: np.asarray(rows)[7], control.prepare(ring))
    angle, speed = placed(np.array([0.2, 1.1])), placed(np.array([0.3, -0.4]))
    J = np.asarray(arm.jacobian(angle))
    path = np.asarray(ring.position)
    pull = 6000 * (path[7] - np.asarray(arm.tool(angle)))
    pull = pull + 300 * ((path[8] - path[6]) / (2 * DT) - J @ speed)
    _, torque = control.step(None, plan, (angle, speed))
    np.testing.assert_allclose(torque, J.T @ (pull + 1), rtol=1e-12)


def test_bad_input(ring):
    arm = TwoLinkArm()
    with pytest.raises(ValueError, match="stiffness: needs to be finite"):
        CartesianControl(arm, -1.0, 1.0, jnp.zeros((STEPS, 2)), DT)
    with pytest.raises(ValueError, match=r"force: needs the shape \(800, 2\)"):
        CartesianControl(arm, 1.0, 1.0, np.zeros((3, 2)), DT).prepare(ring)
