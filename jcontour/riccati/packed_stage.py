"""One stage back of the Riccati recursion for many steps at once, with time on the last axis.

The equations are those of `window_sweep`. With M = [A B] and a 1 behind the state,

    Hz = M' H_{j+1} M,   G = (Hz_uu + R)^-1,   K_j = G Hz_ux,   H_j = Hz_xx - Hz_xu K_j + C' Q_j C
Of the symmetric matrices only entries that can be non-zero are kept, each once: with the 1, H is
n + 1 square, and Hz has rows for the inputs as well. Entries that belong to the same two axes form
a block, in which H becomes Hz by one matrix.
"""

from collections.abc import Sequence
from functools import lru_cache, reduce
from itertools import combinations_with_replacement, pairwise, product
from operator import add
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, Shaped

from jcontour.linear.plant import Pattern, decoupled_axes

# row and column of entries of a symmetric matrix, each entry once
Entries = Int[np.ndarray, "2 _"]


class Part(NamedTuple):
    """Labels of the states and of the inputs of one axis."""

    states: range
    inputs: Sequence[int]


class Block(NamedTuple):
    """Entries of Hz that belong to two axes, those of H first, and the entries of Q that matter."""

    entries: Entries
    of_H: Entries
    weighed: Int[np.ndarray, " q"]


class Packing(NamedTuple):
    """Entries of Hz that are kept, and their places.

    States count from 0 in this order, the 1 is n, inputs count from n + 1.
    """

    order: Int[np.ndarray, " n"]  # the states, axis by axis
    blocks: tuple[Block, ...]  # one for every two axes, then one for the column of g
    # for every input, the pieces (block, first, last) of its row of Hz_ux
    rows: tuple[tuple[tuple[int, int, int], ...], ...]
    # for every two inputs, the place (block, row) of their entry of Hz_uu
    square: dict[tuple[int, int], tuple[int, int]]


def seen_entries(outputs: int) -> Entries:
    """Entries of Q with the column -Q y_d, in the order of `window_sweep.SweepData.cost`."""
    return np.array(list(combinations_with_replacement(range(outputs + 1), 2))[:-1]).T


@lru_cache
def packing(pattern: Pattern) -> Packing:
    """Packing of all plants with one pattern."""
    axes = [axis for axis in decoupled_axes(pattern) if axis.states or axis.inputs]
    order = np.array([state for axis in axes for state in axis.states])
    n, p, m = len(order), len(pattern.B[0]), len(pattern.C)
    ends = np.cumsum([0] + [len(axis.states) for axis in axes]).tolist()
    parts = [
        Part(range(*span), tuple(n + 1 + u for u in axis.inputs))
        for span, axis in zip(pairwise(ends), axes, strict=True)
    ]
    inputs = range(n + 1, n + 1 + p)
    everything, one = Part(range(n), inputs), Part(range(n, n + 1), ())
    C = np.zeros((m + 1, n + 1), int)
    C[:m, :n], C[m, n] = np.array(pattern.C)[:, order], 1
    blocks, place = [], {}
    for pair in [*combinations_with_replacement(parts, 2), (everything, one)]:
        of_H, of_inputs = _entries(*pair)
        entries = of_H + of_inputs
        place |= {entry: (len(blocks), row) for row, entry in enumerate(entries)}
        entries, of_H = (np.array(some, int).reshape(-1, 2).T for some in (entries, of_H))
        weighed = np.flatnonzero(congruence(C, of_H, seen_entries(m)).any(0))
        blocks.append(Block(entries, of_H, weighed))
    place |= {(v, u): there for (u, v), there in place.items() if u > n}
    rows = tuple(_row(place, u, [*parts, one]) for u in inputs)
    square = {(u - n - 1, v - n - 1): place[u, v] for u, v in product(inputs, repeat=2)}
    return Packing(order, tuple(blocks), rows, square)


def _entries(first: Part, second: Part) -> tuple[list[tuple[int, int]], list[tuple[int, int]]]:
    """Entries of H that belong to two axes, and the entries of Hz with an input."""
    (x, u), (y, v) = first, second
    mixed = [(i, w) for w in v for i in x]
    if first is second:
        of_H = list(combinations_with_replacement(x, 2))
        return of_H, [*mixed, *combinations_with_replacement(u, 2)]
    mixed += [(i, w) for w in u for i in y]
    return list(product(x, y)), [*mixed, *product(u, v)]


def _row(place: dict, u: int, parts: Sequence[Part]) -> tuple[tuple[int, int, int], ...]:
    """Pieces (block, first, last) of the row of Hz_ux of one input."""
    pieces = []
    for part in parts:
        if part.states:
            block, first = place[part.states[0], u]
            pieces.append((block, first, place[part.states[-1], u][1] + 1))
    return tuple(pieces)


def congruence(
    M: Shaped[Array | np.ndarray, "rows columns"],
    of_product: Int[np.ndarray, "2 s"],
    of_X: Int[np.ndarray, "2 r"],
) -> Shaped[Array | np.ndarray, "s r"]:
    """Matrix that takes entries of a symmetric X to entries of M' X M."""
    (i, j), (a, b) = of_product[:, :, None], of_X
    return M[a, i] * M[b, j] + (a != b).astype(M.dtype)[None] * M[b, i] * M[a, j]


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
    pack: Packing, maps, stage: Stage, cost: Float[Array, "q T"]
) -> list[Float[Array, "entries T"]]:
    """Cost to go in front of a stage; `cost` holds the entries of [Q, -Q y_d] of its samples."""
    H = []
    for hz, block, (_, source) in zip(stage.Hz, pack.blocks, maps, strict=True):
        row, (i, k) = cost[block.weighed], block.of_H
        # a product with one row fuses, a matmul does not
        weighed = source * row if len(row) == 1 else source @ row
        pairs = zip(stage.Hux, stage.K, strict=True)
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
