"""The receding-horizon sweep on a GPU: one lane per step and member of the batch, H in registers.

The equations are those of `window_sweep`, written out number by number over the static non-zeros of the plant: with a 1 behind
the state and M = [A B],
    Hz = M' H_{j+1} M,   G = (Hz_uu + R)^-1,   K_j = G Hz_ux,   H_j = Hz_xx - Hz_xu K_j + C' Q_j C
"""

from collections.abc import Callable, Sequence
from functools import lru_cache, partial
from itertools import combinations_with_replacement, product
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax.experimental import pallas as pl

from jcontour.kernels.lanes import LANES, Batch, Lanes, Operand, Rows, batch_last, dot, in_pieces, launch, vectors
from jcontour.kernels.window_sweep import seen_entries, small_inverse
from jcontour.linear import Pattern, decoupled_axes


class Sizes(NamedTuple):
    """Static sizes: states, inputs, outputs, steps, preview, and whether a terminal cost is given."""

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
    """What is known of the numbers: parts that nothing couples, non-zero rows of every column of M, non-zeros of C.

    Labels: states from 0, the 1 is n, inputs from n + 1.
    """

    parts: tuple[tuple[tuple[int, ...], tuple[int, ...]], ...]
    rows: dict[int, tuple[int, ...]]
    C: tuple[tuple[int, int], ...]
    entries: tuple[tuple[int, int], ...]
    seen: tuple[tuple[int, int], ...]


@lru_cache
def shape_of(pattern: Pattern) -> Shape:
    """The shape of all plants with one pattern."""
    n, p, m = len(pattern.A), len(pattern.B[0]), len(pattern.C)
    parts = tuple((axis.states, tuple(n + 1 + u for u in axis.inputs)) for axis in decoupled_axes(pattern))
    rows = {k: tuple(i for i in range(n) if pattern.A[i][k]) for k in range(n)}
    rows |= {n + 1 + u: tuple(i for i in range(n) if pattern.B[i][u]) for u in range(p)}
    C = tuple((a, i) for a in range(m) for i in range(n) if pattern.C[a][i])
    entries = (*combinations_with_replacement(range(n), 2), *((i, n) for i in range(n)))
    return Shape(parts, rows, C, entries, tuple((int(a), int(b)) for a, b in seen_entries(m).T))


def key(i: int, k: int) -> tuple[int, int]:
    """The one entry that stands for (i, k) and (k, i)."""
    return (i, k) if i <= k else (k, i)


def control(shape: Shape, sizes: Sizes, M, R, H):
    """Hz, K and G of one stage, every number a vector over lanes."""
    n, Hz = sizes.n, {}
    for (x, u), (y, v) in combinations_with_replacement(shape.parts, 2):
        left, right = x + u, y + v
        for c, column in enumerate(right):
            heads = left[: c + 1] if (x, u) == (y, v) else left
            needed = sorted({i for head in heads for i in shape.rows[head]})
            HM = {i: dot((H[key(i, k)], M[k, column]) for k in shape.rows[column]) for i in needed}
            for head in heads:
                Hz[key(head, column)] = dot((M[i, head], HM[i]) for i in shape.rows[head])
    for head, rows in shape.rows.items():
        Hz[key(head, n)] = dot((M[i, head], H[i, n]) for i in rows)
    inputs = range(n + 1, n + 1 + sizes.p)
    G = small_inverse([[Hz[key(u, v)] + R[i][k] for k, v in enumerate(inputs)] for i, u in enumerate(inputs)])
    K = [[dot((row[v], Hz[key(label, i)]) for v, label in enumerate(inputs)) for i in range(n + 1)] for row in G]
    return Hz, K, G


def weigh(shape: Shape, sizes: Sizes, C, H, cost):
    """H + C' Q C, `cost` the numbers of [Q, -Q y_d]."""
    H, Q = dict(H), dict(zip(shape.seen, cost, strict=True))
    for (a, i), (b, k) in product(shape.C, repeat=2):
        if i <= k:
            H[i, k] = dot([(C[a, i] * C[b, k], Q[key(a, b)])], H[i, k])
    for a, i in shape.C:
        H[i, sizes.n] = dot([(C[a, i], Q[a, sizes.m])], H[i, sizes.n])
    return H


