"""Contracts of every plant and controller in the catalogue: a new entry is tested at once.

The laws of a controller share what is compiled: one step for the loop on the host, and a stack of
rollouts with the slopes of each. A controller that cannot keep a law says why in its class,
`laws_not_kept`.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.app.catalogue.entries import CONTROLLERS, MACHINES
from jcontour.controller import Controller, Memory, Wrapper
from jcontour.motion.references import Reference, from_samples
from jcontour.plant import Plant
from jcontour.plants.flexible_axis.axis import AxisParameters
from jcontour.simulation.closed_loop import Rollout, prepared, simulate, start_state
from jcontour.simulation.evaluation import member
from tests.canonical import STEPS
from tests.plants import PLANTS, first_machine

RESTART = 5  # sample at which a run is cut in two
SHIFT, SAME = 1.0, 1e-9  # [m]: whole counts of all encoders; what rounding leaves of it
ROUNDING = 1e-7  # of a difference over 2e-6, of values of order ten
# steps of a difference, and the weight of the value there: exact up to the fourth power
DIFFERENCE = {-2: 1 / 12, -1: -8 / 12, 1: 8 / 12, 2: -1 / 12}
STATE_STEP, NUMBER_STEP = 1e-4, 1e-6  # of 1e-6 in each state; relative in a controller's numbers


class Resumed(Wrapper):
    """A controller that goes on from a memory."""

    controller: Controller
    memory: Memory

    def initial_memory(self, reference):
        return self.memory

    def step(self, memory, plan, measurement):
        return self.controller.step(memory, plan, measurement)


@dataclass(frozen=True)
class Start:
    """A run before its first step: where it goes, from where, and what is remembered."""

    reference: Reference
    state: Any
    memory: Any


jax.tree_util.register_dataclass(Start)


@dataclass(frozen=True)
class Runs:
    """Runs of one controller that its laws are read from; each is made once."""

    plant: Plant
    controller: Controller
    path: Reference  # longer than a run by the sample at which one begins again

    def along_path(self, first: int = 0) -> Reference:
        """The reference of a run that begins at a sample of the path."""
        path, rows = self.path, slice(first, first + STEPS + self.path.preview)
        entry = path.position[first] - path.position[first - 1] if first else path.start_increment
        seen = (path.position[rows], path.tangent[rows], path.arc[rows], path.mask[rows])
        return Reference(*jax.device_put((*seen, entry)), path.contour, path.dt, STEPS)

    def standing(self) -> Reference:
        """The reference of a machine that stays at the origin."""
        moving = self.along_path()
        nowhere = np.zeros_like(moving.position)
        ahead = np.tile(np.eye(nowhere.shape[1])[0], (len(nowhere), 1))
        return from_samples(
            nowhere,
            ahead,
            moving.dt,
            moving.preview,
            moving.contour,
            in_motion=False,
            tolerance=float(moving.contour.size),
        )

    def started(self, reference: Reference, size: float) -> Start:
        """A run from the reference's start, every number of the state moved at random by a size."""
        state = shifted(eqx.filter_jit(start_state)(self.plant, reference), size)
        return Start(reference, state, self.controller.initial_memory(reference))

    @cached_property
    def begun(self) -> Start:
        return self.started(self.along_path(), 1e-6)

    @cached_property
    def rested(self) -> Start:
        return self.started(self.standing(), 0.0)

    @cached_property
    def resumed(self) -> Start:
        """The first run from a later sample on, as it was there."""
        state, memory = jax.tree.map(
            lambda rows: np.asarray(rows)[RESTART], (self.once.state, self.once.memory)
        )
        return Start(self.along_path(RESTART), state, memory)

    def alone(self, start: Start) -> Rollout:
        """A run step by step, on the host."""
        controller, reference, rows = Resumed(self.controller, start.memory), start.reference, []
        state, memory = start.state, controller.initial_memory(reference)
        plan = prepared(controller, reference)
        for k in range(reference.steps):
            row = jax.tree.map(lambda leaves, k=k: leaves[k], plan)
            after, kept, *seen = whole_step(self.plant, controller, state, memory, row)
            rows.append((state, *seen, memory))
            state, memory = after, kept
        columns = jax.tree.map(lambda *leaves: jnp.stack(leaves), *rows)
        return Rollout(*columns, state, memory)

    def errors(
        self, plant: Plant, references: Sequence[Reference]
    ) -> list[tuple[np.ndarray, np.ndarray]]:
        """What the outputs of a plant miss of every reference [m], and the controls."""
        there = replace(self, plant=plant)
        starts = [there.started(reference, 0.0) for reference in references]
        stack = starts + starts[:1] * (len(self.changes) - len(starts))
        nothing = [jax.tree.map(np.zeros_like, self.changes[0])] * len(stack)
        (_, found), _ = self.program(stacked(nothing), stacked(stack), plant)
        outputs, controls = np.asarray(found.output), np.asarray(found.control)
        return [
            (output - reference.position[:STEPS], control)
            for output, control, reference in zip(outputs, controls, references, strict=False)
        ]

    @cached_property
    def once(self) -> Rollout:
        return self.alone(self.begun)

    @cached_property
    def singly(self) -> list[Rollout]:
        return [self.once, self.alone(self.rested), self.alone(self.resumed)]

    @cached_property
    def moving(self) -> tuple[Any, Any]:
        """Numbers of the controller that may change, and all else; infinite ones are no limits."""
        return eqx.partition(
            self.controller, lambda leaf: eqx.is_inexact_array(leaf) and np.isfinite(leaf).all()
        )

    @cached_property
    def directions(self) -> tuple[Any, Any]:
        """In which the first run's state and the controller's numbers are moved."""
        random = np.random.default_rng(1)
        drawn = lambda leaf: random.standard_normal(np.shape(leaf))  # noqa: E731
        state, _ = eqx.partition(self.begun.state, eqx.is_inexact_array)
        return jax.tree.map(lambda leaf: 1e-6 * drawn(leaf), state), jax.tree.map(
            drawn, self.moving[0]
        )

    @cached_property
    def changes(self) -> list[Any]:
        """Of states and numbers: none for three runs, then those of the first one, both ways."""
        ways, none = self.directions, jax.tree.map(np.zeros_like, self.directions)
        changes = [none] * 3
        for step, way in ((STATE_STEP, (ways[0], none[1])), (NUMBER_STEP, (none[0], ways[1]))):
            for steps in DIFFERENCE:
                changes.append(jax.tree.map(lambda x, s=steps * step: s * x, way))
        return changes

    @cached_property
    def program(self) -> Any:
        """Changes, starts, plant -> values and rollouts of a stack of runs, slopes of each."""
        numbers, fixed = self.moving

        def value(change, start, plant):
            state = eqx.apply_updates(start.state, change[0])
            scaled = jax.tree.map(lambda leaf, c: leaf * (1 + c), numbers, change[1])
            resumed = Resumed(eqx.combine(scaled, fixed), start.memory)
            rollout = simulate(plant, resumed, start.reference, state)
            return size_of(rollout, start.reference), rollout

        slopes = jax.value_and_grad(value, has_aux=True)
        return eqx.filter_jit(eqx.filter_vmap(slopes, in_axes=(0, 0, None)))

    def run(self) -> tuple[tuple[Any, Rollout], Any]:
        """Values, rollouts and slopes of three runs and of the first one moved both ways."""
        starts = [self.begun, self.rested, self.resumed, *[self.begun] * 2 * len(DIFFERENCE)]
        return self.program(stacked(self.changes), stacked(starts), self.plant)

    @cached_property
    def together(self) -> tuple[tuple[Any, Rollout], Any]:
        return self.run()


