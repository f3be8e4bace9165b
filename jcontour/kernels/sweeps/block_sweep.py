"""Blocks of `riccati.blockwise` side by side: eight at a time on a CPU, all of them in XLA.

XLA's form, with the packed stages of `window_sweep`, has the derivatives.
"""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jax.custom_derivatives import SymbolicZero
from jaxtyping import Array, Float, Int

from jcontour.kernels.packed_stage import (
    cost_entries,
    cost_in_front,
    packed_cost,
    packed_stage,
    stage_maps,
)
from jcontour.kernels.packing import packing
from jcontour.kernels.sweeps.stage_sweep import stage_sweep, suits_stages
from jcontour.linear.plant import Pattern


def block_sweep(
    pattern: Pattern, seen: Int[Array, "seen blocks"], preview: int, A, B, C, Q, y_d, R, H, g
) -> tuple[Float[Array, "N_p blocks p n"], Float[Array, "N_p blocks p"]]:
    """Gains F, f of the steps of every block.

    Args:
        pattern: non-zeros of the model.
        seen: samples of every block, its steps first, then those ahead of its last step.
        preview: steps N_p of a block.
        A: (n, n).
        B: (n, p).
        C: (m, n).
        Q: output weight at every sample (S, m, m).
        y_d: desired output at every sample (S, m) [m].
        R: control weight (p, p).
        H: cost to go at the end of every block's horizon (blocks, n, n).
        g: likewise (blocks, n).
    """
    cost = cost_entries(Q, y_d)[:, seen]
    if suits_stages(pattern, A, B, C, cost, R, H, g):
        K, _ = _by_eight(pattern, preview, False, A, B, C, cost, R, H, g)
    else:
        K = _swept(pattern, preview, A, B, C, cost, R, H, g)
    return _gains(pattern, K)


def remembering_sweep(
    pattern: Pattern, seen: Int[Array, "seen blocks"], preview: int, A, B, C, Q, y_d, R, H, g
) -> tuple[
    Float[Array, "N_p blocks p n"], Float[Array, "N_p blocks p"], Float[Array, "blocks n n"]
]:
    """Gains as those of `block_sweep`, and what each block's sweep remembers of (H, g).

    That is the product of A - B F of the stages behind the block's steps, the last one on the left;
    the order of the states is of no account. It has no derivative.
    """
    cost = cost_entries(Q, y_d)[:, seen]
    if suits_stages(pattern, A, B, C, cost, R, H, g):
        K, product = _by_eight(pattern, preview, True, A, B, C, cost, R, H, g)
        return *_gains(pattern, K), jnp.moveaxis(product, -1, 0)
    F, f = _gains(pattern, _swept(pattern, cost.shape[1], A, B, C, cost, R, H, g))

    def on(product, F):
        return (A[None] - jnp.einsum("np,bpm->bnm", B, F)) @ product, None

    start = jnp.broadcast_to(jnp.eye(len(A), dtype=F.dtype), H.shape)
    behind = jax.lax.stop_gradient(F[preview:])
    return F[:preview], f[:preview], jax.lax.scan(on, start, behind)[0]


def _gains(pattern: Pattern, K):
    K = jnp.moveaxis(K, -1, 1)
    return K[..., np.argsort(packing(pattern).order)], -K[..., -1]


@partial(jax.custom_jvp, nondiff_argnums=(0, 1, 2))
def _by_eight(pattern: Pattern, preview: int, remembering: bool, A, B, C, cost, R, H, g):
    """Gains and products as `stage_sweep` finds them, the gains with XLA's derivative."""
    scale, cost = jnp.ones(cost.shape[1] - 1, cost.dtype), cost[:, 1:]
    found = stage_sweep(pattern, A, B, C, R, cost, scale, H, g, preview, remembering)
    return found.K, found.product


@partial(_by_eight.defjvp, symbolic_zeros=True)
def _by_eight_jvp(pattern: Pattern, preview: int, remembering: bool, primals, tangents):
    moving = [k for k, tangent in enumerate(tangents) if not isinstance(tangent, SymbolicZero)]

    def moved(*some):
        arguments = dict(enumerate(primals)) | dict(zip(moving, some, strict=True))
        return _swept(pattern, preview, *arguments.values())

    point, push = ([values[k] for k in moving] for values in (primals, tangents))
    _, change = jax.jvp(moved, point, push)
    # the value from the same call as without a derivative: JAX batches both as one
    K, product = _by_eight(pattern, preview, remembering, *primals)
    return (K, product), (change, jnp.zeros_like(product))


def _swept(
    pattern: Pattern, preview: int, A, B, C, cost: Float[Array, "q seen blocks"], R, H, g
) -> Float[Array, "N_p p size blocks"]:
    """Gains K = [F, -f] in XLA; the states are in the order of `packing`."""
    pack, maps = packing(pattern), stage_maps(pattern, A, B, C)
    rows = jnp.moveaxis(cost, 1, 0)

    def back(H, cost):
        found = packed_stage(pack, maps, R, H)
        return cost_in_front(pack, maps, found, cost), jnp.stack(found.K)

    def ahead(H, cost):
        return back(H, cost)[0], None

    first, _ = jax.lax.scan(ahead, packed_cost(pack, H, g), rows[preview:], reverse=True)
    return jax.lax.scan(back, first, rows[:preview], reverse=True)[1]
