"""The model file in the engine against (5.7)-(5.9).

`test_gantry.py` derives these equations from the energies.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest

from jcontour.plants.gantry import mujoco_engine
from jcontour.plants.gantry.gantry import EquationOfMotion, Gantry, thesis_gantry
from jcontour.plants.gantry.mujoco_engine import ENGINE_ORDER, GantryMJX, GantryMuJoCo, mjcf

DT = 2e-3


@pytest.mark.slow
def test_a_closed_loop_is_ours(tools_in_a_loop, reference_gantry):
    """3,365 samples of line, circle, line."""
    engine = tools_in_a_loop(GantryMuJoCo(reference_gantry, DT))
    ours = tools_in_a_loop(Gantry(reference_gantry, DT))
    assert len(ours) == 3365
    np.testing.assert_allclose(engine, ours, rtol=0, atol=1e-8)


def test_steady_start_and_batches(odd_gantry):
    plant, ours = GantryMuJoCo(odd_gantry, DT), Gantry(odd_gantry, DT)
    places, increments = (
        jnp.array([[0.3, 0.1], [-0.2, 0.4]]),
        jnp.array([[2e-4, -1e-4], [0.0, 3e-4]]),
    )
    control = jnp.array([1.0, -2.0, 3.0])
    found = jax.jit(
        jax.vmap(
            lambda place, move: plant.measure(plant.step(plant.initial_state(place, move), control))
        )
    )(places, increments)
    wanted = jax.vmap(lambda place, move: ours.step(ours.initial_state(place, move), control))(
        places, increments
    )
    np.testing.assert_allclose(found, wanted, rtol=1e-11, atol=1e-13)
    np.testing.assert_allclose(
        plant.output(plant.initial_state(places[0], increments[0])), places[0], rtol=1e-15
    )
    with pytest.raises(ValueError, match="outside the beam|head runs"):
        plant.initial_state(np.array([0.7, 0.0]), np.zeros(2))
    with pytest.raises(ValueError, match="does not divide the sample period"):
        GantryMuJoCo(odd_gantry, 1.1e-3)


@pytest.mark.parametrize(("name", "found"), [("mujoco", "3.3.0"), ("mujoco-mjx", None)])
def test_other_versions_are_named(monkeypatch, name, found):
    def version(package):
        if package == name and found is None:
            raise mujoco_engine.PackageNotFoundError(package)
        return found if package == name else mujoco_engine.WANTED[package]

    monkeypatch.setattr(mujoco_engine, "version", version)
    wanted = mujoco_engine.WANTED[name]
    with pytest.raises(
        ImportError,
        match=f"^{name}: the gantry in MuJoCo needs version {wanted}, found {found or 'none'}",
    ):
        mujoco_engine.check_versions()


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


@pytest.mark.slow
def test_a_closed_loop_is_ours_of_mjx_engine(tools_in_a_loop, reference_gantry):
    """From the line into the circle; MuJoCo's own engine runs to the end."""
    engine = tools_in_a_loop(GantryMJX(reference_gantry, DT), 800)
    ours = tools_in_a_loop(Gantry(reference_gantry, DT), 800)
    assert np.ptp(ours, axis=0).min() > 1e-3
    np.testing.assert_allclose(engine, ours, rtol=0, atol=1e-8)
