"""The model file in the engine against (5.7)-(5.9).

`test_gantry.py` derives these equations from the energies.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest

from jcontour.plants.gantry.engines.mjcf import ENGINE_ORDER, mjcf
from jcontour.plants.gantry.gantry import EquationOfMotion, Gantry
from jcontour.plants.gantry.parameters import thesis_gantry


@pytest.mark.parametrize("machine", ["odd_gantry", "reference_gantry"])
def test_mass_matrix_accelerations_and_tool(machine, request):
    parameters = request.getfixturevalue(machine)
    motion, ours = EquationOfMotion.of(parameters), Gantry(parameters, 2.5e-4)
    by_us = jax.jit(
        lambda q, v, u: (
            motion.mass_matrix(q),
            jnp.stack(motion.acceleration(q, v, u)),
            ours.output(jnp.concatenate([q, v])),
        )
    )
    model = mujoco.MjModel.from_xml_string(mjcf(parameters, 2.5e-4))
    data, mass = mujoco.MjData(model), np.zeros((3, 3))
    random = np.random.default_rng(5)
    for _ in range(50):
        q, v = random.uniform([-0.5, -1, -0.1], [0.5, 1, 0.1]), random.uniform(-1, 1, 3)
        u = random.uniform(-10, 10, 3)
        data.qpos[:], data.qvel[:], data.ctrl[:3] = q[ENGINE_ORDER], v[ENGINE_ORDER], u
        mujoco.mj_forward(model, data)
        mujoco.mj_fullM(model, data, mass)
        wanted, acceleration, tool = jax.device_get(by_us(q, v, u))
        wanted = wanted[np.ix_(ENGINE_ORDER, ENGINE_ORDER)]
        np.testing.assert_allclose(mass, wanted, rtol=0, atol=1e-12 * np.abs(wanted).max())
        acceleration = acceleration[ENGINE_ORDER]
        np.testing.assert_allclose(
            data.qacc, acceleration, rtol=0, atol=1e-11 * np.abs(acceleration).max()
        )
        np.testing.assert_allclose(
            data.site("tool").xpos[:2],
            tool,
            rtol=0,
            atol=1e-14,
        )


def test_a_family_has_no_single_model():
    family = eqx.tree_at(lambda p: p.head_mass, thesis_gantry(), jnp.array([30.0, 40.0]))
    with pytest.raises(ValueError, match="head_mass: a MuJoCo model needs one number"):
        mjcf(family, 1e-3)
