import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.plants.gantry.engines import mujoco_engine
from jcontour.plants.gantry.engines.mujoco_engine import GantryMuJoCo
from jcontour.plants.gantry.gantry import Gantry

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
