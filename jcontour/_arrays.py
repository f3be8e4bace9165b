"""Values as arrays of JAX."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import dtypes
from jaxtyping import Array, Float, Shaped

from jcontour._tracing import is_concrete


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
