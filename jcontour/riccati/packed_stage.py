"""One stage back of the Riccati recursion for many steps at once, with time on the last axis.

The equations are those of `window_sweep`; only entries that can be non-zero are kept, see
`packing`. With M = [A B] and a 1 behind the state,

    Hz = M' H_{j+1} M,   G = (Hz_uu + R)^-1,   K_j = G Hz_ux,   H_j = Hz_xx - Hz_xu K_j + C' Q_j C
"""

from functools import reduce
from operator import add
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jcontour.linear.plant import Pattern
from jcontour.riccati.packing import Block, Packing, congruence, packing, seen_entries


class Stage(NamedTuple):
    """One stage of the sweep: Hz block by block, its rows Hz_ux, K and G."""

    Hz: list[Array]
    Hux: list[Array]
    K: list[Array]
    G: list[list[Array]]


def cost_entries(Q: Float[Array, "S m m"], y_d: Float[Array, "S m"]) -> Float[Array, "q S"]:
    """Entries of [Q, -Q y_d] of every sample."""
    outputs = range(y_d.shape[1])
    even = [[(Q[:, a, b] + Q[:, b, a]) / 2 for b in outputs] for a in outputs]
    rows = []
    for a, b in seen_entries(len(outputs)).T:
        of_Q = b < len(outputs)
        rows.append(even[a][b] if of_Q else -sum(even[a][c] * y_d[:, c] for c in outputs))
    return jnp.stack(rows)


def packed_cost(
    pack: Packing, H: Float[Array, "T n n"], g: Float[Array, "T n"]
) -> list[Float[Array, "entries T"]]:
    """Cost to go block by block."""
    place = np.append(pack.order, pack.order.size)
    whole = jnp.concatenate([H, g[:, :, None]], axis=2)
    return [whole[:, place[i], place[k]].T for i, k in (block.of_H for block in pack.blocks)]


def extended(order, A, B, C):
    """Matrices A, B, C with the states in the packing's order and the 1 behind them."""

    def bordered(M):
        corner = np.zeros(np.add(M.shape, 1), M.dtype)
        corner[-1, -1] = 1
        return jnp.pad(M, (0, 1)) + corner

    return bordered(A[order][:, order]), jnp.pad(B[order], ((0, 1), (0, 0))), bordered(C[:, order])


def stage_maps(pattern: Pattern, A, B, C) -> list[tuple[Array | np.ndarray, Array | np.ndarray]]:
    """Matrix from H to Hz and matrix from Q to C' Q C, for every block."""
    pack = packing(pattern)
    A, B, C = extended(pack.order, A, B, C)
    M, seen = jnp.concatenate([A, B], axis=1), seen_entries(C.shape[0] - 1)

    def of_block(block: Block):
        ahead = congruence(M, block.entries, block.of_H)
        return ahead, congruence(C, block.of_H, seen[:, block.weighed])

    return [of_block(block) for block in pack.blocks]


def packed_stage(pack: Packing, maps, R: Float[Array, "p p"], H: list[Array]) -> Stage:
    """Best control of one stage, before the cost to go H."""
    inputs = range(R.shape[0])
    Hz = [ahead @ h for (ahead, _), h in zip(maps, H, strict=True)]
    Hux = [jnp.concatenate([Hz[c][first:last] for c, first, last in row]) for row in pack.rows]

    def of_inputs(u: int, v: int) -> Array:
        block, row = pack.square[u, v]
        return Hz[block][row] + R[u, v]

    G = definite_inverse([[of_inputs(u, v) for v in inputs] for u in inputs])
    K = [reduce(add, (G[u][v][None] * Hux[v] for v in inputs)) for u in inputs]
    return Stage(Hz, Hux, K, G)


def cost_in_front(
    pack: Packing, maps, found: Stage, cost: Float[Array, "q T"]
) -> list[Float[Array, "entries T"]]:
    """Cost to go in front of a stage; `cost` holds the entries of [Q, -Q y_d] of its samples."""
    H = []
    for hz, block, (_, source) in zip(found.Hz, pack.blocks, maps, strict=True):
        row, (i, k) = cost[block.weighed], block.of_H
        # a product with one row fuses, a matmul does not
        weighed = source * row if len(row) == 1 else source @ row
        pairs = zip(found.Hux, found.K, strict=True)
        forced = reduce(add, (Hux[i] * K[k] for Hux, K in pairs))
        H.append(hz[: i.size] - forced + weighed)
    return H


def definite_inverse(M: list[list[Any]]) -> list[list[Any]]:
    """Inverse of a positive definite matrix whose entries are vectors over time.

    Gauss-Jordan, which needs no pivots for such a matrix.
    """
    for k in range(len(M)):
        pivot = 1 / M[k][k]
        row = [pivot if j == k else entry * pivot for j, entry in enumerate(M[k])]
        M = [row if i == k else _eliminated(old, row, k) for i, old in enumerate(M)]
    return M


def _eliminated(old: list[Any], row: list[Any], k: int) -> list[Any]:
    """Row `old` without its entry k, which is taken off with the row of pivot k, `row`."""
    factor = old[k]
    return [-factor * row[k] if j == k else entry - factor * row[j] for j, entry in enumerate(old)]
