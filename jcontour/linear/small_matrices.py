"""Solution, inverse and exponential of small matrices in operations of XLA alone.

Batches of LAPACK's factors split over the threads of JAX for CPUs, and each waits for its parts on
a thread: on a machine of two cores, two that one program computes side by side wait for ever.
Under `vmap` these do not: they call no library.
"""

from functools import partial

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

DEGREE = 18  # of the exponential's series: its rest at norm 1 is below 1e-17
SQUARINGS = 32


@jax.jit
def small_solve(
    M: Float[Array, "n n"], right: Float[Array, "n *columns"]
) -> Float[Array, "n *columns"]:
    """Solution x of M x = right, by elimination with partial pivoting; not finite where singular.

    Raises:
        TypeError: M is not square, or the right side has another number of rows.
    """
    if M.shape != (len(right), len(right)):
        raise TypeError(f"M: needs {len(right)} rows and columns, received {M.shape}")
    x = jax.lax.custom_linear_solve(
        partial(jnp.matmul, M),
        right.reshape(len(right), -1),
        lambda _, b: _eliminated(M, b),
        lambda _, b: _eliminated(M.T, b),
    )
    return x.reshape(right.shape)


def _eliminated(M: Float[Array, "n n"], right: Float[Array, "n k"]) -> Float[Array, "n k"]:
    n = len(M)
    rows = jnp.arange(n)

    def forward(both, k):
        pivot = jnp.argmax(jnp.where(rows >= k, jnp.abs(both[:, k]), -1.0))
        both = both[jnp.where(rows == k, pivot, jnp.where(rows == pivot, k, rows))]
        factors = jnp.where(rows > k, both[:, k] / both[k, k], 0.0)
        return both - factors[:, None] * both[k][None], None

    def backward(x, k):
        rest = both[k, n:] - jnp.sum(both[k, :n, None] * x, axis=0)
        return x.at[k].set(rest / both[k, k]), None

    both, _ = jax.lax.scan(forward, jnp.concatenate([M, right], axis=1), rows)
    return jax.lax.scan(backward, jnp.zeros_like(right), rows, reverse=True)[0]


def small_inverse(M: Float[Array, "*batch p p"]) -> Float[Array, "*batch p p"]:
    """Inverse in closed form up to 3 x 3, by elimination beyond.

    The closed form halves the run and compile time of the sweep.
    """
    if M.shape[-1] == 1:
        return 1 / M
    if M.shape[-1] == 2:
        a, b, c, d = M[..., 0, 0], M[..., 0, 1], M[..., 1, 0], M[..., 1, 1]
        adjugate = jnp.stack([jnp.stack([d, -b], -1), jnp.stack([-c, a], -1)], -2)
        return adjugate / (a * d - b * c)[..., None, None]
    if M.shape[-1] == 3:
        first, second, third = M[..., 0, :], M[..., 1, :], M[..., 2, :]
        adjugate = jnp.stack(
            [jnp.cross(second, third), jnp.cross(third, first), jnp.cross(first, second)], -1
        )
        return adjugate / jnp.sum(first * adjugate[..., 0], axis=-1)[..., None, None]
    identity = jnp.eye(M.shape[-1], dtype=M.dtype)
    flat = M.reshape(-1, *M.shape[-2:])
    return jax.vmap(lambda one: small_solve(one, identity))(flat).reshape(M.shape)


def exponential(M: Float[Array, "n n"]) -> Float[Array, "n n"]:
    """Exponential of M by scaling and squaring of its Taylor series; NaN at a norm above 2^32."""
    norm = jnp.max(jnp.sum(jnp.abs(jax.lax.stop_gradient(M)), axis=0))
    squarings = jnp.maximum(jnp.frexp(norm)[1], 0)
    small = jnp.ldexp(M, -squarings)

    def term(total, k):
        return jnp.eye(len(M), dtype=M.dtype) + small @ total / k, None

    def square(power, k):
        return jnp.where(k < squarings, power @ power, power), None

    identity = jnp.eye(len(M), dtype=M.dtype)
    series, _ = jax.lax.scan(term, identity, jnp.arange(DEGREE, 0, -1, dtype=M.dtype))
    power, _ = jax.lax.scan(square, series, jnp.arange(SQUARINGS, dtype=squarings.dtype))
    return jnp.where(squarings <= SQUARINGS, power, jnp.nan)
