import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.linear.plant import LinearPlant
from jcontour.riccati.blockwise import blockwise_plan
from jcontour.riccati.receding_horizon import CostToGo, readable_plan


@pytest.mark.parametrize(
    ("steps", "preview", "ends"),
    [
        (7, 3, (3, 6, 6, 6, 9, 9, 9)),  # the first block is one step long
        (4, 4, (7, 7, 7, 7)),
        (2, 5, (6, 6)),
        (3, 1, (1, 2, 3)),  # a block of one step: a receding horizon
    ],
)
def test_every_step_is_a_horizon_up_to_the_end_of_its_block(coupled_plant, steps, preview, ends):
    plant: LinearPlant = coupled_plant(3, 4, 2)
    random, seen = np.random.default_rng(0), steps + preview
    roots = random.standard_normal((seen, 2, 2))
    Q, y_d = jnp.asarray(roots @ roots.mT), jnp.asarray(random.standard_normal((seen, 2)))
    halves = random.standard_normal((steps, 4, 4))
    end = CostToGo(jnp.asarray(halves @ halves.mT), jnp.asarray(random.standard_normal((steps, 4))))
    R = 0.3 * jnp.eye(2)
    found = blockwise_plan(plant, Q, y_d, R, end)
    for k, last in enumerate(ends):
        terminal = CostToGo(*(rows[last - preview, None] for rows in end))
        wanted = readable_plan(
            plant, Q[k : last + 1], y_d[k : last + 1], jnp.ones(last - k), R, terminal
        )
        np.testing.assert_allclose(found.F[k], wanted.F[0], rtol=1e-10, atol=1e-12)
        np.testing.assert_allclose(found.f[k], wanted.f[0], rtol=1e-10, atol=1e-12)
