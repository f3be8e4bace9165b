"""The GPU's blocks against the sweep in XLA.

Without a GPU the kernel is interpreted, so the cases are tiny.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.controllers.lq.blockwise_lq import BlockwiseLQ
from jcontour.controllers.lq.contouring_lq import LQWeights
from jcontour.devices import on_gpu
from jcontour.geometry.contours import circle
from jcontour.kernels.gpu.block_lanes import block_plan
from jcontour.motion.references import along
from jcontour.plants import bridgeport
from jcontour.riccati.blockwise import swept
from jcontour.riccati.receding_horizon import CostToGo

needs_gpu = pytest.mark.skipif(not on_gpu(), reason="no GPU")


@pytest.mark.parametrize(
    ("sizes", "inputs", "outputs", "steps", "preview"),
    [
        ((1,), 1, 1, 3, 2),  # the first block is one step long
        pytest.param((2, 1), 2, 2, 7, 3, marks=pytest.mark.slow),
        pytest.param((2,), 1, 2, 2, 5, marks=pytest.mark.slow),
        pytest.param((2,), 1, 1, 3, 1, marks=pytest.mark.slow),
    ],
)
def test_equals_the_sweep_of_all_blocks(problems, sizes, inputs, outputs, steps, preview):
    plant = problems.machine(sizes, inputs, outputs)
    Q, y_d, _, R, end = problems.data(plant, steps, preview)
    blocks = -(-steps // preview)
    ends = CostToGo(*(rows[:blocks] for rows in end))
    found, wanted = (
        problems.quick(jax.vmap(plan, in_axes=(0, None)))(np.stack([Q, 2 * Q]), y_d)
        for plan in (
            lambda Q, y_d: block_plan(
                plant.pattern, preview, plant.A, plant.B, plant.C, Q, y_d, R, *ends
            ),
            lambda Q, y_d: jax.tree.leaves(swept(preview, plant, Q, y_d, R, ends)),
        )
    )
    problems.close(found, wanted, 1e-11)


@needs_gpu
@pytest.mark.parametrize("preview", [30, 250])
def test_a_batch_on_a_gpu_with_its_gradient(preview):
    table = bridgeport()
    path = along(circle(5e-3), 2.5e-5 * np.arange(700), table.dt, preview, at_rest=False)

    def plans(weights):
        return BlockwiseLQ(table, LQWeights(*weights), preview).prepare(path)

    def value(weights):
        plan = plans(weights)
        return jnp.sum(jnp.sin(plan.F)) + jnp.sum(jnp.sin(plan.f))

    weights = jnp.array([[3.0, 5.0, 2e-9], [100.0, 20.0, 1e-9]])
    both = [jax.jit(jax.vmap(plans))(weights), jax.jit(jax.vmap(jax.grad(value)))(weights)]
    with jax.default_device(jax.devices("cpu")[0]):
        wanted = [jax.jit(jax.vmap(plans))(weights), jax.jit(jax.vmap(jax.grad(value)))(weights)]
    for found, exact in zip(jax.tree.leaves(both), jax.tree.leaves(wanted), strict=True):
        scale = np.abs(exact).max(axis=tuple(range(1, exact.ndim)), keepdims=True)
        np.testing.assert_allclose(found / scale, exact / scale, rtol=0, atol=1e-9)
