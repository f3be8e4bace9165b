"""Sums of products over numbers of any kind, where those that are known to be zero cost nothing.

A number is a vector over the lanes of a GPU's kernel, one of a straight-line program
(`native.straight_line`), or a float of Python.
"""

from typing import Any

import jax
import jax.numpy as jnp

from jcontour.kernels.dispatch import on_gpu


def dot(pairs, onto: Any = 0.0) -> Any:
    """Sum of the products of pairs and of `onto`, without those that are known to be zero."""
    for a, b in pairs:
        if not (is_zero(a) or is_zero(b)):
            onto = a * b if is_zero(onto) else fused(a, b, onto)
    return onto


def is_zero(number: Any) -> bool:
    """Whether a number is known to be zero, whatever the data."""
    return isinstance(number, float) and bool(number == 0.0)


def fused(a, b, c):
    """Value of a b + c with one rounding, in one instruction.

    Pallas would make two of it, at half the speed.
    """
    if not on_gpu():
        return a * b + c
    from jax.experimental.pallas import triton  # loads Pallas, which a CPU has no use for

    a, b, c = jnp.broadcast_arrays(a, b, c)
    width, register = ("f64", "d") if c.dtype == jnp.float64 else ("f32", "f")
    instruction = f"fma.rn.{width} $0, $1, $2, $3;"
    kinds = f"={register},{register},{register},{register}"
    like = [jax.ShapeDtypeStruct(c.shape, c.dtype)]
    return triton.elementwise_inline_asm(
        instruction, args=[a, b, c], constraints=kinds, pack=1, result_shape_dtypes=like
    )[0]
