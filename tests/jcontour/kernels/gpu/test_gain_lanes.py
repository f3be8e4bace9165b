"""The kernels of the gains with a batch on the last axis.

`test_lane_plan` asks for values and derivatives.
"""

import jax
import jax.numpy as jnp
import pytest

from jcontour.kernels.gpu.gain_lanes import gains
from jcontour.kernels.packed_stage import cost_entries
from jcontour.kernels.written_stage import Sizes
from jcontour.riccati.receding_horizon import CostToGo, readable_plan


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
