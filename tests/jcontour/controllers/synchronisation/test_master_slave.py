"""Master-slave synchronisation."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.controllers.feedback.cascade import Cascade, CascadeGains
from jcontour.controllers.synchronisation.adaptive import MasterSlave
from jcontour.sensors import motors
from tests.canonical import DT, reference, round_path

LOOPS = Cascade(CascadeGains(30.0, 20.0, 0.02, 1.0), motors(2), DT)


@pytest.mark.parametrize("coupling", [0.0, 0.4, 1.0])
def test_the_slave_follows_the_master(coupling):
    """Its loop is the cascade of a reference that is moved by the master's error."""
    path, law = reference(round_path(2)), MasterSlave(LOOPS, (0, 1), coupling)
    plan = jax.tree.map(lambda rows: rows[3], law.prepare(path))
    position, speed = np.array([1e-3, 2e-4]), np.array([0.02, 0.03])
    _, control = law.step(jnp.zeros(2), plan, (position, speed))
    r, v = np.asarray(plan.position), np.asarray(plan.velocity)
    moved = r + coupling * np.array([0.0, position[0] - r[0]])
    wanted = v + coupling * np.array([0.0, speed[0] - v[0]])
    error = 30.0 * (moved - position) + wanted - speed
    np.testing.assert_allclose(control, 20.0 * (1 + DT / 0.02) * error, rtol=1e-10)


def test_two_different_axes_are_needed():
    with pytest.raises(ValueError, match="pair: needs two of the 2 axes"):
        MasterSlave(LOOPS, (0, 2))
