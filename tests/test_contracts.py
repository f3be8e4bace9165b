"""What every plant and every controller of the catalogue keeps to: a new entry is tested by being there."""

from functools import cache

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from experiments.catalogue import CONTROLLERS, PLANTS
from experiments.machines import bridgeport_machine
from jcontour.contours import circle
from jcontour.controller import Controller
from jcontour.controllers.contouring_lq import LQWeights
from jcontour.evaluation import member, stack_references
from jcontour.metrics import score
from jcontour.plants.wrappers import Encoders
from jcontour.references import along, from_samples
from jcontour.simulation import simulate

STEPS, PREVIEW, DT = 5, 3, 0.5e-3
QUICK = ("contouring-lq",)  # the others compile for half a minute each on a busy machine


def some_slow(names):
    return [pytest.param(name, marks=[pytest.mark.slow] * (name not in QUICK)) for name in names]


SMOOTH = [name for name, entry in CONTROLLERS.items() if entry.smooth]


def on_circle(radius=1e-3):
    return along(circle(radius), 2.5e-5 * np.arange(STEPS), DT, PREVIEW, at_rest=False)


@cache
def loop(name):
    """Plant, controller and reference of an entry."""
    machine, entry = bridgeport_machine(), CONTROLLERS[name]
    plant = machine.model if entry.measures == "state" else Encoders(machine.model)
    return plant, entry.make(machine, LQWeights(3.0, 5.0, 2e-9), PREVIEW), on_circle()


def disturbed_start(plant, reference):
    start = plant.initial_state(reference.position[0], reference.start_increment)
    return start + 1e-6 * np.random.default_rng(0).standard_normal(start.shape)


@cache
def ran(name):
    plant, controller, reference = loop(name)
    return simulate(plant, controller, reference, disturbed_start(plant, reference))


def numbers(tree):
    return [np.asarray(leaf) for leaf in jax.tree.leaves(eqx.filter(tree, eqx.is_array))]


@pytest.mark.parametrize("name", some_slow(CONTROLLERS))
def test_jit_is_no_jit(name):
    """The same loop with nothing compiled but single operations."""
    plant, controller, reference = loop(name)
    memory, state = controller.initial_memory(reference), disturbed_start(plant, reference)
    plan = controller.prepare(reference)
    controls = []
    for k in range(2):
        memory, control = controller.step(memory, jax.tree.map(lambda rows, k=k: rows[k], plan), plant.measure(state))
        state = plant.step(state, control)
        controls.append(control)
    wanted = np.asarray(ran(name).control)
    np.testing.assert_allclose(np.array(controls), wanted[:2], rtol=0, atol=1e-9 * np.abs(wanted).max())


@pytest.mark.parametrize("name", some_slow(CONTROLLERS))
def test_vmap_over_references_is_a_loop(name):
    plant, controller, reference = loop(name)
    stacked = stack_references([reference, on_circle(2e-3)])
    batched = jax.jit(jax.vmap(lambda r: simulate(plant, controller, r)))(stacked)
    for i in range(2):
        for found, wanted in zip(numbers(member(batched, i)), numbers(simulate(plant, controller, member(stacked, i))), strict=True):
            np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-9 * max(np.abs(wanted).max(), 1e-30))


@pytest.mark.parametrize("name", some_slow(SMOOTH))
def test_gradients_are_those_of_differences(name):
    """Of a scalar of the metrics, to the start state and to the controller's numbers."""
    plant, controller, reference = loop(name)
    start = disturbed_start(plant, reference)
    moving, fixed = eqx.partition(controller, eqx.is_inexact_array)

    @jax.jit
    def value(state, change):
        scaled = jax.tree.map(lambda leaf, c: leaf * (1 + c), moving, change)  # relative: numbers of any size alike
        metrics = score(simulate(plant, eqx.combine(scaled, fixed), reference, state), reference)
        return jnp.log(metrics.rms_contour_error) + jnp.log(metrics.rms_tracking_error) + 0.1 * jnp.log(metrics.rms_increment)

    random = np.random.default_rng(1)
    none = jax.tree.map(jnp.zeros_like, moving)
    slopes = jax.jit(jax.grad(value, argnums=(0, 1)))(start, none)
    assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(slopes))
    direction = 1e-6 * random.standard_normal(start.shape)
    h = 1e-4
    difference = float(value(start + h * direction, none) - value(start - h * direction, none)) / (2 * h)
    assert float(slopes[0] @ direction) == pytest.approx(difference, rel=1e-5)
    change = jax.tree.map(lambda leaf: jnp.asarray(random.standard_normal(leaf.shape)), moving)
    step = 1e-6
    ahead, behind = (float(value(start, jax.tree.map(lambda c, s=s: s * step * c, change))) for s in (1, -1))
    slope = sum(float(jnp.sum(a * b)) for a, b in zip(jax.tree.leaves(slopes[1]), jax.tree.leaves(change), strict=True))
    assert slope == pytest.approx((ahead - behind) / (2 * step), rel=1e-5)


@pytest.mark.parametrize("name", CONTROLLERS)
def test_float64_throughout_and_the_same_bits_twice(name):
    plant, controller, reference = loop(name)
    again = simulate(plant, controller, reference, disturbed_start(plant, reference))
    for first, second in zip(numbers(ran(name)), numbers(again), strict=True):
        assert first.dtype == np.float64
        np.testing.assert_array_equal(first, second)
    assert isinstance(controller, Controller) and controller.preview == PREVIEW


@pytest.mark.parametrize("name", CONTROLLERS)
def test_a_zero_reference_at_rest_gives_zero_control(name):
    plant, controller, moving = loop(name)
    nowhere = np.zeros((STEPS + PREVIEW, 2))
    still = from_samples(nowhere, np.tile([1.0, 0.0], (STEPS + PREVIEW, 1)), DT, PREVIEW, moving.contour, in_motion=False)
    rollout = simulate(plant, controller, still)
    assert np.abs(rollout.control).max() <= 1e-12
    assert np.abs(rollout.output).max() <= 1e-18


@pytest.mark.parametrize("name", PLANTS)
def test_plants_hold_still_and_keep_their_types(name):
    plant = PLANTS[name].make()
    start = eqx.filter_jit(plant.initial_state)(jnp.array([1e-3, 2e-3]), jnp.array([1e-5, 0.0]))
    np.testing.assert_allclose(plant.output(start), [1e-3, 2e-3], rtol=1e-12)

    @jax.jit
    def advance(state):
        return plant.step(state, jnp.array([0.1, -0.2])), plant.output(state), plant.measure(state)

    after, again = advance(start), advance(start)
    assert jax.tree.map(lambda leaf: (leaf.shape, leaf.dtype), after[0]) == jax.tree.map(lambda leaf: (leaf.shape, leaf.dtype), start)
    for a, b in zip(jax.tree.leaves(after), jax.tree.leaves(again), strict=True):
        np.testing.assert_array_equal(a, b)
    assert after[1].dtype == jnp.float64
    rest = plant.initial_state(jnp.zeros(2), jnp.zeros(2))
    moved = eqx.filter_jit(plant.step)(rest, jnp.zeros(2))
    assert all(not np.any(leaf) for leaf in jax.tree.leaves(moved))
