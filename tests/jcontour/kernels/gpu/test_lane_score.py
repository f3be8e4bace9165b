"""The GPU's scored closed loop against the scan; without a GPU its kernels are interpreted."""

from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.devices import on_gpu
from jcontour.geometry.contours import circle
from jcontour.kernels.gpu.lane_score import LaneScore, lane_score, scanned_score
from jcontour.kernels.gpu.metric_lanes import lane_metrics
from jcontour.motion.references import along
from jcontour.simulation.metrics import SEARCH_REACH, score_signals


def case(problems, sizes, inputs, outputs, steps):
    plant, random = problems.machine(sizes, inputs, outputs), np.random.default_rng(3)
    shapes = (steps, inputs, plant.states), (steps, inputs), (plant.states,), (steps, outputs)
    F, f, start, reference = (random.standard_normal(shape) for shape in shapes)
    return plant, (0.1 * F, f, start, (reference, np.arange(steps) != 1))


def numbers(y, u, reference):
    """A number and a flag of every run."""
    behind = tuple(range(1, y.ndim - 1))
    wanted, mask = (
        jnp.expand_dims(reference[0], behind),
        jnp.expand_dims(reference[1], (*behind, y.ndim - 1)),
    )
    error = jnp.where(mask, y - wanted, 0.0)
    return {
        "error": jnp.sum(jnp.sin(error), (0, -1)),
        "control": jnp.sum(u**2, (0, -1)),
        "far": jnp.max(jnp.abs(error), (0, -1)) > 1.0,
    }


score = LaneScore(numbers)


def kernel(plant, *run):
    return lane_score(plant.pattern, score, plant.A, plant.B, plant.C, *run)


def scan(plant, *run):
    return scanned_score(score, plant.A, plant.B, plant.C, *run)


def number(run):
    def value(plant, *arguments):
        found = run(plant, *arguments)
        return found["error"] + 0.1 * found["control"]

    return value


@pytest.mark.slow
@pytest.mark.parametrize(
    ("sizes", "inputs", "outputs", "steps"), [((2, 1), 2, 2, 5), ((3,), 1, 2, 4)]
)
def test_equals_the_scan(problems, sizes, inputs, outputs, steps):
    plant, run = case(problems, sizes, inputs, outputs, steps)
    problems.close(problems.quick(kernel)(plant, *run), problems.quick(scan)(plant, *run), 1e-13)
    problems.close(
        *(problems.quick(jax.grad(number(f), (1, 2, 3)))(plant, *run) for f in (kernel, scan)),
        1e-12,
    )


def test_a_plant_or_a_reference_that_moves(problems):
    plant, run = case(problems, (2,), 1, 1, 4)

    def value(run_of):
        return lambda plant, shift: number(run_of)(plant, *run[:3], (run[3][0] + shift, run[3][1]))

    problems.close(
        *(problems.quick(jax.grad(value(f), (0, 1)))(plant, 0.1) for f in (kernel, scan)), 1e-12
    )


@pytest.mark.slow
def test_a_family_shares_a_plan(problems):
    plant, (F, f, start, (wanted, mask)) = case(problems, (2,), 1, 1, 4)
    family = jax.tree.map(
        lambda leaf: leaf[None] * jnp.array([0.9, 1.0, 1.1]).reshape(3, *[1] * leaf.ndim), plant
    )

    def spread(run):
        def of_family(F, f, starts):
            def of_one(start, wanted):
                return jax.vmap(lambda one: number(run)(one, F, f, start, (wanted, mask)))(family)

            return jnp.sum(jnp.cos(jax.vmap(of_one)(starts, jnp.stack([wanted, -wanted]))))

        return problems.quick(jax.value_and_grad(of_family, (0, 1, 2)))

    starts = jnp.stack([start, -start])
    problems.close(spread(kernel)(F, f, starts), spread(scan)(F, f, starts), 1e-12)


@pytest.mark.slow
def test_only_the_reference_differs(problems):
    plant, (F, f, start, (wanted, mask)) = case(problems, (2,), 1, 1, 4)
    batch = jnp.stack([wanted, 2 * wanted])

    def runs(run):
        return problems.quick(
            jax.vmap(
                lambda wanted: jax.value_and_grad(number(run), 2)(
                    plant, F, f, start, (wanted, mask)
                )
            )
        )

    problems.close(runs(kernel)(batch), runs(scan)(batch), 1e-12)


@pytest.mark.slow
def test_metrics_by_lanes_with_their_derivative(problems):
    plant, steps = problems.machine((2, 2), 2, 2), 12
    arc = np.linspace(0.0, 0.05, steps)
    reference = along(circle(1e-2), arc, plant.dt, 0, at_rest=False)
    random = np.random.default_rng(0)
    F, f = (jnp.asarray(random.standard_normal(size)) for size in ((steps, 2, 4), (steps, 2)))
    readable = partial(score_signals, window=(2, 11))
    quick = LaneScore(readable, partial(lane_metrics, SEARCH_REACH, (2, 11)))

    def runs(score):
        def of_one(a, shift):
            moved = replace(reference, start_increment=reference.start_increment + shift)

            def value(f):
                model = plant.A, plant.B, plant.C
                run = 1e-3 * F, 1e-3 * f, jnp.zeros(4), moved
                found = lane_score(plant.pattern, score, *model, *run)
                numbers = jax.tree.leaves(found)
                return numbers[0] + numbers[9], found

            return jax.value_and_grad(value, has_aux=True)(a * f)

        both = jax.vmap(jax.vmap(of_one, (0, None)), (None, 0))
        return problems.quick(both)(jnp.array([1.0, -2.0]), jnp.array([0.0, 1e-3]))

    problems.close(runs(quick), runs(LaneScore(readable)), 1e-10)


@pytest.mark.skipif(not on_gpu(), reason="no GPU")
def test_many_runs_on_a_gpu(problems):
    plant, (F, f, start, reference) = case(problems, (6, 5, 5), 3, 3, 200)
    batch = jnp.linspace(0.0, 1.0, 77)

    def runs(run):
        def of_one(a):
            return run(plant, a * F, f, start, reference), jax.grad(number(run), (1, 2, 3))(
                plant, a * F, f, start, reference
            )

        return jax.jit(lambda: jax.vmap(of_one)(batch))

    found, again, wanted = runs(kernel)(), runs(kernel)(), runs(scan)()
    problems.close(found, wanted, 1e-11)
    assert all(
        np.array_equal(a, b)
        for a, b in zip(jax.tree.leaves(found), jax.tree.leaves(again), strict=True)
    )
