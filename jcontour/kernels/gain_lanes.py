"""Receding-horizon sweep on a GPU: one lane per step and member of the batch, H in registers.

The equations are those of `window_sweep`, with the inputs eliminated before the model acts, written
out number by number over the static non-zeros of the plant. With a 1 behind the state, so that H
has g in its last column,
    G = (B' H B + R)^-1,   L = G B' H,   K = L A,   H_j = A' (H - H B L) A + C' Q_j C,   H = H_{j+1}
Numbers that are known to be zero cost nothing: the first stages, in which H still has few, are
written out one by one.
"""

from collections.abc import Callable, Sequence
from functools import lru_cache, partial
from itertools import combinations_with_replacement, product
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax.experimental import pallas as pl
from jaxtyping import Array

from jcontour.kernels.lanes import (
    LANES,
    Batch,
    Lanes,
    Operand,
    Rows,
    batch_last,
    dot,
    in_pieces,
    is_zero,
    launch,
    vectors,
)
from jcontour.kernels.packed_stage import definite_inverse
from jcontour.kernels.packing import seen_entries
from jcontour.linear.plant import Pattern, decoupled_axes

WRITTEN_OUT = 1  # stages at most: more save 3 %, and double the time to compile


class Sizes(NamedTuple):
    """Static sizes: states, inputs, outputs, steps, preview; is a terminal cost given?"""

    n: int
    p: int
    m: int
    steps: int
    preview: int
    ended: bool

    @property
    def samples(self) -> int:
        """Samples that are seen, S."""
        return self.steps + self.preview

    @property
    def weighed(self) -> int:
        """Stages whose output is weighted with Q."""
        return self.preview - self.ended


class Shape(NamedTuple):
    """Static structure of the numbers.

    Labels: states from 0, the 1 is n, inputs from n + 1.

    Attributes:
        parts: groups of states that nothing couples.
        rows: non-zero rows of every column of M = [A B].
        C: non-zeros of C.
        entries: entries of H with g, each once.
        seen: entries of [Q, -Q y_d], each once.
    """

    parts: tuple[tuple[int, ...], ...]
    rows: dict[int, tuple[int, ...]]
    C: tuple[tuple[int, int], ...]
    entries: tuple[tuple[int, int], ...]
    seen: tuple[tuple[int, int], ...]


@lru_cache
def shape_of(pattern: Pattern) -> Shape:
    """Shape of all plants with one pattern."""
    n, p, m = len(pattern.A), len(pattern.B[0]), len(pattern.C)
    parts = tuple(axis.states for axis in decoupled_axes(pattern))
    rows = {k: tuple(i for i in range(n) if pattern.A[i][k]) for k in range(n)}
    rows |= {n + 1 + u: tuple(i for i in range(n) if pattern.B[i][u]) for u in range(p)}
    C = tuple((a, i) for a in range(m) for i in range(n) if pattern.C[a][i])
    entries = (*combinations_with_replacement(range(n), 2), *((i, n) for i in range(n)))
    return Shape(parts, rows, C, entries, tuple((int(a), int(b)) for a, b in seen_entries(m).T))


def key(i: int, k: int) -> tuple[int, int]:
    """Entry that stands for both (i, k) and (k, i)."""
    return (i, k) if i <= k else (k, i)


class Choice(NamedTuple):
    """Best control of one stage: H B, G and L, with the 1 behind the states."""

    HB: list[list]
    G: list[list]
    L: list[list]


def choice(shape: Shape, sizes: Sizes, M, R, H) -> Choice:
    """Control that minimises one stage and the cost H that remains.

    Every number is a vector over lanes.
    """
    inputs = range(sizes.n + 1, sizes.n + 1 + sizes.p)
    HB = [
        [dot((H[key(i, k)], M[k, u]) for k in shape.rows[u]) for u in inputs]
        for i in range(sizes.n + 1)
    ]
    BHB = [
        [dot(((M[i, u], HB[i][v]) for i in shape.rows[u]), R[k][v]) for v in range(sizes.p)]
        for k, u in enumerate(inputs)
    ]
    G = definite_inverse(BHB)
    return Choice(HB, G, [[dot(zip(row, products, strict=True)) for products in HB] for row in G])


def gain(shape: Shape, sizes: Sizes, M, L) -> list[list]:
    """Gain K = L A."""
    return [
        [*(dot((row[i], M[i, k]) for i in shape.rows[k]) for k in range(sizes.n)), row[sizes.n]]
        for row in L
    ]


def cost_in_front(shape: Shape, sizes: Sizes, M, H, chosen: Choice):
    """Cost to go in front of a stage, without its output: A' (H - H B L) A."""
    n, L = sizes.n, chosen.L
    P = {
        (i, k): dot(((-HB, row[k]) for HB, row in zip(chosen.HB[i], L, strict=True)), H[i, k])
        for i, k in shape.entries
    }
    H = {(i, n): dot((M[k, i], P[k, n]) for k in shape.rows[i]) for i in range(n)}
    for left, right in combinations_with_replacement(shape.parts, 2):
        for c, column in enumerate(right):
            heads = left[: c + 1] if left == right else left
            needed = sorted({i for head in heads for i in shape.rows[head]})
            PA = {i: dot((P[key(i, k)], M[k, column]) for k in shape.rows[column]) for i in needed}
            for head in heads:
                H[key(head, column)] = dot((M[i, head], PA[i]) for i in shape.rows[head])
    return H


def weigh(shape: Shape, sizes: Sizes, C, H, cost):
    """Cost H + C' Q C; `cost` holds the numbers of [Q, -Q y_d]."""
    H, Q = dict(H), dict(zip(shape.seen, cost, strict=True))
    for (a, i), (b, k) in product(shape.C, repeat=2):
        if i <= k:
            H[i, k] = dot([(C[a, i] * C[b, k], Q[key(a, b)])], H[i, k])
    for a, i in shape.C:
        H[i, sizes.n] = dot([(C[a, i], Q[a, sizes.m])], H[i, sizes.n])
    return H