def size_of(rollout: Rollout, reference: Reference):
    """A scalar that every output and every control is part of, whatever their units."""
    missed = rollout.output - reference.position[:STEPS]
    moved = jnp.diff(rollout.control, axis=0)
    return jnp.log(1e-30 + jnp.sum(missed**2)) + 0.1 * jnp.log(1e-30 + jnp.sum(moved**2))


def stacked(trees):
    return jax.tree.map(lambda *leaves: np.stack(leaves), *trees)


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


def assert_alike(found, wanted):
    """Every number of a rollout, to 1e-9 of the largest of its kind and to 1e-15 in SI units."""
    assert jax.tree.structure(found) == jax.tree.structure(wanted)
    for one, other in zip(jax.tree.leaves(found), jax.tree.leaves(wanted), strict=True):
        a, b = np.asarray(one), np.asarray(other)
        assert a.shape == b.shape and a.dtype == b.dtype
        largest = max(np.abs(b).max(initial=0.0), 1e-6)
        np.testing.assert_allclose(a, b, rtol=0, atol=1e-9 * largest)


def without_cogging(plant):
    """The plant without a force of the place."""

    def calm(node):
        if not isinstance(node, AxisParameters):
            return node
        waves = ("cogging_sine", "cogging_cosine")
        return eqx.tree_at(
            lambda p: [getattr(p, name) for name in waves], node, replace_fn=np.zeros_like
        )

    return jax.tree.map(calm, plant, is_leaf=lambda node: isinstance(node, AxisParameters))


