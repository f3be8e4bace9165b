"""Values as arrays of JAX, traced or not, their largest, and arrays as short words."""

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import dtypes
from jax.core import Tracer
from jaxtyping import Array, Float, Shaped

WHOLE = (np.ndarray, np.generic, jax.Array, float, int)


def is_concrete(*values) -> bool:
    """Whether every value is a number that the host can look at, none a tracer of JAX."""
    return not any(isinstance(value, Tracer) for value in values)


def placed(values: Shaped[np.ndarray, "..."]) -> Shaped[Array, "..."]:
    """NumPy's array as one of JAX, in single precision where JAX has no other.

    With its type said, JAX compiles no program for its shape.
    """
    return jnp.asarray(values, dtypes.canonicalize_dtype(values.dtype))


def floating(value: Any, name: str = "value") -> Float[Array, "..."]:
    """Numbers as floating-point array; those that are floating already keep their precision.

    Raises:
        ValueError: a number is complex: its imaginary part would be lost.
    """
    if any(isinstance(leaf, jax.Array) for leaf in jax.tree.leaves(value)):
        array = jnp.asarray(value)
        _check_real(array.dtype, name)
        return array if jnp.issubdtype(array.dtype, jnp.floating) else array.astype(float)
    values = np.asarray(value)  # no weak types, which were a program of their own
    _check_real(values.dtype, name)
    return placed(values if np.issubdtype(values.dtype, np.floating) else values.astype(float))


def _check_real(dtype: Any, name: str) -> None:
    if np.issubdtype(dtype, np.complexfloating):
        raise ValueError(f"{name}: needs real numbers, received complex ones")


def ranked(value: Any, rank: int) -> Float[Array, "..."]:
    """Numbers as floating-point array of at least this rank, the new axes in front."""
    if not is_concrete(*jax.tree.leaves(value)):
        array = jnp.asarray(value, float)
        return jnp.expand_dims(array, tuple(range(rank - array.ndim)))
    return placed(np.array(value, float, ndmin=rank))


def largest(values: Float[Array, "n *rest"]) -> Float[Array, "*rest"]:
    """Largest value over the first axis; its slope is that of the first place that has it.

    `jnp.max` finds the place again by `values == max`. A compiler may compute the values a second
    time for that, with other rounding; then no place is equal, and the slope is 0 / 0.

    >>> largest(jnp.array([[1.0, 5.0], [3.0, 2.0]])).tolist()
    [3.0, 5.0]

    Args:
        values: without any, the result is 0: of magnitudes.
    """
    if values.shape[0] == 0:
        return jnp.zeros(values.shape[1:], values.dtype)
    return _largest(values)


@jax.custom_jvp
def _largest(values):
    return jnp.max(values, axis=0)


@_largest.defjvp
def _slope(values, slopes):
    place = jnp.argmax(values[0], axis=0)[None]
    return _largest(*values), jnp.take_along_axis(slopes[0], place, axis=0)[0]


def in_words(value: Any, unit: str = "", scale: float = 1.0) -> str:
    """A value in words: one number with its unit, or the ends of an array.

    Where there is no value, as under `jit`, it is the type and the shape.

    >>> in_words(np.array(3.1e-7), "um", 1e6), in_words(np.array([1.0, 2.0]), "s")
    ('0.31 um', '1 to 2 s')

    Args:
        value: number or array.
        unit: that it is printed in.
        scale: of one SI unit in that unit.
    """
    if isinstance(value, Tracer) or not isinstance(value, WHOLE):
        return eqx.tree_pformat(value)
    numbers = scale * np.asarray(value)
    if numbers.size == 0:
        return "none"
    ends = dict.fromkeys(f"{one:.4g}" for one in (numbers.min(), numbers.max()))
    return f"{' to '.join(ends)} {unit}".strip()


def shape(value: Any) -> str:
    """Shape of an array; what else it is where it has none.

    >>> shape(np.zeros((3, 2)))
    '(3, 2)'
    """
    return str(tuple(value.shape)) if hasattr(value, "shape") else eqx.tree_pformat(value)


def check_signs(
    module: Any, positive: Sequence[str] = (), not_negative: Sequence[str] = ()
) -> None:
    """Raise ValueError unless fields are finite, and above or at least zero; traced ones pass."""
    for name in (*positive, *not_negative):
        value = getattr(module, name)
        if is_concrete(value):
            numbers = np.asarray(value)
            enough = numbers > 0 if name in positive else numbers >= 0
            if not np.all(np.isfinite(numbers) & enough):
                bound = "above" if name in positive else "at least"
                raise ValueError(f"{name}: needs to be finite and {bound} zero, received {value}")


def check_above_zero(**values: Any) -> None:
    """Raise ValueError unless numbers are finite and above zero; traced ones pass."""
    check_signs(SimpleNamespace(**values), positive=tuple(values))


def whole_number(name: str, value: int | float, least: int = 0) -> int:
    """The value as an int; ValueError unless it is a whole number of at least so much."""
    if not (value % 1 == 0 and value >= least):
        raise ValueError(f"{name}: needs a whole number of at least {least}, received {value}")
    return int(value)
