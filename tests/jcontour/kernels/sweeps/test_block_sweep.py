"""Blocks in packed form against the readable sweep of all blocks."""

import jax
import jax.numpy as jnp
import pytest

from jcontour.riccati.blockwise import blockwise_plan, swept
from jcontour.riccati.receding_horizon import CostToGo


@pytest.mark.parametrize(
    ("sizes", "inputs", "outputs", "steps", "preview"),
    [
        ((2, 1), 2, 2, 7, 3),  # the first block is one step long
        pytest.param((3,), 2, 2, 4, 4, marks=pytest.mark.slow),
        pytest.param((2,), 1, 1, 3, 1, marks=pytest.mark.slow),
    ],
)
def test_equals_the_readable_blocks_with_its_derivative(
    problems, sizes, inputs, outputs, steps, preview
):
    plant = problems.machine(sizes, inputs, outputs)
    Q, y_d, _, R, end = problems.data(plant, steps, preview)
    ends = CostToGo(*(rows[: -(-steps // preview)] for rows in end))

    # scales, as symmetric matrices stay symmetric
    weights = jnp.array([1.0, 2.0, 0.5])

    def value(plan, weights, y_d, g):
        q, r, h = weights
        plan = plan(plant, q * Q, y_d, r * R, CostToGo(h * ends.H, g))
        return jnp.sum(jnp.sin(plan.F)) + jnp.sum(jnp.cos(plan.f)), plan

    found, wanted = (
        problems.quick(
            jax.value_and_grad(lambda *some, plan=plan: value(plan, *some), (0, 1, 2), True)
        )(weights, y_d, ends.g)
        for plan in (
            lambda *some: blockwise_plan(*some, preview),
            lambda *some: swept(preview, *some),
        )
    )
    problems.close(found, wanted, 1e-9)
