"""Products of small matrices with vectors, inside loops over samples."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

MOST = 16  # rows or columns: beyond, a call of a library is faster than sums


@jax.jit
def small_product(
    M: Float[Array | np.ndarray, "a b"], x: Float[Array | np.ndarray, " b"]
) -> Float[Array, " a"]:
    """Product M x.

    A small one is written as sums: XLA for CPUs joins them with what is around them in a loop's
    body, where every `@` is a step of its own that takes longer than its arithmetic.

    Raises:
        TypeError: x has not as many numbers as M has columns, as `@` has it.
    """
    if x.shape != M.shape[1:]:
        raise TypeError(f"x: needs shape {M.shape[1:]}, received {x.shape}")
    if max(M.shape) > MOST:
        return jnp.matmul(M, x)
    return jnp.sum(M * x[None], axis=1)
