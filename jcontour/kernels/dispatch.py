"""Which kernels run here; light to import, so that a CPU never loads the GPU's."""

import jax
import jax.numpy as jnp

from jcontour.linear import Pattern

MOST_MULTIPLICATIONS = 9000  # of one stage, unrolled: about 16 coupled states; beyond, registers and the compiler's patience end


def on_gpu() -> bool:
    """Whether a GPU is what JAX computes on, unless the default device says otherwise."""
    chosen = jax.config.jax_default_device  # pyright: ignore[reportAttributeAccessIssue]
    return jax.default_backend() == "gpu" and (chosen is None or getattr(chosen, "platform", chosen) in ("gpu", "cuda"))


def suits_lanes(pattern: Pattern, *arrays) -> bool:
    """Whether the GPU kernels take a plant and numbers of these types; the sweep in XLA takes all."""
    types = {jnp.result_type(leaf) for leaf in jax.tree.leaves(arrays)}
    return on_gpu() and multiplications(pattern) <= MOST_MULTIPLICATIONS and types in ({jnp.dtype("float32")}, {jnp.dtype("float64")})


def multiplications(pattern: Pattern) -> int:
    """Multiplications of one Riccati stage over the non-zeros of M = [A B]: H M, M' (H M) and H - Hux' K."""
    n, p = len(pattern.A), len(pattern.B[0])
    filled = sum(map(sum, (*pattern.A, *pattern.B)))
    return filled * n + filled * (n + p) // 2 + n * (n + 1) // 2 * p
