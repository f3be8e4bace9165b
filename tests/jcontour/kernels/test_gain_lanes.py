"""The kernels of the gains with a batch on the last axis.

`test_lane_plan` asks for values and derivatives.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.kernels.gain_lanes import Sizes, gains, shape_of
from jcontour.kernels.packed_stage import cost_entries
from jcontour.linear.plant import Pattern
from jcontour.riccati.receding_horizon import CostToGo, readable_plan


def test_numbers_that_are_zero_are_not_written_out():
    pattern = Pattern.of(np.diag([1.0, 2.0]), np.eye(2), np.array([[0.0, 1.0]]))
    shape = shape_of(pattern)
    assert shape.rows == {0: (0,), 1: (1,), 3: (0,), 4: (1,)} and shape.C == ((0, 1),)
    assert shape.entries == ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2))


@pytest.mark.slow
def test_lanes_of_several_members(problems):
    plant = problems.machine((2, 1), 2, 2)
    Q, y_d, stage, R, terminal = problems.data(plant, 5, 3)
    scale = jnp.array([0.5, 1.0, 2.0])
    run = gains(plant.pattern, Sizes(3, 2, 2, 5, 3, True))
    ends = [jnp.moveaxis(array, 0, -1) for array in terminal]
    F, f = problems.quick(
        lambda: jax.vmap(
            lambda s: run(plant.A, plant.B, plant.C, cost_entries(Q, y_d), stage, s * R, *ends)
        )(scale)
    )()
    for k, factor in enumerate(scale):
        wanted = readable_plan(plant, Q, y_d, stage, factor * R, CostToGo(*terminal))
        problems.close((F[k].transpose(2, 0, 1), f[k].T), (wanted.F, wanted.f), 1e-11)
