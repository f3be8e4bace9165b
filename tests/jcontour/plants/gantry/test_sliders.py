"""The equation of motion in the motors' coordinates against J^-T M J^-1.

The Jacobian is found by automatic differentiation.
"""

from itertools import product

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.plants.gantry.gantry import EquationOfMotion
from jcontour.plants.gantry.sliders import SliderEquation, SliderMasses

STATES = (  # q, q': straight at rest, twisted far at speed, both sides of the beam
    [0.0, 0.3, 0.0, 0.0, 0.0, 0.0],
    [0.41, -0.2, 0.3, 0.5, -0.7, 1.3],
    [-0.55, 0.1, -0.2, -0.4, 0.2, -2.1],
)


def full(masses: SliderMasses):
    return np.array(
        [
            [masses.head, masses.head_1, masses.head_2],
            [masses.head_1, masses.drive_1, masses.drives],
            [masses.head_2, masses.drives, masses.drive_2],
        ]
    )


def in_the_motors_coordinates(p, state, control):
    """z, z', M_z and f by the chain rule."""
    z, slope, turning, mass, force = jax.device_get(in_coordinates(p, state, control))
    back = np.linalg.inv(slope)
    return z[:3], z[3:], back.T @ mass @ back, back.T @ (force + mass @ back @ turning)


@jax.jit
def in_coordinates(p, state, control):
    """z and z', J, J' q', and M and f of q."""
    q, v = state[:3], state[3:]

    def sliders(q):
        return p.motors(jnp.concatenate([q, jnp.zeros(3)]))[:3]

    slope, turning = jax.jvp(jax.jacfwd(sliders), (q,), (v,))  # J' q' = -J (J^-1)' z'
    motion = EquationOfMotion.of(p)
    force = jnp.stack(motion.forces(q, v, control)) - jnp.stack(motion.bias(q, v))
    return p.motors(state), slope, turning @ v, motion.mass_matrix(q), force


@pytest.mark.parametrize("state", STATES)
def test_masses_and_forces_are_those_of_the_chain_rule(odd_gantry, state):
    control = np.array([1.5, -2.0, 3.0])
    z, v, wanted, force = in_the_motors_coordinates(odd_gantry, np.array(state), control)
    equation, of = SliderEquation.of(odd_gantry), jax.jit(SliderEquation.masses_and_forces)
    masses, found = jax.device_get(of(equation, z, v, control))
    np.testing.assert_allclose(full(masses), wanted, rtol=1e-11, atol=1e-11)
    np.testing.assert_allclose(found, force, rtol=1e-11, atol=1e-9 * np.abs(force).max())


def test_products_and_solutions_are_those_of_numpy():
    """Where some sliders are held the equation has only the rows and columns of the others."""
    masses = SliderMasses(*map(np.asarray, (17.0, -3.0, 2.0, 40.0, 11.0, 52.0)))
    times, solved, solved_for = map(
        jax.jit, (SliderMasses.times, SliderMasses.solved, SliderMasses.solved_for)
    )
    force = np.array([5.0, -7.0, 11.0])
    matrix = full(masses)
    np.testing.assert_allclose(times(masses, tuple(force)), matrix @ force, rtol=1e-14)
    np.testing.assert_allclose(solved(masses, force), np.linalg.solve(matrix, force), rtol=1e-13)
    for slips in map(np.array, product((False, True), repeat=3)):
        wanted = np.zeros(3)
        wanted[slips] = np.linalg.solve(matrix[np.ix_(slips, slips)], force[slips])
        found = np.array(solved_for(masses, slips, force))
        np.testing.assert_allclose(found, wanted, rtol=1e-13)
        np.testing.assert_array_equal(found[~slips], 0.0)