def shift_of(plant, axes):
    """A metre along the axes where the plant is the same at any place; zero along the others."""
    return SHIFT * np.broadcast_to(plant.alike_everywhere, (axes,))


def laws_not_kept(controller) -> dict[str, str]:
    """Laws that a controller or one that it wraps excuses itself from, with the reason."""
    inside = getattr(controller, "controller", None)
    return {**(laws_not_kept(inside) if inside is not None else {}), **controller.laws_not_kept}


@eqx.filter_jit
def whole_step(plant, controller, state, memory, row):
    """The next state and memory; output, measurement and control of now."""
    measurement = plant.measure(state)
    kept, control = controller.step(memory, row, measurement)
    return plant.step(state, control), kept, plant.output(state), measurement, control


@pytest.fixture(
    scope="module",
    params=[pytest.param(name, marks=pytest.mark.xdist_group(name)) for name in CONTROLLERS],
)
def loop(closed_loop, request):
    """Runs of a controller; those of the one before are forgotten."""
    (smooth, true), controller, reference = closed_loop(request.param)
    fed = "state" if smooth is true else "outputs"
    plant = MACHINES[first_machine(request.param)]().nominal(fed)  # without noise: rest is rest
    return Runs(plant, controller, reference(STEPS + RESTART))


@pytest.fixture
def name(request):
    """Name of the controller."""
    return request.node.callspec.params["loop"]


@pytest.fixture
def keeps(loop):
    """Law -> the runs of the controller; the test is skipped where it excuses itself."""

    def of(law):
        why = laws_not_kept(loop.controller).get(law)
        if why:
            pytest.skip(why)
        return loop

    return of


def test_float64_and_the_same_bits_twice(keeps):
    loop = keeps("same bits")
    assert isinstance(loop.controller, Controller)
    for first, second in zip(numbers(loop.together), numbers(loop.run()), strict=True):
        assert first.dtype == np.float64
        np.testing.assert_array_equal(first, second)


def test_jit_is_no_jit(keeps):
    """The first steps with nothing compiled but the plan and single operations."""
    loop = keeps("jit")
    memory, state = jax.tree.map(jnp.asarray, (loop.begun.memory, loop.begun.state))
    plan = prepared(loop.controller, loop.begun.reference)
    controls = []
    for k in range(2):
        memory, control = loop.controller.step(
            memory, jax.tree.map(lambda rows, k=k: rows[k], plan), loop.plant.measure(state)
        )
        state = loop.plant.step(state, control)
        controls.append(control)
    wanted = np.asarray(loop.once.control)
    np.testing.assert_allclose(
        np.array(controls), wanted[:2], rtol=0, atol=1e-9 * np.abs(wanted).max()
    )


def test_the_loop_on_the_host_is_simulate(keeps):
    loop = keeps("host")
    (_, rollouts), _ = loop.together
    assert_alike(member(rollouts, 0), loop.once)


def test_vmap_is_a_loop(keeps):
    """A stack of runs is each of them alone, step by step."""
    loop = keeps("vmap")
    (_, rollouts), _ = loop.together
    for i, alone in enumerate(loop.singly):
        assert_alike(member(rollouts, i), alone)


def test_gradients_are_those_of_differences(keeps):
    """To the start state and to the controller's numbers."""
    loop = keeps("gradient")
    (values, _), slopes = loop.together
    assert all(np.isfinite(leaf).all() for leaf in numbers(slopes))
    values = np.asarray(values)
    for i, (size, way) in enumerate(zip((STATE_STEP, NUMBER_STEP), loop.directions, strict=True)):
        moved = values[3 + i * len(DIFFERENCE) :][: len(DIFFERENCE)]
        slope = sum(
            float(np.sum(np.asarray(a)[0] * b))
            for a, b in zip(jax.tree.leaves(slopes[i]), jax.tree.leaves(way), strict=True)
        )
        assert slope == pytest.approx(
            moved @ list(DIFFERENCE.values()) / size, rel=1e-5, abs=ROUNDING
        )


def test_rest_stays_rest(keeps):
    _, still, _ = keeps("rest").singly
    assert np.abs(still.control).max() <= 1e-12
    assert np.abs(still.output).max() <= 1e-18


def test_a_run_goes_on_from_any_sample(keeps):
    """Begun again from the state and the memory of a sample, with the rest of the reference."""
    loop = keeps("restart")
    begun, _, resumed = loop.singly
    left = STEPS - RESTART
    for rows in ("state", "output", "measurement", "control", "memory"):
        whole = jax.tree.map(lambda leaf: leaf[RESTART:], getattr(begun, rows))
        again = jax.tree.map(lambda leaf: leaf[:left], getattr(resumed, rows))
        assert_alike(again, whole)


