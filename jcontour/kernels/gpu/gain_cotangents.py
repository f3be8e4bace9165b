"""Derivative of the receding-horizon sweep on a GPU, along predicted trajectories.

There is one lane per step and member of the batch. For the cotangent Kbar of K_0 = [F, -f], as in
`window_sweep`,

    U_1 = B G,  V_1 = (A - B K_0) Kbar',  W_{j+1} = A W_j - B (K_j W_j),   Qbar_j = C U_j V_j' C',
    Rbar += K_j U_j V_j' K_j'
The kernel sweeps again and keeps the K_j of its lanes in a scratch that stays in the cache: as many
programs are started as the card holds, and each walks through many blocks of lanes.
"""

from collections.abc import Callable
from functools import lru_cache, partial
from itertools import chain, product
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax.experimental import pallas as pl
from jaxtyping import Array

from jcontour.kernels.arithmetic import dot
from jcontour.kernels.gpu.gain_lanes import Data, as_rows, read, swept
from jcontour.kernels.gpu.lanes import (
    LANES,
    Batch,
    Lanes,
    batch_last,
    in_pieces,
    launch,
    processors,
    vectors,
)
from jcontour.kernels.written_stage import Shape, Sizes, shape_of
from jcontour.linear.plant import Pattern

# programs per multiprocessor in float64, limited by registers; float32 has room for twice as many
RESIDENT = 2


def through(sizes: Sizes, M: dict, K, W):
    """Control K W of a trajectory, and A W - B (K W); the 1 at its end stays as it is."""
    n, inputs = sizes.n, range(sizes.p)
    KW = [dot(zip(K[u], W, strict=False)) for u in inputs]
    drift = [dot((M[i, k], W[k]) for k in range(n) if (i, k) in M) for i in range(n)]

    def ahead(i: int):
        pairs = ((M[i, n + 1 + u], -KW[u]) for u in inputs if (i, n + 1 + u) in M)
        return dot(pairs, drift[i])

    return KW, [*(ahead(i) for i in range(n)), *W[n:]]


def outputs(sizes: Sizes, C: dict, W) -> list[list]:
    """Outputs C W of p trajectories: row by output, column by trajectory."""

    def output(a: int, column):
        return dot((C[a, i], column[i]) for i in range(sizes.n) if (a, i) in C)

    return [[output(a, column) for column in W] for a in range(sizes.m)]


def paired(shape: Shape, sizes: Sizes, C: dict, U, V):
    """Numbers of C U V' C', one for every entry of the cost.

    An entry that stands for two has both.
    """
    columns = range(sizes.p)
    CU, CV = outputs(sizes, C, U), outputs(sizes, C, V)
    CV.append([V[c][sizes.n] for c in columns])
    for a, b in shape.seen:
        pairs = [(CU[a][c], CV[b][c]) for c in columns]
        if a != b and b < sizes.m:
            pairs += [(CU[b][c], CV[a][c]) for c in columns]
        yield dot(pairs)


class Bundles(NamedTuple):
    """Trajectories U and V of p columns each, and the cotangent of R, as a loop carries them.

    The columns of V have a number behind the states, which stays the same.
    """

    U: list
    V: list
    R: list

    def packed(self, n: int) -> tuple[Array, ...]:
        """Numbers that change from stage to stage."""
        states = (*(x for W in self.U for x in W[:n]), *(x for W in self.V for x in W[:n]))
        return vectors((*states, *self.R), self.V[0][n])

    def unpacked(self, numbers, n: int) -> "Bundles":
        """Bundles with these numbers, and the same ones behind V."""
        count = len(self.U)
        columns = [list(numbers[first : first + n]) for first in range(0, 2 * count * n, n)]
        U, V = columns[:count], columns[count:]
        V = [[*column, old[n]] for column, old in zip(V, self.V, strict=True)]
        return Bundles(U, V, list(numbers[2 * count * n :]))


def first_bundles(sizes: Sizes, M: dict, K, G, K_bar) -> Bundles:
    """Trajectories U_1 = B G, V_1 = (A - B K_0) Kbar', and what the first gain says about R."""
    n, inputs = sizes.n, range(sizes.p)

    def pushed(i: int, c: int):
        return dot((M[i, n + 1 + u], G[u][c]) for u in inputs if (i, n + 1 + u) in M)

    U = [[pushed(i, c) for i in range(n)] for c in inputs]
    KK_bar, V = zip(*(through(sizes, M, K, row) for row in K_bar), strict=True)
    pairs = product(inputs, repeat=2)
    R = [-dot((G[u][c], KK_bar[c][v]) for c in inputs) for u, v in pairs]
    return Bundles(U, list(V), R)


