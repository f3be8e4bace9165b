"""The closed loop: plant and controller stepped together along a reference.

u(k), w(k+1) = controller(w(k), plan(k), measure(x(k)));   x(k+1) = plant(x(k), u(k))
"""

from collections.abc import Callable
from functools import partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jcontour._arrays import in_words, shape
from jcontour.controller import Controller, Plan, Sampled, check_preview
from jcontour.motion.references import Reference
from jcontour.plant import Plant, State

KINDS = {"plant": Plant, "controller": Controller, "reference": Reference}


class Rollout(eqx.Module):
    """A closed-loop run; row k is taken before control k acts."""

    state: Any
    output: Float[Array, "T m"]
    measurement: Any
    control: Float[Array, "T p"]
    memory: Any
    final_state: Any
    final_memory: Any

    def __repr__(self) -> str:
        control = f"control {shape(self.control)} from {in_words(self.control)}"
        return f"Rollout(output {shape(self.output)} [m], {control})"


def start_state(plant: Plant, reference: Reference) -> State:
    """State in which a run begins: at rest on the first sample, or in steady motion through it."""
    return plant.initial_state(reference.position[0], reference.start_increment)


def simulate(
    plant: Plant, controller: Controller, reference: Reference, state: State | None = None
) -> Rollout:
    """Run `controller` on `plant` along `reference` for its T steps.

    The run starts in `state`, or as the reference begins when none is given. Nothing is raised for
    a loop that is unstable: its numbers grow, to NaN at last, and `score` tells it as `diverged`.

    >>> from jcontour import contours, feed_laws, references
    >>> from jcontour.controllers import ContouringLQ, LQWeights
    >>> from jcontour.plants import bridgeport
    >>> machine, path = bridgeport(), contours.circle(1e-3)
    >>> controller = ContouringLQ(machine, LQWeights(3.0, 5.0, 1e-6), preview=5)
    >>> arc = feed_laws.constant_feed(path, 10e-3, machine.dt)
    >>> reference = references.along(path, arc, machine.dt, preview=5, at_rest=False)
    >>> rollout = simulate(machine, controller, reference)
    >>> rollout.output.shape == (reference.steps, 2)
    True

    Raises:
        ValueError: the reference has fewer preview samples than the controller needs, other axes
            or another sample period than the plant; it is a stack; the state is not one of the
            plant; or the plan of the controller has not a row for every step.
        TypeError: the arguments are swapped, or of another kind.
    """
    check_kinds("simulate", plant=plant, controller=controller, reference=reference)
    if reference.position.ndim != 2:
        raise ValueError(
            f"reference: simulate runs one, received a stack of {len(reference.position)}; "
            "evaluate runs stacks"
        )
    check_run(plant, controller, reference)
    return _simulated(plant, controller, reference, state)


@eqx.filter_jit
def _simulated(
    plant: Plant, controller: Controller, reference: Reference, state: State | None
) -> Rollout:
    return follow(plant, controller, controller.prepare(reference), reference, state)


@eqx.filter_jit
def prepared(controller: Controller, reference: Reference) -> Plan:
    """Plan of a controller for all T steps: a gain schedule, for instance.

    Raises:
        ValueError: the reference has fewer preview samples than the controller needs.
    """
    check_preview(controller, reference)
    return controller.prepare(reference)


def follow(
    plant: Plant,
    controller: Controller,
    plan: Plan,
    reference: Reference,
    state: State | None = None,
) -> Rollout:
    """Rollout with a plan that is prepared already, so that a family of plants can share it.

    Raises:
        ValueError: as `simulate`.
    """
    # every array of the plan has a row for every control step
    shapes = [jnp.shape(leaf) for leaf in jax.tree.leaves(plan)] or [()]
    wrong = [shape for shape in shapes if shape[:1] != (reference.steps,)]
    if wrong:
        ahead = reference.steps + reference.preview
        seen = ", all samples with their preview" if ahead in wrong[0][:1] else ""
        raise ValueError(
            f"prepare: {type(controller).__name__} needs to return one row for each of the "
            f"{reference.steps} control steps, received shape {wrong[0]}{seen}"
        )
    begin = partial(start_state, plant, reference)
    state = begin() if state is None else _given(state, begin)

    def step(carry, plan_k):
        state, memory = carry
        measurement = plant.measure(state)
        next_memory, control = controller.step(memory, plan_k, measurement)
        row = (state, plant.output(state), measurement, control, memory)
        return (plant.step(state, control), next_memory), row

    (final_state, final_memory), rows = jax.lax.scan(
        step, (state, controller.initial_memory(reference)), plan
    )
    return Rollout(*rows, final_state, final_memory)


def check_run(plant: Plant, controller: Sampled, reference: Reference) -> None:
    """Raise ValueError unless the reference suits the controller and the plant.

    The numbers of a family may be stacked, its sample period and axes too: they are all alike.
    """
    check_preview(controller, reference)
    dt = _first(plant.dt)
    if dt != reference.dt:
        raise ValueError(
            f"dt: the plant is sampled every {dt} s, the reference every {reference.dt} s"
        )
    wanted, axes = reference.position.shape[-1], _axes(plant)
    if axes is not None and axes != wanted:
        raise ValueError(f"reference: it has {wanted} axes, the plant {axes}")


def _first(number: Any) -> Any:
    """A number, or the first of a stack."""
    return np.ravel(number)[0] if np.ndim(number) else number


def _axes(plant: Plant) -> Any:
    """Axes of a plant, or of the one that it wraps, where it says them."""
    inside = getattr(plant, "plant", None)
    return _axes(inside) if isinstance(inside, Plant) else _first(getattr(plant, "axes", None))


def check_kinds(call: str, **given: Any) -> None:
    """Raise TypeError for arguments of a call, by name in their order, that are in another order.

    A plant or several, a controller, a reference or several are told from each other.
    """
    for name, one in given.items():
        kind = KINDS[name.removesuffix("s")]
        if not isinstance(one, kind):
            raise TypeError(
                f"{call}({', '.join(given)}): the {name} need{'' if name.endswith('s') else 's'} "
                f"to be a {kind.__name__}, received {type(one).__name__}"
            )


def _given(state: State, begin: Callable[[], State]) -> State:
    """The initial state that is given, if it is like that in which the plant begins."""
    try:
        own = eqx.filter_eval_shape(begin)
    except ValueError:  # a plant without steady motion: the state needs to be given
        return state
    if jax.tree.structure(state) != jax.tree.structure(own):
        raise ValueError(
            "state: the initial state needs to be built as initial_state of the plant builds it, "
            f"received {type(state).__name__}"
        )
    wanted, actual = ([*map(jnp.shape, jax.tree.leaves(one))] for one in (own, state))
    if wanted != actual:
        needed, received = (", ".join(map(str, shapes)) for shapes in (wanted, actual))
        raise ValueError(f"state: the initial state needs shape {needed}, received {received}")
    return jax.tree.map(_precise, state, own)


def _precise(value: Any, like: Any) -> Any:
    """Whole numbers as floating-point ones where the plant has those."""
    floating = jnp.issubdtype(like.dtype, jnp.floating)
    return jnp.asarray(value, like.dtype) if floating else value
