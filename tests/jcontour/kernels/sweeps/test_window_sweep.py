"""The fast sweep against the readable one: values, derivatives, batches, blocks."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.kernels.sweeps import window_sweep
from jcontour.plants import bridgeport
from jcontour.riccati.receding_horizon import CostToGo, readable_plan, receding_horizon_plan


@pytest.mark.parametrize(
    ("sizes", "inputs", "outputs", "preview"),
    [
        ((3, 5), 2, 2, 10),
        ((4,), 1, 2, 1),
        pytest.param((2, 3, 2), 3, 3, 2, marks=pytest.mark.slow),
        pytest.param((5,), 2, 2, 40, marks=pytest.mark.slow),
    ],
)
def test_equals_the_readable_sweep(sizes, inputs, outputs, preview, problems):
    plant = problems.machine(sizes, inputs, outputs)
    arguments = problems.data(plant, 12, preview)
    problems.close(
        jax.jit(receding_horizon_plan)(plant, *arguments),
        jax.jit(readable_plan)(plant, *arguments),
        1e-11,
    )


@pytest.mark.slow
def test_blocks_of_time_leave_no_seam(problems):
    plant, steps = bridgeport(), 2 * window_sweep.BLOCK + 1
    arguments = problems.data(plant, steps, 3)
    problems.close(
        jax.jit(receding_horizon_plan)(plant, *arguments),
        jax.jit(readable_plan)(plant, *arguments),
        1e-11,
    )


@pytest.mark.slow
def test_gradients_cross_the_seams_of_blocks(monkeypatch, problems):
    monkeypatch.setattr(window_sweep, "BLOCK", 8)
    plant = problems.machine((4,), 2, 2)
    arguments = problems.data(plant, 27, 4)
    fast, weights, _ = scaled(receding_horizon_plan, plant, *arguments)
    slow, _, _ = scaled(readable_plan, plant, *arguments)
    problems.close(
        problems.quick(jax.grad(fast))(weights, plant),
        problems.quick(jax.grad(slow))(weights, plant),
        1e-9,
    )


def scalar(plan_of, key=0):
    def value(plant, *arguments):
        plan = plan_of(plant, *arguments)
        first, second = jax.random.split(jax.random.key(key))
        return jnp.sum(plan.F * jax.random.normal(first, plan.F.shape)) + jnp.sum(
            plan.f * jax.random.normal(second, plan.f.shape)
        )

    return value


def scaled(plan_of, plant, Q, y_d, stage, R, terminal):
    """A scalar of weights that scale every symmetric thing, and of the plant."""

    def value(weights, plant):
        end = CostToGo(weights[2] * terminal.H, weights[3] * terminal.g)
        return scalar(plan_of)(
            plant, weights[0] * Q, weights[4] * y_d, stage * weights[5:], weights[1] * R, end
        )

    return value, jnp.ones(5 + stage.size), plant


@pytest.mark.slow
def test_derivatives_equal_those_of_the_readable_sweep(problems):
    plant = problems.machine((2, 2), 2, 2)
    arguments = problems.data(plant, 9, 4)
    fast, weights, _ = scaled(receding_horizon_plan, plant, *arguments)
    slow, _, _ = scaled(readable_plan, plant, *arguments)
    expected = problems.quick(jax.grad(slow, argnums=(0, 1)))(weights, plant)
    problems.close(
        problems.quick(jax.grad(fast))(weights, plant), expected[0], 1e-9
    )  # the weights alone: predicted trajectories
    reverse = problems.quick(jax.grad(fast, argnums=(0, 1)))(weights, plant)  # with the model
    problems.close(reverse[0], expected[0], 1e-9)
    for one, other, where in zip(
        (reverse[1].A, reverse[1].B), (expected[1].A, expected[1].B), plant.pattern[:2], strict=True
    ):
        mask = np.array(where, float)
        problems.close(one * mask, other * mask, 1e-9)


@pytest.mark.slow
@pytest.mark.parametrize(("inputs", "preview"), [(1, 1), (3, 2)])
def test_gradients_of_every_datum_of_a_coupled_plant(inputs, preview, problems):
    plant = problems.machine((3,), inputs, 2)
    Q, y_d, stage, R, terminal = problems.data(plant, 6, preview)

    def value(plan_of):
        def symmetric(Q, y_d, stage, R, terminal, plant):
            Q, R, H = (M + jnp.swapaxes(M, -1, -2) for M in (Q, R, terminal.H))
            return scalar(plan_of)(plant, Q, y_d, stage, R, CostToGo(H, terminal.g))

        return symmetric

    arguments = Q, y_d, stage, R, terminal, plant
    expected = problems.quick(jax.grad(value(readable_plan), argnums=(0, 1, 2, 3, 4, 5)))(
        *arguments
    )
    problems.close(
        problems.quick(jax.grad(value(receding_horizon_plan), argnums=(0, 1, 2, 3, 4)))(*arguments),
        expected[:5],
        1e-9,
    )
    moved = problems.quick(jax.grad(value(receding_horizon_plan), argnums=5))(*arguments)
    problems.close((moved.A, moved.B, moved.C), (expected[5].A, expected[5].B, expected[5].C), 1e-9)


@pytest.mark.slow
def test_forward_and_reverse_mode_are_transposes(problems):
    plant = problems.machine((4,), 2, 2)
    Q, y_d, stage, R, terminal = problems.data(plant, 9, 4)

    def plan(y_d, stage, g):
        return receding_horizon_plan(plant, Q, y_d, stage, R, CostToGo(terminal.H, g))

    point = y_d, stage, terminal.g
    push = tuple(jnp.asarray(np.random.default_rng(2).standard_normal(x.shape)) for x in point)
    out, pushed = problems.quick(lambda *x: jax.jvp(plan, x, push))(*point)
    pull = jax.tree.map(lambda x: jnp.cos(jnp.arange(x.size, dtype=x.dtype)).reshape(x.shape), out)
    pulled = problems.quick(lambda *x: jax.vjp(plan, *x)[1](pull))(*point)
    first, second = (
        sum(jnp.vdot(a, b) for a, b in zip(x, y, strict=True))
        for x, y in ((jax.tree.leaves(pushed), jax.tree.leaves(pull)), (push, pulled))
    )
    np.testing.assert_allclose(first, second, rtol=1e-11)


@pytest.mark.slow
def test_a_family_of_models_is_a_loop_over_them(problems):
    plant = problems.machine((4,), 2, 2)
    value, weights, _ = scaled(receding_horizon_plan, plant, *problems.data(plant, 9, 4))
    family = [jax.tree.map(lambda leaf, s=s: s * leaf, plant) for s in (0.9, 1.0, 1.1)]
    stacked = jax.tree.map(lambda *leaves: jnp.stack(leaves), *family)
    gradient, together = (
        problems.quick(jax.grad(value)),
        problems.quick(jax.vmap(jax.grad(value), (None, 0))),
    )
    problems.close(
        together(weights, stacked), jnp.stack([gradient(weights, one) for one in family]), 1e-11
    )


@pytest.mark.slow
def test_batches_in_both_orders(problems):
    plant = problems.machine((4,), 2, 2)
    arguments = problems.data(plant, 9, 4)
    value, weights, _ = scaled(receding_horizon_plan, plant, *arguments)
    batch = jnp.stack([weights, 2 * weights, 0.5 * weights])
    gradient = problems.quick(jax.grad(value))
    one_by_one = jnp.stack([gradient(row, plant) for row in batch])
    problems.close(
        problems.quick(jax.vmap(jax.grad(value), (0, None)))(batch, plant), one_by_one, 1e-11
    )
    summed = problems.quick(jax.grad(lambda rows: jnp.sum(jax.vmap(value, (0, None))(rows, plant))))
    problems.close(summed(batch), one_by_one, 1e-11)


@pytest.mark.slow
def test_single_precision_stays_single(problems):
    plant = problems.machine((3, 4), 2, 2)
    single = jax.tree.map(
        lambda leaf: leaf.astype(jnp.float32), (plant, *problems.data(plant, 9, 4))
    )
    plan = jax.jit(receding_horizon_plan)(*single)
    assert plan.F.dtype == plan.f.dtype == jnp.float32
    problems.close(plan, jax.jit(receding_horizon_plan)(plant, *problems.data(plant, 9, 4)), 1e-3)
