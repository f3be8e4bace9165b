"""Contracts of every plant and controller in the catalogue: a new entry is tested at once."""

from functools import cache, partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from experiments.catalogue.choices import first_machine
from experiments.catalogue.controllers import CONTROLLERS
from experiments.catalogue.machines import MACHINES
from experiments.catalogue.plants import PLANTS
from jcontour.controller import Controller
from jcontour.host.loop import loop as loop_on_the_host
from jcontour.motion.references import from_samples
from jcontour.simulation.closed_loop import simulate
from jcontour.simulation.evaluation import member, stack_references
from jcontour.simulation.metrics import score

STEPS = 5
OF_EACH_KIND = (
    "contouring-lq",
    "gantry-cascade",
)
WITH_A_MEMORY = ("linear-cascade",)  # an increment of its own

ROUNDING = 1e-7  # of a difference over 2e-6, of values of order ten


def some_slow(names, quick):
    return [pytest.param(name, marks=[pytest.mark.slow] * (name not in quick)) for name in names]


SMOOTH = [name for name, entry in CONTROLLERS.items() if entry.smooth]


@pytest.fixture(scope="session")
def loop(closed_loop):
    def of(name):
        (plant, _), controller, reference = closed_loop(name)
        return plant, controller, reference(STEPS)

    return of


@pytest.fixture(scope="session")
def ran(loop):
    @cache
    def of(name):
        plant, controller, reference = loop(name)
        return simulate(plant, controller, reference, disturbed_start(plant, reference))

    return of


def disturbed_start(plant, reference, size=1e-6):
    position = np.asarray(reference.position)[0]
    start = eqx.filter_jit(plant.initial_state)(position, reference.start_increment)
    return shifted(start, size)


def undisturbed_start(plant, reference):
    """That of `simulate`, given to it: the program is that of a start beside it."""
    return disturbed_start(plant, reference, 0.0)


def shifted(state, size):
    """A state with every number moved at random, counters left alone."""
    random = np.random.default_rng(0)

    def moved(x):
        if not jnp.issubdtype(x.dtype, jnp.inexact):
            return x
        return np.asarray(x) + size * random.standard_normal(x.shape)

    return jax.tree.map(moved, state)


def numbers(tree):
    return [np.asarray(leaf) for leaf in jax.tree.leaves(eqx.filter(tree, eqx.is_inexact_array))]


@pytest.mark.slow
@pytest.mark.parametrize("name", CONTROLLERS)
def test_jit_is_no_jit(loop, ran, name):
    """The same loop with nothing compiled but single operations."""
    plant, controller, reference = loop(name)
    memory, state = controller.initial_memory(reference), disturbed_start(plant, reference)
    plan = controller.prepare(reference)
    controls = []
    for k in range(2):
        memory, control = controller.step(
            memory, jax.tree.map(lambda rows, k=k: rows[k], plan), plant.measure(state)
        )
        state = plant.step(state, control)
        controls.append(control)
    wanted = np.asarray(ran(name).control)
    np.testing.assert_allclose(
        np.array(controls), wanted[:2], rtol=0, atol=1e-9 * np.abs(wanted).max()
    )


@pytest.mark.parametrize("name", some_slow(CONTROLLERS, WITH_A_MEMORY))
def test_the_loop_on_the_host_is_simulate(loop, ran, name):
    plant, controller, reference = loop(name)
    found = loop_on_the_host(plant, controller, reference, disturbed_start(plant, reference))
    for leaf, other in zip(jax.tree.leaves(found), jax.tree.leaves(ran(name)), strict=True):
        a, b = np.asarray(leaf), np.asarray(other)
        assert a.shape == b.shape and a.dtype == b.dtype
        largest = max(1.0, np.abs(b).max(initial=0.0))
        np.testing.assert_allclose(a, b, rtol=0, atol=1e-12 * largest)


@pytest.mark.slow
@pytest.mark.parametrize("name", CONTROLLERS)
def test_vmap_over_references_is_a_loop(closed_loop, name):
    (plant, _), controller, reference = closed_loop(name)
    stacked = stack_references([reference(STEPS), reference(STEPS - 1)])
    batched = jax.jit(jax.vmap(lambda r: simulate(plant, controller, r)))(stacked)
    for i in range(2):
        one = member(stacked, i)
        alone = simulate(plant, controller, one, undisturbed_start(plant, one))
        for found, wanted in zip(numbers(member(batched, i)), numbers(alone), strict=True):
            np.testing.assert_allclose(
                found, wanted, rtol=0, atol=1e-9 * max(np.abs(wanted).max(), 1e-30)
            )


