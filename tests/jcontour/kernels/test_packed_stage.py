import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.kernels.packed_stage import (
    cost_entries,
    cost_in_front,
    definite_inverse,
    packed_cost,
    packed_stage,
    stage_maps,
)
from jcontour.kernels.packing import packing
from jcontour.riccati.receding_horizon import CostToGo, first_control, one_stage_back


@pytest.mark.slow
def test_one_stage_is_the_readable_one(problems):
    plant = problems.machine((2, 1), 2, 2)
    Q, y_d, _, R, end = problems.data(plant, 3, 1)
    pack, maps = packing(plant.pattern), stage_maps(plant.pattern, plant.A, plant.B, plant.C)

    def packed():
        found = packed_stage(pack, maps, R, packed_cost(pack, *end))
        before = cost_in_front(pack, maps, found, cost_entries(Q, y_d)[:, :3])
        K = jnp.moveaxis(jnp.stack(found.K), -1, 0)
        return K[..., np.argsort(pack.order)], -K[..., -1], before

    def readable():
        cost = CostToGo(*end)
        before = one_stage_back(plant, R, cost, Q[:3], y_d[:3])
        return *jax.tree.leaves(first_control(plant, R, cost)), packed_cost(pack, *before)

    problems.close(problems.quick(packed)(), problems.quick(readable)(), 1e-12)


def test_inverse_of_positive_definite_matrices():
    roots = np.random.default_rng(0).standard_normal((5, 3, 3))
    M = roots @ roots.mT + np.eye(3)
    entries = [[jnp.asarray(M[:, i, j]) for j in range(3)] for i in range(3)]
    found = np.array(definite_inverse(entries))
    np.testing.assert_allclose(np.moveaxis(found, -1, 0), np.linalg.inv(M), rtol=0, atol=1e-12)
