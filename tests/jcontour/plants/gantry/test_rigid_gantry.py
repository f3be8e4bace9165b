"""The rigid gantry of two drives against its closed form."""

import numpy as np
import pytest

from jcontour.plants.gantry.rigid_gantry import RigidGantry


def test_it_is_a_mass_and_a_rotation():
    """Without friction: y'' = F / M_t, and theta swings at sqrt(K / J)."""
    gantry = RigidGantry(30.0, 2.0, (0.4, 0.5), (0.0, 0.0), 8e4)
    plant = gantry.plant(1e-3)
    state = np.asarray(plant.A) @ np.array([0.0, 1e-3, 0.0, 0.0])
    state = state + np.asarray(plant.B) @ np.array([5.0, 4.0])
    w = 200.0
    torque = -5.0 * 0.4 + 4.0 * 0.5
    turned = 1e-3 * np.cos(w * 1e-3) + torque / 8e4 * (1 - np.cos(w * 1e-3))
    np.testing.assert_allclose(state[:2], [9.0 / 30 / 2 * 1e-6, turned], rtol=1e-10, atol=1e-15)
    moved = np.asarray(plant.output(np.array([0.1, 1e-3, 0.0, 0.0])))
    np.testing.assert_allclose(moved, [0.1 - 4e-4, 0.1 + 5e-4], rtol=1e-12)


def test_friction_loses_what_its_forces_take():
    gantry = RigidGantry(30.0, 2.0, (0.4, 0.5), (10.0, 14.0), 8e4)
    dt = 1e-7
    A = np.asarray(gantry.plant(dt).A)
    v, turn = 0.2, 0.3
    slope = (A @ np.array([0.0, 0.0, v, turn]) - np.array([0.0, 0.0, v, turn]))[2:] / dt
    drives = np.array([v - 0.4 * turn, v + 0.5 * turn])
    lost = -(np.array([10.0, 14.0]) @ drives**2)
    assert 30.0 * v * slope[0] + 2.0 * turn * slope[1] == pytest.approx(lost, rel=1e-3)


def test_a_gantry_without_mass_is_refused():
    with pytest.raises(ValueError, match="needs mass, inertia, stiffness above zero"):
        RigidGantry(0.0, 2.0, (0.4, 0.5), (10.0, 14.0), 8e4).plant(1e-3)
