import jax
import jax.numpy as jnp
import numpy as np

from jcontour.simulation.numbered import Numbered


def test_a_number_changes_nothing(two_axes):
    place, increment = jnp.array([1e-3, 2e-3]), jnp.array([1e-5, 0.0])
    control = jnp.array([0.3, -0.2])
    found, wanted = [], []
    for plant, rows in ((Numbered(two_axes, 3), found), (two_axes, wanted)):
        state = plant.step(plant.initial_state(place, increment), control)
        rows += [state, plant.output(state), plant.measure(state), plant.holding_control(place)]
    for a, b in zip(jax.tree.leaves(found), jax.tree.leaves(wanted), strict=True):
        np.testing.assert_array_equal(a, b)
    assert Numbered(two_axes, 3).dt == two_axes.dt
    assert Numbered(two_axes, 3).side_by_side is two_axes.side_by_side