@pytest.mark.slow
@pytest.mark.parametrize("name", SMOOTH)
def test_gradients_are_those_of_differences(loop, name):
    """Of a scalar of the metrics, to the start state and to the controller's numbers."""
    plant, controller, reference = loop(name)
    start, counters = eqx.partition(disturbed_start(plant, reference), eqx.is_inexact_array)
    moving, fixed = eqx.partition(
        controller, lambda leaf: eqx.is_inexact_array(leaf) and np.isfinite(leaf).all()
    )  # no limit: none to move
    error = (
        "rms_tracking_error"
        if MACHINES[first_machine(name)]().error == "tracking"
        else "rms_contour_error"
    )

    @jax.jit
    @partial(jax.value_and_grad, argnums=(0, 1))
    def scored(state, change):
        # relative: numbers of any size alike
        scaled = jax.tree.map(lambda leaf, c: leaf * (1 + c), moving, change)
        run = simulate(plant, eqx.combine(scaled, fixed), reference, eqx.combine(state, counters))
        metrics = score(run, reference)
        return (
            jnp.log(getattr(metrics, error))
            + jnp.log(metrics.rms_tracking_error)
            + 0.1 * jnp.log(metrics.rms_increment)
        )

    def along(tree, direction, size):
        return jax.tree.map(lambda x, d: x + size * d, tree, direction)

    random = np.random.default_rng(1)
    none = jax.tree.map(jnp.zeros_like, moving)
    _, slopes = scored(start, none)
    assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(slopes))
    direction = jax.tree.map(lambda leaf: 1e-6 * random.standard_normal(leaf.shape), start)
    h = 1e-4
    ahead, behind = (float(scored(along(start, direction, s), none)[0]) for s in (h, -h))
    difference = (ahead - behind) / (2 * h)
    assert product(slopes[0], direction) == pytest.approx(difference, rel=1e-5, abs=ROUNDING)
    change = jax.tree.map(lambda leaf: jnp.asarray(random.standard_normal(leaf.shape)), moving)
    step = 1e-6
    ahead, behind = (float(scored(start, along(none, change, s))[0]) for s in (step, -step))
    difference = (ahead - behind) / (2 * step)
    assert product(slopes[1], change) == pytest.approx(difference, rel=1e-5, abs=ROUNDING)


def product(slopes, change):
    return sum(
        float(jnp.sum(a * b))
        for a, b in zip(jax.tree.leaves(slopes), jax.tree.leaves(change), strict=True)
    )


@pytest.mark.parametrize("name", some_slow(CONTROLLERS, OF_EACH_KIND))
def test_float64_and_the_same_bits_twice_and_zero_control_at_rest(closed_loop, name):
    """On the true plant; at rest along a zero reference. The three runs are one program."""
    (_, plant), controller, reference = closed_loop(name)
    moving = reference(STEPS)
    once, again = (
        simulate(plant, controller, moving, disturbed_start(plant, moving)) for _ in range(2)
    )
    for first, second in zip(numbers(once), numbers(again), strict=True):
        assert first.dtype == np.float64
        np.testing.assert_array_equal(first, second)
    assert isinstance(controller, Controller)
    nowhere = np.zeros_like(moving.position)
    ahead = np.tile(np.eye(nowhere.shape[1])[0], (len(nowhere), 1))
    contour = moving.contour
    still = from_samples(
        nowhere, ahead, moving.dt, moving.preview, contour, False, tolerance=float(contour.size)
    )
    rollout = simulate(plant, controller, still, undisturbed_start(plant, still))
    assert np.abs(rollout.control).max() <= 1e-12
    assert np.abs(rollout.output).max() <= 1e-18


@pytest.mark.parametrize("name", some_slow(PLANTS, PLANTS.keys() - {"gantry-friction"}))
def test_plants_hold_still_and_keep_their_types(name):
    plant, model = PLANTS[name].make(), PLANTS[name].machine().model
    axes, control = model.axes, np.array([0.1, -0.2, 0.3])[: model.inputs]
    position, increment = np.array([1e-3, 2e-3])[:axes], np.array([1e-5, 0.0])[:axes]
    begin = eqx.filter_jit(plant.initial_state)
    start, rest = begin(position, increment), begin(0 * position, 0 * increment)
    np.testing.assert_allclose(plant.output(start), position, rtol=1e-12)

    @jax.jit
    def advance(state, control):
        return plant.step(state, control), plant.output(state), plant.measure(state)

    after, again = advance(start, control), advance(start, control)
    assert jax.tree.map(lambda leaf: (leaf.shape, leaf.dtype), after[0]) == jax.tree.map(
        lambda leaf: (leaf.shape, leaf.dtype), start
    )
    for a, b in zip(jax.tree.leaves(after), jax.tree.leaves(again), strict=True):
        np.testing.assert_array_equal(a, b)
    assert after[1].dtype == jnp.float64
    moved, *_ = advance(rest, 0 * control)
    still = all(
        np.array_equal(now, before)
        for now, before in zip(jax.tree.leaves(moved), jax.tree.leaves(rest), strict=True)
    )
    assert still is PLANTS[name].still
