"""Blocks in packed form against the readable sweep of all blocks."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
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
    weights = np.array([1.0, 2.0, 0.5])

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


@pytest.mark.slow
def test_windows_side_by_side_have_the_derivative_of_each(problems):
    """As the margins of a loop are differentiated: forward, within a program, over many windows."""
    plant, preview = problems.machine((2,), 1, 1), 3
    Q, y_d, _, R, end = problems.data(plant, 7, preview)
    ends = CostToGo(*(rows[:3] for rows in end))
    many = np.stack([y_d, 2 * y_d])

    def gains(scale, y_d):
        plan = blockwise_plan(plant, scale * Q, y_d, R, ends, preview)
        return plan.F, plan.f

    side_by_side = jax.jacfwd(jax.jit(lambda scale: jax.vmap(partial(gains, scale))(many)))
    alone = [problems.quick(jax.jacfwd(gains))(1.5, y_d) for y_d in many]
    stacked = [np.stack(rows) for rows in zip(*alone, strict=True)]
    problems.close(list(problems.quick(side_by_side)(1.5)), stacked, 1e-12)