class Data(NamedTuple):
    """Data that a lane reads.

    They are the model, the control weight, functions for the weighted cost of stage j and for the
    terminal, and a zero per lane.
    """

    M: dict
    C: dict
    R: list
    cost: Callable
    start: Callable
    nothing: Array


def model_of(pattern: Pattern, sizes: Sizes, A: Rows, B: Rows, C: Rows, R: Rows):
    """Numbers of M = [A B], of C and of R that a lane reads."""
    n, p, shape = sizes.n, sizes.p, shape_of(pattern)
    M = {(i, k): A.fixed(i * n + k) for k in range(n) for i in shape.rows[k]}
    M |= {(i, n + 1 + u): B.fixed(i * p + u) for u in range(p) for i in shape.rows[n + 1 + u]}
    output = {(a, i): C.fixed(a * n + i) for a, i in shape.C}
    return M, output, [[R.fixed(u * p + v) for v in range(p)] for u in range(p)]


def terminal(shape: Shape, sizes: Sizes, H: Rows, g: Rows, sample) -> dict:
    """Cost to go of one sample, from its matrix and its vector."""
    of_H = {(i, k): H.sample(i * sizes.n + k, sample) for i, k in shape.entries[: -sizes.n]}
    return of_H | {(i, sizes.n): g.sample(i, sample) for i in range(sizes.n)}


def read(pattern: Pattern, sizes: Sizes, lanes: Lanes, operands: list[Rows]) -> Data:
    """Data of the lanes, from A, B, C, cost, stage, R and the terminal where there is one."""
    A, B, C, cost, stage, R, *end = operands
    shape = shape_of(pattern)
    M, output, weight = model_of(pattern, sizes, A, B, C, R)

    def of_sample(j):
        scale = stage.fixed(j - 1)
        return [scale * cost.sample(row, lanes.step + j) for row in range(len(shape.seen))]

    def start():
        if sizes.ended:
            return terminal(shape, sizes, *end, lanes.step)
        no_cost = dict.fromkeys(shape.entries, 0.0)
        return weigh(shape, sizes, output, no_cost, of_sample(sizes.preview))

    nothing = jnp.full(lanes.number.shape, 0.0, cost.ref.dtype)
    return Data(M, output, weight, of_sample, start, nothing)


def swept(pattern: Pattern, sizes: Sizes, data: Data, keep: Callable | None = None):
    """Gain K_0 and G of the first stage; `keep(j, K_j)` is called for the stages before."""
    shape = shape_of(pattern)

    def back(j, H):
        chosen = choice(shape, sizes, data.M, data.R, H)
        if keep is not None:
            keep(j, gain(shape, sizes, data.M, chosen.L))
        in_front = cost_in_front(shape, sizes, data.M, H, chosen)
        return weigh(shape, sizes, data.C, in_front, data.cost(j))

    def sparse(H) -> bool:
        return any(is_zero(number) for number in H.values())

    H, last = data.start(), sizes.preview - 1
    while last and sizes.preview - last <= WRITTEN_OUT and sparse(H):
        H, last = back(last, H), last - 1

    def stage(count, numbers):
        H = back(last - count, dict(zip(shape.entries, numbers, strict=True)))
        return vectors((H[entry] for entry in shape.entries), numbers[0])

    start = vectors((H[entry] for entry in shape.entries), data.nothing)
    numbers = jax.lax.fori_loop(0, last, stage, start)
    chosen = choice(shape, sizes, data.M, data.R, dict(zip(shape.entries, numbers, strict=True)))
    return gain(shape, sizes, data.M, chosen.L), chosen.G


def kernel(pattern: Pattern, sizes: Sizes, batch: Batch, *refs):
    """Gains F and f of one block of lanes."""
    *data, F, f = refs
    lanes = Lanes.of(pl.program_id(0), sizes.steps, batch.members)
    K, _ = swept(pattern, sizes, read(pattern, sizes, lanes, batch.rows(data, lanes.member)))
    for u in range(sizes.p):
        for i in range(sizes.n):
            F[u * sizes.n + i, lanes.number] = K[u][i]
        f[u, lanes.number] = -K[u][sizes.n]


def as_rows(operands: Sequence[Operand]) -> list[Operand]:
    """Operands A, B, C, cost, stage, R and the terminal, as `read` takes them."""
    A, B, C, cost, stage, R, *end = operands
    model = A.fixed(), B.fixed(), C.fixed()
    ends = (operand.timed() for operand in end)
    return [*model, cost.timed(), stage.fixed(), R.fixed(), *ends]


@lru_cache
def gains(pattern: Pattern, sizes: Sizes) -> Callable:
    """Kernel of the gains: operands -> F (p, n, T), f (p, T).

    The operands are A, B, C, cost (q, S), stage, R and, where there is a terminal, H (n, n, T) and
    g (n, T).
    """
    n, p, T = sizes.n, sizes.p, sizes.steps

    def whole(*operands):
        batch = Batch.of(operands)
        lanes = T * batch.members
        run, programs = partial(kernel, pattern, sizes, batch), -(-lanes // LANES)
        F, f = launch(run, programs, as_rows(operands), [(p * n, lanes), (p, lanes)])
        return [F.reshape(p, n, T, *batch.sizes), f.reshape(p, T, *batch.sizes)]

    widest = n * n if sizes.ended else max(p * n, len(shape_of(pattern).seen))
    return batch_last(lambda *operands: in_pieces(whole, operands, widest * sizes.samples))
