"""Blocks of `riccati.blockwise` side by side in XLA, with the packed stages of `window_sweep`."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from jcontour.kernels.packed_stage import (
    cost_entries,
    cost_in_front,
    packed_cost,
    packed_stage,
    stage_maps,
)
from jcontour.kernels.packing import packing
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
    pack, maps = packing(pattern), stage_maps(pattern, A, B, C)
    cost = jnp.moveaxis(cost_entries(Q, y_d)[:, seen], 0, 1)

    def back(H, cost):
        found = packed_stage(pack, maps, R, H)
        return cost_in_front(pack, maps, found, cost), jnp.stack(found.K)

    def ahead(H, cost):
        return back(H, cost)[0], None

    first, _ = jax.lax.scan(ahead, packed_cost(pack, H, g), cost[preview:], reverse=True)
    _, K = jax.lax.scan(back, first, cost[:preview], reverse=True)
    K = jnp.moveaxis(K, -1, 1)
    return K[..., np.argsort(pack.order)], -K[..., -1]