class Data(NamedTuple):
    """What a lane reads: model, control weight, and functions of the stage j for the weighted cost and the terminal."""

    M: dict
    C: dict
    R: list
    cost: Callable
    start: Callable


def read(pattern: Pattern, sizes: Sizes, lanes: Lanes, operands: list[Rows]) -> Data:
    """The data of the lanes, from A, B, C, cost, stage, R and the terminal where there is one."""
    A, B, C, cost, stage, R, *end = operands
    n, p, shape = sizes.n, sizes.p, shape_of(pattern)
    M = {(i, k): A.fixed(i * n + k) for k in range(n) for i in shape.rows[k]}
    M |= {(i, n + 1 + u): B.fixed(i * p + u) for u in range(p) for i in shape.rows[n + 1 + u]}
    output = {(a, i): C.fixed(a * n + i) for a, i in shape.C}
    weight = [[R.fixed(u * p + v) for v in range(p)] for u in range(p)]

    def of_sample(j):
        scale = stage.fixed(j - 1)
        return [scale * cost.sample(row, lanes.step + j) for row in range(len(shape.seen))]

    def start():
        if sizes.ended:
            rows = [*(i * n + k for i, k in shape.entries[:-n]), *range(n)]
            return {e: end[e[1] == n].sample(row, lanes.step) for e, row in zip(shape.entries, rows, strict=True)}
        nothing = jnp.full(lanes.index.shape, 0.0, cost.ref.dtype)
        return weigh(shape, sizes, output, dict.fromkeys(shape.entries, nothing), of_sample(sizes.preview))

    return Data(M, output, weight, of_sample, start)


def swept(pattern: Pattern, sizes: Sizes, data: Data, keep: Callable | None = None):
    """K_0 and G; `keep(j, K_j)` is called for the stages before."""
    shape = shape_of(pattern)

    def back(count, numbers):
        j = sizes.preview - 1 - count
        Hz, K, _ = control(shape, sizes, data.M, data.R, dict(zip(shape.entries, numbers, strict=True)))
        if keep is not None:
            keep(j, K)
        H = {(i, k): dot(((-Hz[key(i, sizes.n + 1 + u)], K[u][k]) for u in range(sizes.p)), Hz[i, k]) for i, k in shape.entries}
        H = weigh(shape, sizes, data.C, H, data.cost(j))
        return vectors((H[entry] for entry in shape.entries), numbers[0])

    H = data.start()
    numbers = jax.lax.fori_loop(0, sizes.preview - 1, back, tuple(H[entry] for entry in shape.entries))
    _, K, G = control(shape, sizes, data.M, data.R, dict(zip(shape.entries, numbers, strict=True)))
    return K, G


def kernel(pattern: Pattern, sizes: Sizes, batch: Batch, *refs):
    """F and f of one block of lanes."""
    *data, F, f = refs
    lanes = Lanes.of(pl.program_id(0), sizes.steps, batch.members)
    K, _ = swept(pattern, sizes, read(pattern, sizes, lanes, batch.rows(data, lanes.member)))
    for u in range(sizes.p):
        for i in range(sizes.n):
            F[u * sizes.n + i, lanes.index] = K[u][i]
        f[u, lanes.index] = -K[u][sizes.n]


def as_rows(operands: Sequence[Operand]) -> list[Operand]:
    """A, B, C, cost, stage, R and the terminal, as `read` takes them."""
    A, B, C, cost, stage, R, *end = operands
    return [A.fixed(), B.fixed(), C.fixed(), cost.timed(), stage.fixed(), R.fixed(), *(operand.timed() for operand in end)]


@lru_cache
def gains(pattern: Pattern, sizes: Sizes) -> Callable:
    """A, B, C, cost (q, S), stage, R and, where there is a terminal, H (n, n, T) and g (n, T) -> F (p, n, T), f (p, T)."""
    n, p, T = sizes.n, sizes.p, sizes.steps

    def whole(*operands):
        batch = Batch.of(operands)
        lanes = T * batch.members
        F, f = launch(partial(kernel, pattern, sizes, batch), -(-lanes // LANES), as_rows(operands), [(p * n, lanes), (p, lanes)])
        return [F.reshape(p, n, T, *batch.sizes), f.reshape(p, T, *batch.sizes)]

    widest = n * n if sizes.ended else max(p * n, len(shape_of(pattern).seen))
    return batch_last(lambda *operands: in_pieces(whole, operands, widest * sizes.samples))
