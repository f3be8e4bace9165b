"""The GPU's plan against the readable sweep.

Without a GPU its kernels are interpreted, so the cases are tiny.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.controllers.lq.contouring_lq import (
    ContouringLQ,
    LQWeights,
    OutputTerminal,
    RiccatiTerminal,
)
from jcontour.devices import on_gpu
from jcontour.geometry.contours import circle
from jcontour.kernels.gpu import lane_plan as module
from jcontour.kernels.gpu.lane_plan import lane_plan
from jcontour.motion.references import along
from jcontour.plants import bridgeport
from jcontour.riccati.receding_horizon import CostToGo, output_cost, readable_plan
from jcontour.simulation.closed_loop import follow
from jcontour.simulation.evaluation import evaluate
from jcontour.simulation.metrics import score_signals

needs_gpu = pytest.mark.skipif(not on_gpu(), reason="no GPU")


def fast(plant, Q, y_d, stage, R, end):
    return lane_plan(plant.pattern, plant.A, plant.B, plant.C, Q, y_d, stage, R, end)


def readable(plant, Q, y_d, stage, R, end):
    steps = Q.shape[0] - stage.shape[0]
    cost = CostToGo(*end) if end else output_cost(plant, Q[-steps:], y_d[-steps:])
    plan = readable_plan(
        plant, Q, y_d, stage, R, cost if end else CostToGo(stage[-1] * cost.H, stage[-1] * cost.g)
    )
    return plan.F, plan.f


def case(problems, sizes, inputs, outputs, steps, preview, ended):
    plant = problems.machine(sizes, inputs, outputs)
    Q, y_d, stage, R, terminal = problems.data(plant, steps, preview)
    return plant, (Q, y_d, stage, R, tuple(terminal) if ended else ())


def scalar(plan_of, plant, end):
    """A number that depends on every gain, of everything that the plan is made from."""

    def value(Q, y_d, stage, R, end):
        Q, R = (M + jnp.swapaxes(M, -1, -2) for M in (Q, R))
        end = (end[0] + jnp.swapaxes(end[0], -1, -2), end[1]) if end else ()
        plan = plan_of(plant, Q, y_d, stage, R, end)
        numbers = jnp.concatenate([part.ravel() for part in plan])
        return jnp.sum(jnp.sin(numbers + jnp.arange(numbers.size, dtype=numbers.dtype)))

    return value


@pytest.mark.parametrize(
    ("sizes", "inputs", "outputs", "preview", "ended"),
    [
        pytest.param((2, 1), 2, 2, 3, True, marks=pytest.mark.slow),
        pytest.param((2,), 1, 2, 2, False, marks=pytest.mark.slow),
        ((1,), 1, 1, 1, True),
    ],
)
def test_equals_the_readable_sweep(problems, sizes, inputs, outputs, preview, ended):
    plant, arguments = case(problems, sizes, inputs, outputs, 4, preview, ended)
    moved = (0, 1, 2, 3, 4) if ended else (0, 1, 2, 3)
    found, wanted = (
        problems.quick(
            lambda *a, f=f: (f(plant, *a), jax.grad(scalar(f, plant, ended), moved)(*a))
        )(*arguments)
        for f in (fast, readable)
    )
    problems.close(found[0], wanted[0], 1e-11)
    found, wanted = found[1], wanted[1]
    problems.close(found, wanted, 1e-9)


@pytest.mark.slow
def test_a_model_that_moves(problems):
    plant, arguments = case(problems, (2,), 1, 1, 3, 2, False)

    def value(plan_of):
        return lambda plant, scale: sum(
            jnp.sum(jnp.sin(part)) for part in plan_of(plant, scale * arguments[0], *arguments[1:])
        )

    found, wanted = (
        problems.quick(jax.grad(value(f), (0, 1)))(plant, 2.0) for f in (fast, readable)
    )
    problems.close(found, wanted, 1e-9)


@pytest.mark.slow
def test_batches_and_long_previews(problems, monkeypatch):
    monkeypatch.setattr(module, "UNROLLED", 1)
    plant, arguments = case(problems, (1,), 1, 1, 3, 3, False)

    def value(scale):
        return scalar(fast, plant, False)(scale * arguments[0], *arguments[1:])

    scales = jnp.array([0.5, 2.0])
    batched = problems.quick(jax.vmap(jax.value_and_grad(value)))(scales)
    summed = problems.quick(jax.grad(lambda scales: jnp.sum(jax.vmap(value)(scales))))(scales)
    problems.close(batched[1], summed, 1e-13)
    wanted = jax.grad(
        lambda scale: scalar(readable, plant, False)(scale * arguments[0], *arguments[1:])
    )
    problems.close(summed, jnp.stack([wanted(scale) for scale in scales]), 1e-9)


@needs_gpu
@pytest.mark.parametrize(
    ("sizes", "inputs", "outputs", "preview", "ended"),
    [
        ((3, 5), 2, 2, 10, False),
        ((3, 5), 2, 2, 10, True),
        ((2, 3, 2), 3, 3, 2, False),
        ((3, 3, 3), 3, 3, 4, True),
        ((8,), 3, 3, 3, False),
    ],
)
def test_sizes_on_a_gpu(problems, sizes, inputs, outputs, preview, ended):
    plant, arguments = case(problems, sizes, inputs, outputs, 150, preview, ended)
    program = jax.jit(lambda *a: fast(plant, *a))
    plan = program(*arguments)
    problems.close(plan, jax.jit(lambda *a: readable(plant, *a))(*arguments), 1e-11)
    moved = (0, 1, 2, 3, 4) if ended else (0, 1, 2, 3)
    found, again, wanted = (
        jax.jit(jax.grad(scalar(f, plant, ended), moved))(*arguments)
        for f in (fast, fast, readable)
    )
    problems.close(found, wanted, 1e-9)
    for first, second in zip(
        jax.tree.leaves((plan, found)), jax.tree.leaves((program(*arguments), again)), strict=True
    ):
        assert np.array_equal(first, second)


def designs(dtype):
    reference = along(
        circle(1e-3), 2.5e-5 * np.arange(120), 5e-4, 10, at_rest=False
    )  # the paper's: errors of micrometres
    cast = (
        bridgeport(),
        reference,
        jnp.exp(jax.random.uniform(jax.random.key(0), (33, 3), float, -1.0, 1.0))
        * jnp.array([1, 1, 1e-10]),
    )
    return jax.tree.map(
        lambda leaf: leaf.astype(dtype) if jnp.issubdtype(leaf.dtype, jnp.floating) else leaf, cast
    )


def summary(metrics):
    return jnp.stack(
        [
            metrics.rms_contour_error,
            metrics.rms_projected_error,
            metrics.rms_tracking_error,
            metrics.rms_control,
        ]
    )


def by_kernels(terminal, plant, reference, weights):
    controller = ContouringLQ(plant, LQWeights(*weights), 10, terminal)
    plants, references = jax.tree.map(lambda leaf: leaf[None], (plant, reference))
    metrics = evaluate(plants, controller, references)
    return summary(jax.tree.map(lambda leaf: leaf[0, 0], metrics))


def by_the_book(terminal, plant, reference, weights):
    controller = ContouringLQ(plant, LQWeights(*weights), 10, terminal)
    Q = (weights[0] + weights[1]) * jnp.eye(2) - weights[1] * reference.tangent[
        :, :, None
    ] * reference.tangent[:, None, :]
    ends = slice(10, 10 + reference.steps)
    cost = terminal.cost(plant, controller.weights, Q, reference.position, ends)
    plan = readable_plan(plant, Q, reference.position, jnp.ones(10), weights[2] * jnp.eye(2), cost)
    rollout = follow(plant, controller, plan, reference)
    return summary(score_signals(rollout.output, rollout.control, reference))


@needs_gpu
@pytest.mark.parametrize("terminal", [OutputTerminal(), RiccatiTerminal()])
def test_a_sweep_of_designs_on_a_gpu(terminal):
    plant, reference, weights = designs(float)
    found, wanted = (
        jax.jit(
            jax.vmap(
                lambda w, f=f: (
                    f(terminal, plant, reference, w),
                    jax.jacrev(lambda w: f(terminal, plant, reference, w))(w),
                )
            )
        )(weights)
        for f in (by_kernels, by_the_book)
    )
    np.testing.assert_allclose(found[0], wanted[0], rtol=1e-11)
    slopes = [slope * weights[:, None, :] for slope in (found[1], wanted[1])]
    largest = jnp.max(jnp.abs(slopes[1]), axis=2, keepdims=True)  # of each design and metric
    assert float(jnp.max(jnp.abs(slopes[0] - slopes[1]) / largest)) < 1e-9


@needs_gpu
def test_single_precision_on_a_gpu():
    def value_and_slopes(plant, reference, weights):
        return jax.jit(
            jax.vmap(
                jax.value_and_grad(lambda w: by_kernels(OutputTerminal(), plant, reference, w)[1])
            )
        )(weights)

    (value, slope), (wanted, slope_wanted) = (
        value_and_slopes(*designs(jnp.float32)),
        value_and_slopes(*designs(float)),
    )
    assert value.dtype == slope.dtype == jnp.float32
    np.testing.assert_allclose(value, wanted, rtol=2e-3)
    weights = designs(float)[2]
    scale = jnp.max(jnp.abs(slope_wanted * weights), axis=1, keepdims=True)
    assert float(jnp.max(jnp.abs(slope - slope_wanted) * weights / scale)) < 1e-2
