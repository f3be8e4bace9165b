"""Arithmetic with numbers of any kind, where those that are known to be zero cost nothing.

A number is an array, a vector over the lanes of a GPU's kernel, one of a straight-line program
(`native.numbers`), or a float of Python.
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


def where(flag, yes, no) -> Any:
    """`yes` where a flag holds, `no` elsewhere."""
    if isinstance(flag, bool):
        return yes if flag else no
    return flag.chosen(yes, no) if hasattr(flag, "chosen") else jnp.where(flag, yes, no)


def larger(a, b) -> Any:
    """The larger number; NaN where one is."""
    if hasattr(b, "larger"):
        return b.larger(a)
    return a.larger(b) if hasattr(a, "larger") else jnp.maximum(a, b)


def smaller(a, b) -> Any:
    """The smaller number; NaN where one is."""
    if hasattr(b, "smaller"):
        return b.smaller(a)
    return a.smaller(b) if hasattr(a, "smaller") else jnp.minimum(a, b)


def inverse_root(a) -> Any:
    """Inverse of the square root."""
    return 1.0 / a.root() if hasattr(a, "root") else jax.lax.rsqrt(a)


def is_finite(a) -> Any:
    """Whether a number is neither infinite nor NaN."""
    return abs(a) < float("inf")
