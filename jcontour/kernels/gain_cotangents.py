"""The derivative of the receding-horizon sweep on a GPU, along predicted trajectories: one lane per step and member of the batch.

For the cotangent Kbar of K_0 = [F, -f], as in `window_sweep`,
    U_1 = B G,  V_1 = (A - B K_0) Kbar',  W_{j+1} = A W_j - B (K_j W_j),   Qbar_j = C U_j V_j' C',
    Rbar += K_j U_j V_j' K_j'
The kernel sweeps again and keeps the K_j of its lanes in a scratch that stays in the cache: as many
programs are started as the card holds, and each walks through many blocks of lanes.
"""

from collections.abc import Callable
from functools import lru_cache, partial
from itertools import chain, product

import jax
import jax.numpy as jnp
from jax.experimental import pallas as pl

from jcontour.kernels.gain_lanes import Data, Shape, Sizes, as_rows, read, shape_of, swept
from jcontour.kernels.lanes import (
    LANES,
    Batch,
    Lanes,
    batch_last,
    dot,
    in_pieces,
    launch,
    processors,
    vectors,
)
from jcontour.linear.plant import Pattern

# programs per multiprocessor in float64, limited by registers; float32 has room for twice as many
RESIDENT = 2


def through(sizes: Sizes, M: dict, K, W):
    """K W, and A W - B (K W), of one trajectory; the 1 at its end stays what it is."""
    n, inputs = sizes.n, range(sizes.p)
    KW = [dot(zip(K[u], W, strict=False)) for u in inputs]
    drift = [dot((M[i, k], W[k]) for k in range(n) if (i, k) in M) for i in range(n)]
    ahead = [
        dot(((M[i, n + 1 + u], -KW[u]) for u in inputs if (i, n + 1 + u) in M), drift[i])
        for i in range(n)
    ]
    return KW, [*ahead, *W[n:]]


def paired(shape: Shape, sizes: Sizes, C: dict, U, V):
    """C U V' C' of the entries of the cost, each that stands for two with both."""
    n, m, columns = sizes.n, sizes.m, range(sizes.p)
    CU, CV = (
        [
            [dot((C[a, i], W[c][i]) for i in range(n) if (a, i) in C) for c in columns]
            for a in range(m)
        ]
        for W in (U, V)
    )
    CV.append([V[c][n] for c in columns])
    for a, b in shape.seen:
        mirrored = [(CU[b][c], CV[a][c]) for c in columns if a != b and b < m]
        yield dot([*((CU[a][c], CV[b][c]) for c in columns), *mirrored])


def one_block(pattern: Pattern, sizes: Sizes, data: Data, K_bar, results, at, kept):
    """Write the cotangents of one block of lanes to `results` at the lanes `at`; `kept` holds the gains."""
    rows, R_bar, end = results
    n, p, shape = sizes.n, sizes.p, shape_of(pattern)
    M, last = data.M, [row[sizes.n] for row in K_bar]

    def store(j, U, V):
        for row, value in enumerate(paired(shape, sizes, data.C, U, V)):
            rows[(j - 1) * len(shape.seen) + row, at] = value

    def packed(U, V, R):
        return vectors(
            (*(x for W in U for x in W[:n]), *(x for W in V for x in W[:n]), *R), last[0]
        )

    def unpacked(numbers):
        trajectories = [list(numbers[first : first + n]) for first in range(0, 2 * p * n, n)]
        return (
            trajectories[:p],
            [[*V, one] for V, one in zip(trajectories[p:], last, strict=True)],
            numbers[2 * p * n :],
        )

    def advance(behind, numbers):
        j = behind + 1
        U, V, R = unpacked(numbers)
        store(j, U, V)
        K = kept.of(j)
        (KU, U), (KV, V) = (
            zip(*(through(sizes, M, K, W) for W in columns), strict=True) for columns in (U, V)
        )
        R = [
            dot(((KU[c][u], KV[c][v]) for c in range(p)), R[u * p + v])
            for u, v in product(range(p), repeat=2)
        ]
        return packed(U, V, R)

    K, G = swept(pattern, sizes, data, kept.keep)
    U = [
        [dot((M[i, n + 1 + u], G[u][c]) for u in range(p) if (i, n + 1 + u) in M) for i in range(n)]
        for c in range(p)
    ]
    KK_bar, V = zip(*(through(sizes, M, K, row) for row in K_bar), strict=True)
    R = [-dot((G[u][c], KK_bar[c][v]) for c in range(p)) for u, v in product(range(p), repeat=2)]
    U, V, R = unpacked(jax.lax.fori_loop(0, sizes.preview - 1, advance, packed(U, V, R)))
    for row in range(p * p):
        R_bar[row, at] = R[row]
    if not sizes.ended:
        return store(sizes.preview, U, V)
    for row, (i, k) in enumerate(shape.entries):
        pair = dot((U[c][i], V[c][k]) for c in range(p))
        end[row, at] = pair if k == n else dot(((U[c][k], V[c][i]) for c in range(p)), pair) * 0.5


