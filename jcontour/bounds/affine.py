"""Proof that a step is affine in what moves: its operations are looked at one by one.

A value is fixed (a number of the machine or the controller), planned (known before the run) or
moving (it depends on state, memory or disturbance). A sum of moving values, or their product with
values that do not move, is affine. Whatever else happens to a moving value is not known to be.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import numpy as np
from jax.extend.core import ClosedJaxpr, Jaxpr, Literal

# one moving operand or more; those that do not move only choose, move or shape
LINEAR = {
    *("neg", "add", "sub", "add_any", "reduce_sum", "cumsum", "copy", "copy_p", "real"),
    *("reshape", "transpose", "broadcast_in_dim", "squeeze", "expand_dims", "stack"),
    *("slice", "rev", "pad", "device_put", "optimization_barrier", "split", "concatenate"),
}
PRODUCTS = {"mul", "dot_general"}  # one moving operand
FIRST_ALONE = {"div", "dynamic_slice", "gather"}  # moving in front, indices and divisors do not
BOUNDS = {"max": -np.inf, "min": np.inf}  # with these they do nothing


class NotAffine(ValueError):
    """A step that is not known to be affine; the message names the operation."""


class _Value(NamedTuple):
    """What is known of a value; the number itself where it is fixed."""

    moving: bool
    number: Any = None


PLANNED, MOVING = _Value(moving=False), _Value(moving=True)


def check_affine(function: Callable[[Any, Any], Any], planned: Any, moving: Any) -> None:
    """Raise unless a function is affine in what moves, for every value of what is planned.

    Numbers that the function closes over are fixed. A clip at infinity does nothing.

    >>> import jax.numpy as jnp
    >>> check_affine(lambda gain, x: gain @ x + 1.0, jnp.eye(2), jnp.ones(2))
    >>> check_affine(lambda gain, x: jnp.sin(x), None, 1.0)
    Traceback (most recent call last):
        ...
    jcontour.bounds.affine.NotAffine: its step is not linear: sin of what moves

    Args:
        function: of the other two, traceable.
        planned: pytree of arrays, of which only the shapes count.
        moving: likewise.

    Raises:
        NotAffine: an operation on a moving value is not linear, or is not known.
    """
    closed = jax.make_jaxpr(function)(planned, moving)
    first, second = len(jax.tree.leaves(planned)), len(jax.tree.leaves(moving))
    _walk(closed.jaxpr, closed.consts, [PLANNED] * first + [MOVING] * second)


def _walk(jaxpr: Jaxpr, consts: Any, arguments: list[_Value]) -> list[_Value]:
    known = dict(zip(jaxpr.invars, arguments, strict=True))
    known |= {var: _Value(False, const) for var, const in zip(jaxpr.constvars, consts, strict=True)}

    def value(atom) -> _Value:
        return _Value(False, atom.val) if isinstance(atom, Literal) else known[atom]

    for equation in jaxpr.eqns:
        outcome = _outcome(equation, [value(atom) for atom in equation.invars])
        known |= dict(zip(equation.outvars, outcome, strict=True))
    return [value(atom) for atom in jaxpr.outvars]


def _outcome(equation: Any, operands: list[_Value]) -> list[_Value]:
    inner = _called(equation.params)
    if inner is not None:
        return _walk(inner.jaxpr, inner.consts, operands)
    count = len(equation.outvars)
    if any(one.moving for one in operands):
        return [_moved(equation, operands)] * count
    if any(one.number is None for one in operands):
        return [PLANNED] * count
    numbers = equation.primitive.bind(*(one.number for one in operands), **equation.params)
    numbers = numbers if equation.primitive.multiple_results else [numbers]
    return [_Value(False, number) for number in numbers]


def _called(params: dict[str, Any]) -> ClosedJaxpr | None:
    """Function that is called by name alone: a jit, or one with its own derivative."""
    if any(name in params for name in ("length", "cond_jaxpr", "branches")):
        return None  # loops and branches
    for name in ("jaxpr", "call_jaxpr"):
        if isinstance(params.get(name), ClosedJaxpr):
            return params[name]
    return None


def _moved(equation: Any, operands: list[_Value]) -> _Value:
    """The result of an operation on moving values, which is MOVING."""
    name = equation.primitive.name
    moving = [one.moving for one in operands]
    linear = (
        name in LINEAR
        or (name in PRODUCTS and sum(moving) == 1)
        or (name in FIRST_ALONE and moving[0] and sum(moving) == 1)
        or (name in ("select_n", "dynamic_update_slice") and _chosen(name, moving))
        or (name == "integer_pow" and equation.params["y"] == 1)
        or (
            name == "convert_element_type"
            and np.issubdtype(equation.params["new_dtype"], np.floating)
        )
        or (name in BOUNDS and _idle(operands, BOUNDS[name]))
    )
    if not linear:
        raise NotAffine(f"its step is not linear: {name} of what moves")
    return MOVING


def _chosen(name: str, moving: list[bool]) -> bool:
    """Whether what chooses stands still: the predicate, or the indices."""
    return not moving[0] if name == "select_n" else not any(moving[2:])


def _idle(operands: list[_Value], bound: float) -> bool:
    """Whether a maximum or minimum is taken with a bound that is never reached."""
    numbers = [one.number for one in operands if one.number is not None]
    return len(numbers) == 1 and bool(np.all(np.asarray(numbers[0]) == bound))