def one_stage_on(sizes: Sizes, M: dict, K, bundles: Bundles) -> Bundles:
    """Bundles one stage later, K_j U_j V_j' K_j' added to the cotangent of R."""
    inputs = range(sizes.p)
    KU, U = zip(*(through(sizes, M, K, W) for W in bundles.U), strict=True)
    KV, V = zip(*(through(sizes, M, K, W) for W in bundles.V), strict=True)

    def weight(u: int, v: int):
        pairs = ((KU[c][u], KV[c][v]) for c in inputs)
        return dot(pairs, bundles.R[u * sizes.p + v])

    return Bundles(list(U), list(V), [weight(u, v) for u, v in product(inputs, repeat=2)])


def one_block(pattern: Pattern, sizes: Sizes, data: Data, K_bar, results, at, kept):
    """Write the cotangents of one block of lanes to `results` at the lanes `at`.

    `kept` holds the gains.
    """
    rows, R_bar, end = results
    n, shape = sizes.n, shape_of(pattern)

    def store(j, bundles: Bundles):
        found = paired(shape, sizes, data.C, bundles.U, bundles.V)
        for row, value in enumerate(found):
            rows[(j - 1) * len(shape.seen) + row, at] = value

    K, G = swept(pattern, sizes, data, kept.keep)
    first = first_bundles(sizes, data.M, K, G, K_bar)

    def advance(behind, numbers):
        j = behind + 1
        bundles = first.unpacked(numbers, n)
        store(j, bundles)
        return one_stage_on(sizes, data.M, kept.of(j), bundles).packed(n)

    numbers = jax.lax.fori_loop(0, sizes.preview - 1, advance, first.packed(n))
    last = first.unpacked(numbers, n)
    for row, value in enumerate(last.R):
        R_bar[row, at] = value
    if not sizes.ended:
        return store(sizes.preview, last)
    for row, (i, k) in enumerate(shape.entries):
        end[row, at] = terminal(sizes, last, i, k)


def terminal(sizes: Sizes, bundles: Bundles, i: int, k: int):
    """Cotangent of the entry (i, k) of the terminal cost; k = n is that of g."""
    pairs = [(column, other) for column, other in zip(bundles.U, bundles.V, strict=True)]
    number = dot((U[i], V[k]) for U, V in pairs)
    return number if k == sizes.n else dot(((U[k], V[i]) for U, V in pairs), number) * 0.5


class Kept:
    """Gains K_j of the lanes of one program."""

    def __init__(self, scratch, sizes: Sizes, lanes):
        self.scratch, self.lanes, self.shape = scratch, lanes, (sizes.p, sizes.n + 1)

    def keep(self, j, K):
        """Keep the gain of stage j, from 1."""
        rows, columns = self.shape
        nothing = jnp.full(self.lanes.shape, 0.0, self.scratch.dtype)
        for row, number in enumerate(vectors(chain(*K), nothing)):
            self.scratch[(j - 1) * rows * columns + row, self.lanes] = number

    def of(self, j):
        """Gain of stage j."""
        rows, columns = self.shape

        def number(u: int, i: int):
            return self.scratch[(j - 1) * rows * columns + (u * columns + i), self.lanes]

        return [[number(u, i) for i in range(columns)] for u in range(rows)]


def kernel(pattern: Pattern, sizes: Sizes, batch: Batch, programs: int, *refs):
    """Cotangents for all blocks of lanes of one program.

    They are those of the cost of every stage, of R and of the terminal.
    """
    *operands, rows, R_bar, end, scratch = refs
    program = pl.program_id(0)
    kept = Kept(scratch, sizes, program * LANES + jnp.arange(LANES, dtype=jnp.int32))

    def block(count, nothing):
        lanes = Lanes.of(program + count * programs, sizes.steps, batch.members)
        *data, F_bar, f_bar = batch.rows(operands, lanes.member)

        def of_input(u: int):
            of_states = (F_bar.sample(u * sizes.n + i, lanes.step) for i in range(sizes.n))
            return [*of_states, -f_bar.sample(u, lanes.step)]

        K_bar = [of_input(u) for u in range(sizes.p)]
        lane_data = read(pattern, sizes, lanes, data)
        results = rows, R_bar, end
        one_block(pattern, sizes, lane_data, K_bar, results, lanes.number, kept)
        return nothing

    blocks = -(-sizes.steps * batch.members // LANES)
    jax.lax.fori_loop(0, -(-blocks // programs), block, 0)


@lru_cache
def cotangents(pattern: Pattern, sizes: Sizes) -> Callable:
    """Kernel of the derivative: the operands of `gains`, Fbar and fbar -> cotangents.

    They are those of the cost of every stage (w, q, T), of R (p, p, T), of the terminal (e, T).
    """
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
        read_rows = [*as_rows(data), F_bar.timed(), f_bar.timed()]
        rows, R_bar, end, _ = launch(run, programs, read_rows, results)
        behind = T, *batch.sizes
        return [
            rows[: sizes.weighed * q].reshape(sizes.weighed, q, *behind),
            R_bar.reshape(p, p, *behind),
            end[:entries].reshape(entries, *behind),
        ]

    widest = max(sizes.preview * q, p * n, n * n if entries else 0)
    return batch_last(lambda *operands: in_pieces(whole, operands, widest * sizes.samples))
