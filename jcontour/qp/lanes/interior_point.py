"""Iterations of `jcontour.qp.interior_point` on a GPU, a lane for each problem.

The equations, the order and the tests of the readable solver. Each kernel goes through the stages
once; what it finds is in the card's memory, with the batch on the last axis.
"""

from collections.abc import Sequence
from functools import lru_cache, partial
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array, lax

from jcontour.kernels.gpu.lanes import WARP, Operand, batch_last
from jcontour.qp.lanes.check import check
from jcontour.qp.lanes.iteration import ITERATION
from jcontour.qp.lanes.lane import Problem, Sizes, by_member
from jcontour.qp.lanes.start import START
from jcontour.qp.one_sided import Point
from jcontour.qp.path import MOST
from jcontour.qp.staged import StagedQP, Trajectory

NAMES = (*StagedQP._fields, "guess")
POINT = "stages", "end", "s", "l", "t", "g", "iterations"
ANSWER = "stages", "end", "residual", "beyond"


def rows_of(sizes: Sizes) -> dict[str, int]:
    """Numbers of a lane in every array that the iterations change."""
    N, n, p, r = sizes
    v, limits = n + p, ("s", "l", "t", "g", "ds", "dl", "dt", "dg")
    single = "gap", "count", "largest", "before", "iterations", "open", "target", "share"
    single = *single, "far", "ahead", "good", "residual", "beyond"
    return {
        **dict.fromkeys(("stages", "slope", "right", "step"), N * v),
        **dict.fromkeys(("end", "slope_end", "step_end"), n),
        **dict.fromkeys(limits, 2 * N * r),
        **dict.fromkeys(("value", "weight", "moves"), N * r),
        "Y": N * p * n,
        "y": N * p,
        "R": N * p * (p + 1) // 2,
        **dict.fromkeys(single, 1),
    }


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
        return [jnp.zeros((rows[name], *extents), dtype) for name in POINT + ANSWER]
    work = {name: lax.empty((count * lanes,), dtype) for name, count in rows.items()}
    run = partial(_run, sizes, problem)
    # every lane is open while the first factors are found
    work = run(START, work | {"open": jnp.ones_like(work["open"])})

    def unfinished(state):
        k, work = state
        return (k < MOST) & jnp.any(work["open"] > 0)

    def iterate(state):
        k, work = state
        return k + 1, run(ITERATION, work)

    _, work = lax.while_loop(unfinished, iterate, (0, work))
    last = run((check,), work)
    found = [work[name] for name in POINT] + [last[name] for name in ANSWER]
    pairs = zip(found, POINT + ANSWER, strict=True)
    found = (by_member(array, rows[name], members) for array, name in pairs)
    return [array.reshape(-1, *extents) for array in found]


def _run(sizes: Sizes, problem, kernels, work: dict[str, Array]) -> dict[str, Array]:
    for kernel in kernels:
        work = kernel(sizes, problem, work)
    return work


class Found(NamedTuple):
    """Last point of the path, iterations, and the trajectory of its controls with residuals."""

    point: Point
    iterations: Array
    at: Trajectory
    residual: Array
    beyond: Array


def found(qp: StagedQP, guess) -> Found:
    """The answer as the readable solver finds it.

    Args:
        qp: the problem, with one limited row at least.
        guess: controls to begin with.
    """
    (N, r), n, p = qp.lower.shape, qp.x0.size, qp.B.shape[1]
    stages, end, *limits, iterations, rolled, last, residual, beyond = _whole(Sizes(N, n, p, r))(
        *qp, guess
    )
    point = Point(
        Trajectory(stages.reshape(N, n + p), end), *(row.reshape(2, N, r) for row in limits)
    )
    at = Trajectory(rolled.reshape(N, n + p), last)
    return Found(point, iterations[0].astype(int), at, residual[0], beyond[0])
