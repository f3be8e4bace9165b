"""Blocks of `riccati.blockwise` on a GPU: one lane for every block and member of the batch.

The stages are those of `gain_lanes`. A lane sweeps the samples ahead of its block, then the block
itself, and writes the gains of each of its steps.
"""

from collections.abc import Callable
from functools import lru_cache, partial

import jax
import jax.numpy as jnp
from jax.experimental import pallas as pl
from jaxtyping import Array, Float

from jcontour.kernels.gpu.gain_lanes import model_of, terminal
from jcontour.kernels.gpu.lanes import WARP, Batch, Lanes, batch_last, in_pieces, launch, vectors
from jcontour.kernels.packed_stage import cost_entries
from jcontour.kernels.written_stage import Sizes, choice, cost_in_front, gain, shape_of, weigh
from jcontour.linear.plant import Pattern


def block_plan(
    pattern: Pattern, preview: int, A, B, C, Q, y_d, R, H, g
) -> tuple[Float[Array, "T p n"], Float[Array, "T p"]]:
    """Gains F, f of `riccati.blockwise`.

    H and g are the cost to go at the end of every block's horizon, blocks in front.
    """
    n, p, m = A.shape[0], B.shape[1], C.shape[0]
    sizes = Sizes(n, p, m, Q.shape[0] - preview, preview, ended=True)
    ends = jnp.moveaxis(H, 0, -1), g.T
    F, f = block_gains(pattern, sizes)(A, B, C, cost_entries(Q, y_d), R, *ends)
    return jnp.transpose(F, (2, 0, 1)), f.T


def kernel(pattern: Pattern, sizes: Sizes, batch: Batch, blocks: int, *refs):
    """Gains F and f of the blocks of one program's lanes, idle steps included."""
    *data, F, f = refs
    shape, members, N_p = shape_of(pattern), batch.members, sizes.preview
    lanes = Lanes.of(pl.program_id(0), blocks, members, WARP)
    A, B, C, cost, R, *end = batch.rows(data, lanes.member)
    M, output, weight = model_of(pattern, sizes, A, B, C, R)
    begins = sizes.steps - N_p * (blocks - lanes.step)  # below zero in the first block

    def stage(j, numbers):
        """Choice at step j of the block, and the cost to go in front of its sample."""
        H = dict(zip(shape.entries, numbers, strict=True))
        chosen = choice(shape, sizes, M, weight, H)
        sample = jnp.maximum(begins + j, 0)
        seen = [cost.sample(row, sample) for row in range(len(shape.seen))]
        before = weigh(shape, sizes, output, cost_in_front(shape, sizes, M, H, chosen), seen)
        return chosen, vectors((before[entry] for entry in shape.entries), numbers[0])

    def ahead(count, numbers):
        return stage(2 * N_p - 2 - count, numbers)[1]

    def within(count, numbers):
        j = N_p - 1 - count
        chosen, before = stage(j, numbers)
        K, place = gain(shape, sizes, M, chosen.L), (lanes.step * N_p + j) * members + lanes.member
        for u in range(sizes.p):
            for i in range(sizes.n):
                F[u * sizes.n + i, place] = K[u][i]
            f[u, place] = -K[u][sizes.n]
        return before

    last = terminal(shape, sizes, *end, lanes.step)
    nothing = jnp.full(lanes.number.shape, 0.0, cost.ref.dtype)
    numbers = vectors((last[entry] for entry in shape.entries), nothing)
    numbers = jax.lax.fori_loop(0, N_p - 1, ahead, numbers)
    jax.lax.fori_loop(0, N_p, within, numbers)


@lru_cache
def block_gains(pattern: Pattern, sizes: Sizes) -> Callable:
    """Kernel of the gains: operands -> F (p, n, T), f (p, T).

    The operands are A, B, C, cost (q, S), R, and H (n, n, blocks) and g (n, blocks) at the ends.
    """
    n, p, T = sizes.n, sizes.p, sizes.steps
    blocks = -(-T // sizes.preview)
    rows = blocks * sizes.preview

    def whole(*operands):
        batch = Batch.of(operands)
        A, B, C, cost, R, H, g = operands
        fixed = A.fixed(), B.fixed(), C.fixed()
        F, f = launch(
            partial(kernel, pattern, sizes, batch, blocks),
            -(-blocks * batch.members // WARP),
            [*fixed, cost.timed(), R.fixed(), H.timed(), g.timed()],
            [(p * n, rows * batch.members), (p, rows * batch.members)],
            WARP,
        )
        F, f = F.reshape(p, n, rows, *batch.sizes), f.reshape(p, rows, *batch.sizes)
        return [F[:, :, rows - T :], f[:, rows - T :]]

    widest = max(p * n * rows, len(shape_of(pattern).seen) * sizes.samples, n * n * blocks)
    return batch_last(lambda *operands: in_pieces(whole, operands, widest))