def test_it_is_the_same_at_any_place(keeps):
    """A shift of the part in space changes no error, and rest stays rest there."""
    loop = keeps("shift")
    plant, path, still = without_cogging(loop.plant), loop.along_path(), loop.standing()
    shift = shift_of(plant, path.position.shape[1])
    assert shift.any()
    (here, moving), (there, _), (left, control) = loop.errors(
        plant,
        [
            replace(reference, position=reference.position + place[None])
            for reference, place in ((path, 0 * shift), (path, shift), (still, shift))
        ],
    )
    np.testing.assert_allclose(there, here, rtol=0, atol=SAME)
    assert np.abs(left).max() <= SAME
    held = np.broadcast_to(plant.holding_control(jnp.asarray(shift)), control.shape)
    rounded = 1e-9 * np.abs(held).max() + 1e-6 * np.abs(moving).max()
    np.testing.assert_allclose(control, held, rtol=0, atol=rounded)


def test_controls_are_those_that_were_kept(loop, name, kept_numbers):
    """No truth of its own: a change of a law is seen here, the truth is in the law's own tests."""
    rows = np.asarray(loop.once.control)[[0, 1, RESTART, STEPS - 1]]
    numbers = {f"{k} {i}": float(u) for k, row in enumerate(rows) for i, u in enumerate(row)}
    kept_numbers("controls", name, numbers, rel=1e-6, abs=1e-7 * float(np.abs(rows).max()))


@eqx.filter_jit
def begun(plant, position, increment):
    return plant.initial_state(position, increment)


@eqx.filter_jit
def advanced(plant, state, control):
    """Next state; output and measurement of this one."""
    return plant.step(state, control), plant.output(state), plant.measure(state)


@pytest.mark.parametrize("name", PLANTS)
def test_plants_move_as_was_kept(name, kept_numbers):
    """No truth of its own, as above: some steps under a control that changes."""
    plant, model = PLANTS[name].make(), PLANTS[name].machine().model
    control = np.array([0.1, -0.2, 0.3])[: model.inputs]
    state, way = begun(plant, np.full(model.axes, 1e-3), np.zeros(model.axes)), []
    for k in range(8):
        state, output, _ = advanced(plant, state, control * (-1.0) ** k)
        way.append(np.asarray(output) - 1e-3)
    numbers = {f"{k} {i}": float(y) for k, row in enumerate(way) for i, y in enumerate(row)}
    kept_numbers("plants", name, numbers, rel=1e-6, abs=1e-7 * float(np.abs(way).max()))


@pytest.mark.parametrize("name", PLANTS)
def test_plants_hold_still_and_keep_their_types(name):
    plant, model = PLANTS[name].make(), PLANTS[name].machine().model
    axes, control = model.axes, np.array([0.1, -0.2, 0.3])[: model.inputs]
    position, increment = np.array([1e-3, 2e-3])[:axes], np.array([1e-5, 0.0])[:axes]
    start, rest = begun(plant, position, increment), begun(plant, 0 * position, 0 * increment)
    after, again = advanced(plant, start, control), advanced(plant, start, control)
    np.testing.assert_allclose(after[1], position, rtol=1e-12)
    assert jax.tree.map(lambda leaf: (leaf.shape, leaf.dtype), after[0]) == jax.tree.map(
        lambda leaf: (leaf.shape, leaf.dtype), start
    )
    for a, b in zip(jax.tree.leaves(after), jax.tree.leaves(again), strict=True):
        np.testing.assert_array_equal(a, b)
    assert after[1].dtype == jnp.float64
    moved, *_ = advanced(plant, rest, 0 * control)
    still = all(
        np.array_equal(now, before)
        for now, before in zip(jax.tree.leaves(moved), jax.tree.leaves(rest), strict=True)
    )
    assert still is PLANTS[name].still


@pytest.mark.parametrize("name", [name for name, entry in PLANTS.items() if entry.still])
def test_plants_rest_anywhere(name):
    plant, axes = without_cogging(PLANTS[name].make()), PLANTS[name].machine().model.axes
    inputs = PLANTS[name].machine().model.inputs
    place = np.full(axes, 0.01) + shift_of(plant, axes)
    state = begun(plant, place, np.zeros(axes))
    held = np.broadcast_to(plant.holding_control(jnp.asarray(place)), (inputs,))
    for _ in range(3):
        state, output, _ = advanced(plant, state, held)
        np.testing.assert_allclose(output, place, rtol=0, atol=1e-12)
