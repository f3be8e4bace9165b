"""Largest values whose slope does not depend on how a program is compiled."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float


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
