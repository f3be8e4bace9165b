"""The interior point on a GPU, a lane for each problem.

The equations, the order and the tests of the readable solver. Each kernel goes through the stages
once; what it finds is in the card's memory, with the batch on the last axis.
"""

from collections.abc import Sequence
from functools import lru_cache, partial

import jax.numpy as jnp
import numpy as np
from jax import Array, lax

from jcontour.kernels.gpu.lanes import WARP, Operand, batch_last
from jcontour.qp.lanes.check import check
from jcontour.qp.lanes.found import NAMES, RESULTS, Found, rows_of
from jcontour.qp.lanes.iteration import ITERATION
from jcontour.qp.lanes.kernel import Sizes
from jcontour.qp.lanes.lane import Problem, by_member, run
from jcontour.qp.lanes.start import START
from jcontour.qp.path import MOST
from jcontour.qp.staged import StagedQP


@lru_cache
def _whole(sizes: Sizes):
    return batch_last(lambda *operands: solved(sizes, operands))


def packed(operand: Operand) -> Operand:
    """Lower triangle of symmetric matrices, on the two last axes but the batch."""
    array, axes = operand
    size = array.shape[-1 - len(axes)]
    i, k = np.tril_indices(size)
    lead = (slice(None),) * (array.ndim - len(axes) - 2)
    return Operand(array[(*lead, i, k)], axes)


def solved(sizes: Sizes, operands: Sequence[Operand]) -> list[Array]:
    """Last points of the path, with all batch axes behind."""
    named = dict(zip(NAMES, operands, strict=True))
    named |= {name: packed(named[name]) for name in ("H", "H_end")}
    problem = Problem.of(named)
    lanes, dtype = problem.programs * WARP, operands[0].array.dtype
    rows = rows_of(sizes)
    members, extents = problem.batch.members, problem.batch.sizes
    if members == 0:
        return [jnp.zeros((rows[name], *extents), dtype) for name in RESULTS]
    work = {name: lax.empty((count * lanes,), dtype) for name, count in rows.items()}
    go = partial(_run, sizes, problem)
    # every lane is open while the first factors are found
    work = go(START, work | {"open": jnp.ones_like(work["open"])})

    def unfinished(state):
        k, work = state
        return (k < MOST) & jnp.any(work["open"] > 0)

    def iterate(state):
        k, work = state
        return k + 1, go(ITERATION, work)

    _, work = lax.while_loop(unfinished, iterate, (0, work))
    work = go((check,), work)
    found = (by_member(work[name], rows[name], members) for name in RESULTS)
    return [array.reshape(-1, *extents) for array in found]


def _run(sizes: Sizes, problem, kernels, work: dict[str, Array]) -> dict[str, Array]:
    for kernel in kernels:
        work = run(kernel, sizes, problem, work)
    return work


def found(qp: StagedQP, guess) -> Found:
    """The answer as the readable solver finds it.

    Args:
        qp: the problem, with one limited row at least.
        guess: controls to begin with.
    """
    (N, r), n, p = qp.lower.shape, qp.x0.size, qp.B.shape[1]
    sizes = Sizes(N, n, p, r)
    return Found.of(sizes, dict(zip(RESULTS, _whole(sizes)(*qp, guess), strict=True)))
