"""Receding-horizon sweep on a GPU: one lane per step and member of the batch, H in registers.

The stages are those of `written_stage`. Numbers that are known to be zero cost nothing: the first
stages, in which H still has few, are written out one by one.
"""

from collections.abc import Callable, Sequence
from functools import lru_cache, partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax.experimental import pallas as pl
from jaxtyping import Array

from jcontour.kernels.arithmetic import is_zero
from jcontour.kernels.gpu.lanes import (
    LANES,
    Batch,
    Lanes,
    Operand,
    Rows,
    batch_last,
    in_pieces,
    launch,
    vectors,
)
from jcontour.kernels.written_stage import (
    Shape,
    Sizes,
    choice,
    cost_in_front,
    gain,
    shape_of,
    weigh,
)
from jcontour.linear.plant import Pattern

WRITTEN_OUT = 1  # stages at most: more save 3 %, and double the time to compile


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
