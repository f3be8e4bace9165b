"""The fast sweep against the readable one: values, derivatives, batches, blocks."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.kernels import window_sweep
from jcontour.linear import LinearPlant
from jcontour.plants import bridgeport
from jcontour.riccati import CostToGo, readable_plan, receding_horizon_plan

quick = partial(jax.jit, compiler_options={"xla_backend_optimization_level": 0})  # derivatives: the time goes into compiling, not running


def machine(sizes: tuple[int, ...], inputs: int, outputs: int) -> LinearPlant:
    """A stable plant of decoupled parts, its states shuffled so that the parts interleave."""
    random, n = np.random.default_rng(sum(sizes)), sum(sizes)
    A, B, C = np.zeros((n, n)), np.zeros((n, inputs)), np.zeros((outputs, n))
    first = 0
    for part, size in enumerate(sizes):
        own = slice(first, first + size)
        block = random.standard_normal((size, size))
        A[own, own] = 0.9 * block / np.abs(np.linalg.eigvals(block)).max()
        B[own, part :: len(sizes)] = random.standard_normal((size, len(range(part, inputs, len(sizes)))))
        C[part :: len(sizes), own] = random.standard_normal((len(range(part, outputs, len(sizes))), size))
        first += size
    order = random.permutation(n)
    return LinearPlant(A[np.ix_(order, order)], B[order], C[:, order], 1e-3)


def data(plant: LinearPlant, steps: int, preview: int):
    random = np.random.default_rng(1)
    n, p, m = plant.states, plant.inputs, plant.axes

    def positive(*shape):
        root = random.standard_normal((*shape, shape[-1]))
        return jnp.asarray(root @ np.swapaxes(root, -1, -2) + 0.1 * np.eye(shape[-1]))

    terminal = CostToGo(positive(steps, n), jnp.asarray(random.standard_normal((steps, n))))
    stage = jnp.asarray(random.uniform(0.5, 2.0, preview))
    return positive(steps + preview, m), jnp.asarray(random.standard_normal((steps + preview, m))), stage, positive(p), terminal


def close(first, second, tolerance):
    for one, other in zip(jax.tree.leaves(first), jax.tree.leaves(second), strict=True):
        np.testing.assert_allclose(one, other, rtol=0, atol=tolerance * max(1e-300, float(jnp.max(jnp.abs(other)))))


@pytest.mark.parametrize(
    ("sizes", "inputs", "outputs", "preview"),
    [((3, 5), 2, 2, 10), ((2, 3, 2), 3, 3, 2), ((4,), 1, 2, 1), ((5,), 2, 2, 40)],
)
def test_equals_the_readable_sweep(sizes, inputs, outputs, preview):
    plant = machine(sizes, inputs, outputs)
    arguments = data(plant, 12, preview)
    close(jax.jit(receding_horizon_plan)(plant, *arguments), jax.jit(readable_plan)(plant, *arguments), 1e-11)


def test_blocks_of_time_leave_no_seam():
    plant, steps = bridgeport(), 2 * window_sweep.BLOCK + 1
    arguments = data(plant, steps, 3)
    close(jax.jit(receding_horizon_plan)(plant, *arguments), jax.jit(readable_plan)(plant, *arguments), 1e-11)


def test_gradients_cross_the_seams_of_blocks(monkeypatch):
    monkeypatch.setattr(window_sweep, "BLOCK", 8)
    plant = machine((4,), 2, 2)
    arguments = data(plant, 27, 4)
    fast, weights, _ = scaled(receding_horizon_plan, plant, *arguments)
    slow, _, _ = scaled(readable_plan, plant, *arguments)
    close(quick(jax.grad(fast))(weights, plant), quick(jax.grad(slow))(weights, plant), 1e-9)


def scalar(plan_of, key=0):
    def value(plant, *arguments):
        plan = plan_of(plant, *arguments)
        first, second = jax.random.split(jax.random.key(key))
        return jnp.sum(plan.F * jax.random.normal(first, plan.F.shape)) + jnp.sum(plan.f * jax.random.normal(second, plan.f.shape))

    return value


def scaled(plan_of, plant, Q, y_d, stage, R, terminal):
    """A scalar of weights that scale every symmetric thing, and of the plant."""

    def value(weights, plant):
        end = CostToGo(weights[2] * terminal.H, weights[3] * terminal.g)
        return scalar(plan_of)(plant, weights[0] * Q, weights[4] * y_d, stage * weights[5:], weights[1] * R, end)

    return value, jnp.ones(5 + stage.size), plant


def test_derivatives_equal_those_of_the_readable_sweep():
    plant = machine((2, 2), 2, 2)
    arguments = data(plant, 9, 4)
    fast, weights, _ = scaled(receding_horizon_plan, plant, *arguments)
    slow, _, _ = scaled(readable_plan, plant, *arguments)
    expected = quick(jax.grad(slow, argnums=(0, 1)))(weights, plant)
    close(quick(jax.grad(fast))(weights, plant), expected[0], 1e-9)  # the weights alone: predicted trajectories
    reverse = quick(jax.grad(fast, argnums=(0, 1)))(weights, plant)  # with the model
    close(reverse[0], expected[0], 1e-9)
    for one, other, where in zip((reverse[1].A, reverse[1].B), (expected[1].A, expected[1].B), plant.pattern[:2], strict=True):
        close(one * np.array(where), other * np.array(where), 1e-9)


@pytest.mark.parametrize(("inputs", "preview"), [(1, 1), (3, 2)])
def test_gradients_of_every_datum_of_a_coupled_plant(inputs, preview):
    plant = machine((3,), inputs, 2)
    Q, y_d, stage, R, terminal = data(plant, 6, preview)

    def value(plan_of):
        def symmetric(Q, y_d, stage, R, terminal, plant):
            Q, R, H = (M + jnp.swapaxes(M, -1, -2) for M in (Q, R, terminal.H))
            return scalar(plan_of)(plant, Q, y_d, stage, R, CostToGo(H, terminal.g))

        return symmetric

    arguments = Q, y_d, stage, R, terminal, plant
    expected = quick(jax.grad(value(readable_plan), argnums=(0, 1, 2, 3, 4, 5)))(*arguments)
    close(quick(jax.grad(value(receding_horizon_plan), argnums=(0, 1, 2, 3, 4)))(*arguments), expected[:5], 1e-9)
    moved = quick(jax.grad(value(receding_horizon_plan), argnums=5))(*arguments)
    close((moved.A, moved.B, moved.C), (expected[5].A, expected[5].B, expected[5].C), 1e-9)


def test_forward_and_reverse_mode_are_transposes():
    plant = machine((4,), 2, 2)
    Q, y_d, stage, R, terminal = data(plant, 9, 4)

    def plan(y_d, stage, g):
        return receding_horizon_plan(plant, Q, y_d, stage, R, CostToGo(terminal.H, g))

    point = y_d, stage, terminal.g
    push = tuple(jnp.asarray(np.random.default_rng(2).standard_normal(x.shape)) for x in point)
    out, pushed = quick(lambda *x: jax.jvp(plan, x, push))(*point)
    pull = jax.tree.map(lambda x: jnp.cos(jnp.arange(x.size, dtype=x.dtype)).reshape(x.shape), out)
    pulled = quick(lambda *x: jax.vjp(plan, *x)[1](pull))(*point)
    first, second = (sum(jnp.vdot(a, b) for a, b in zip(x, y, strict=True)) for x, y in (
        (jax.tree.leaves(pushed), jax.tree.leaves(pull)), (push, pulled)
    ))  # fmt: skip
    np.testing.assert_allclose(first, second, rtol=1e-11)


def test_a_family_of_models_is_a_loop_over_them():
    plant = machine((4,), 2, 2)
    value, weights, _ = scaled(receding_horizon_plan, plant, *data(plant, 9, 4))
    family = [jax.tree.map(lambda leaf, s=s: s * leaf, plant) for s in (0.9, 1.0, 1.1)]
    stacked = jax.tree.map(lambda *leaves: jnp.stack(leaves), *family)
    gradient = quick(jax.grad(value))
    close(quick(jax.vmap(jax.grad(value), (None, 0)))(weights, stacked), jnp.stack([gradient(weights, one) for one in family]), 1e-11)


def test_batches_in_both_orders():
    plant = machine((4,), 2, 2)
    arguments = data(plant, 9, 4)
    value, weights, _ = scaled(receding_horizon_plan, plant, *arguments)
    batch = jnp.stack([weights, 2 * weights, 0.5 * weights])
    gradient = quick(jax.grad(value))
    one_by_one = jnp.stack([gradient(row, plant) for row in batch])
    close(quick(jax.vmap(jax.grad(value), (0, None)))(batch, plant), one_by_one, 1e-11)
    summed = quick(jax.grad(lambda rows: jnp.sum(jax.vmap(value, (0, None))(rows, plant))))
    close(summed(batch), one_by_one, 1e-11)


def test_single_precision_stays_single():
    plant = machine((3, 4), 2, 2)
    single = jax.tree.map(lambda leaf: leaf.astype(jnp.float32), (plant, *data(plant, 9, 4)))
    plan = jax.jit(receding_horizon_plan)(*single)
    assert plan.F.dtype == plan.f.dtype == jnp.float32
    close(plan, jax.jit(receding_horizon_plan)(plant, *data(plant, 9, 4)), 1e-3)