class Kept:
    """The K_j of the lanes of one program."""

    def __init__(self, scratch, sizes: Sizes, lanes):
        self.scratch, self.lanes, self.shape = scratch, lanes, (sizes.p, sizes.n + 1)

    def keep(self, j, K):
        """Of stage j, from 1."""
        rows, columns = self.shape
        for row, number in enumerate(
            vectors(chain(*K), jnp.full(self.lanes.shape, 0.0, self.scratch.dtype))
        ):
            self.scratch[(j - 1) * rows * columns + row, self.lanes] = number

    def of(self, j):
        """What was kept."""
        rows, columns = self.shape
        return [
            [
                self.scratch[(j - 1) * rows * columns + (u * columns + i), self.lanes]
                for i in range(columns)
            ]
            for u in range(rows)
        ]


def kernel(pattern: Pattern, sizes: Sizes, batch: Batch, programs: int, *refs):
    """Cotangents of the cost of every stage, of R and of the terminal, for all blocks of lanes of one program."""
    *operands, rows, R_bar, end, scratch = refs
    program = pl.program_id(0)
    kept = Kept(scratch, sizes, program * LANES + jnp.arange(LANES, dtype=jnp.int32))

    def block(count, nothing):
        lanes = Lanes.of(program + count * programs, sizes.steps, batch.members)
        *data, F_bar, f_bar = batch.rows(operands, lanes.member)
        K_bar = [
            [
                *(F_bar.sample(u * sizes.n + i, lanes.step) for i in range(sizes.n)),
                -f_bar.sample(u, lanes.step),
            ]
            for u in range(sizes.p)
        ]
        one_block(
            pattern,
            sizes,
            read(pattern, sizes, lanes, data),
            K_bar,
            (rows, R_bar, end),
            lanes.index,
            kept,
        )
        return nothing

    blocks = -(-sizes.steps * batch.members // LANES)
    jax.lax.fori_loop(0, -(-blocks // programs), block, 0)


@lru_cache
def cotangents(pattern: Pattern, sizes: Sizes) -> Callable:
    """The operands of `gains`, Fbar and fbar -> cotangents of the cost of every stage (w, q, T), R (p, p, T), the terminal (e, T)."""
    n, p, T, shape = sizes.n, sizes.p, sizes.steps, shape_of(pattern)
    q, entries = len(shape.seen), len(shape.entries) if sizes.ended else 0

    def whole(*operands):
        batch, itemsize = Batch.of(operands), operands[0].array.dtype.itemsize
        lanes = T * batch.members
        programs = min(-(-lanes // LANES), RESIDENT * 8 // itemsize * processors())
        *data, F_bar, f_bar = operands
        scratch = (max(sizes.preview - 1, 1) * p * (n + 1), programs * LANES)
        results = [
            (max(sizes.weighed, 1) * q, lanes),
            (p * p, lanes),
            (max(entries, 1), lanes if entries else 1),
            scratch,
        ]
        run = partial(kernel, pattern, sizes, batch, programs)
        rows, R_bar, end, _ = launch(
            run, programs, [*as_rows(data), F_bar.timed(), f_bar.timed()], results
        )
        found = (
            (rows[: sizes.weighed * q], (sizes.weighed, q)),
            (R_bar, (p, p)),
            (end[:entries], (entries,)),
        )
        return [array.reshape(*shape, T, *batch.sizes) for array, shape in found]

    return batch_last(
        lambda *operands: in_pieces(
            whole, operands, max(sizes.preview * q, p * n, n * n if entries else 0) * sizes.samples
        )
    )
