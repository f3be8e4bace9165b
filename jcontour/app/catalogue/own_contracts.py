"""What plants and controllers of the user's return: shapes and types, before anything is compiled.

They are traced piece by piece, so that a fault is named in the words of `Plant` and `Controller`.
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp

from jcontour.controller import Controller
from jcontour.motion.references import Reference
from jcontour.plant import Plant
from jcontour.simulation.closed_loop import start_state


class ContractError(ValueError):
    """A plant or controller that returns what it may not; one line."""


def check_plant(plant: Plant, axes: int) -> None:
    """Check the output and the state of a plant with one input for each axis.

    Raises:
        ContractError: the output has not one entry for each axis, or `step` changes the shapes or
            types of the state.
    """
    origin = jnp.zeros(axes)
    state = jax.eval_shape(lambda: plant.initial_state(origin, origin))
    output = eqx.filter_eval_shape(lambda state: _arrays(plant.output(state)), state)
    if not _is_vector(output, axes):
        raise ContractError(
            f"output needs shape ({axes},), received {_seen(output)}; a plant has two axes, "
            "or as many as its class says, as in axes = 3"
        )
    after = eqx.filter_eval_shape(lambda state: _arrays(plant.step(state, origin)), state)
    _check_kept("state", state, after)


def check_controller(
    plant: Plant, controller: Controller, reference: Reference, inputs: int
) -> None:
    """Check what `step` returns. A plan without a row for every step is left to `simulate`.

    Raises:
        ContractError: `step` returns no pair or a swapped one, the control has not one number for
            each of the inputs, or the memory changes its shapes or types.
    """

    def begun(plant: Plant, controller: Controller, reference: Reference) -> Any:
        measurement = plant.measure(start_state(plant, reference))
        memory = controller.initial_memory(reference)
        return _arrays((controller.prepare(reference), memory, measurement))

    plan, memory, measurement = eqx.filter_eval_shape(begun, plant, controller, reference)
    if {leaf.shape[:1] for leaf in jax.tree.leaves(plan)} != {(reference.steps,)}:
        return
    row = jax.tree.map(lambda leaf: jax.ShapeDtypeStruct(leaf.shape[1:], leaf.dtype), plan)
    stepped = eqx.filter_eval_shape(
        lambda controller, *seen: _arrays(controller.step(*seen)),
        controller,
        *(memory, row, measurement),
    )
    if not isinstance(stepped, tuple | list) or len(stepped) != 2:
        raise ContractError(f"step returns (memory, control), received {_seen(stepped)}")
    after, control = stepped
    if _is_vector(after, inputs) and _change(memory, after) and not _change(memory, control):
        raise ContractError("step returns (memory, control), received the two swapped")
    if not _is_vector(control, inputs):
        raise ContractError(f"step: the control needs shape ({inputs},), received {_seen(control)}")
    _check_kept("memory", memory, after)


def _check_kept(name: str, before: Any, after: Any) -> None:
    """Raise ContractError where a step changes the shapes or types of what it hands on."""
    change = _change(before, after)
    if change:
        raise ContractError(
            f"{name}{change} in step: initial_{name} and step need to return the same"
        )


def _change(before: Any, after: Any) -> str:
    """What is otherwise afterwards, in words; empty where nothing is."""
    if jax.tree.structure(before) != jax.tree.structure(after):
        return f" changes from {_seen(before)} to {_seen(after)}"
    pairs = zip(jax.tree.leaves_with_path(before), jax.tree.leaves(after), strict=True)
    for (path, old), new in pairs:
        if old.shape != new.shape:
            return f"{jax.tree_util.keystr(path)} changes from shape {old.shape} to {new.shape}"
        # a plain number, weak in JAX, becomes what it is added to
        if old.dtype != new.dtype and not old.weak_type:
            return f"{jax.tree_util.keystr(path)} changes from {old.dtype} to {new.dtype}"
    return ""


def _arrays(values: Any) -> Any:
    """The same with arrays in place of plain numbers."""
    return jax.tree.map(jnp.asarray, values)


def _is_vector(values: Any, size: int) -> bool:
    return getattr(values, "shape", None) == (size,)


def _seen(values: Any) -> str:
    """Shape of an array, or the shapes in a structure, in a few words."""
    if values is None or hasattr(values, "shape"):
        return str(getattr(values, "shape", None))
    shapes = jax.tree.map(lambda leaf: leaf.shape, values)
    words = f"{shapes}" if isinstance(values, tuple | list | dict) else type(values).__name__
    return words if len(words) <= 60 else f"a {type(values).__name__} of {len(values)}"
