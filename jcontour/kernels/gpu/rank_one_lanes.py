"""Contouring gains as a change of rank one per sample, on a GPU: one lane per step and member.

A contouring window has the weight Q_j = q I - b r_j r_j' (`contouring_lq.contour_weight`: q = alpha
+ beta, b = beta). Under q I alone it is the same problem at every step: `constant_lanes` solves it
once per run. The change is a system of the window's length, whatever the number of states. With
d_j = sqrt(s_j) y_d(k+j), and K, O, D, E of `constant_lanes`:

    S_ij = 1_ij - b r_i' D_ij r_j,   S z_j = E_j r_j
    w_i = r_i' (q sum_j D_ij d_j - d_i)
    F = K - b sum_j z_j r_j' O_j,   f = sum_j (q E_j d_j + b z_j w_j)
This is the Woodbury identity on the window's condensed problem; S is positive definite. Eliminating
it takes N_p^3 / 6 multiplications, less than sweeping N_p stages of a large plant. Its rounding
errors are those of the sweep or less, for alpha = 0 too.
"""

from collections.abc import Callable
from functools import lru_cache, partial
from itertools import product
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax.experimental import pallas as pl
from jaxtyping import Array, Float

from jcontour.kernels.arithmetic import dot
from jcontour.kernels.gpu.constant_lanes import constant_part
from jcontour.kernels.gpu.lanes import (
    LANES,
    Batch,
    Lanes,
    Operand,
    batch_last,
    in_pieces,
    launch,
    vectors,
)
from jcontour.linear.plant import Pattern, decoupled_axes

# of a program's lanes: the numbers of a member serve several steps, and writing stays in a row
MEMBERS = 8


class Owners(NamedTuple):
    """Output of the axis that every state and every input belongs to."""

    states: dict[int, int]
    inputs: dict[int, int]


@lru_cache
def owners(pattern: Pattern) -> Owners:
    """Owners in a plant whose axes have one output each."""
    axes = decoupled_axes(pattern)
    states = {i: axis.outputs[0] for axis in axes for i in axis.states}
    return Owners(states, {u: axis.outputs[0] for axis in axes for u in axis.inputs})


def rank_one_gains(
    pattern: Pattern, A, B, C, constant, change, tangent, y_d, stage, R
) -> tuple[Float[Array, "T p n"], Float[Array, "T p"]]:
    """Gains F, f of `riccati.receding_horizon_plan`, for Q = q I - b r r'.

    Args:
        pattern: of a plant whose axes are decoupled, with one output each.
        A: (n, n).
        B: (n, p).
        C: (m, n).
        constant: q.
        change: b.
        tangent: r (S, m), of length one or zero.
        y_d: desired outputs (S, m) [m].
        stage: profile (N_p,) over the horizon.
        R: control weight (p, p); nothing couples the inputs of different axes.
    """
    steps = tangent.shape[0] - stage.shape[0]
    weights = constant[None], change[None], stage, R
    F, f = _gains(pattern, steps)(A, B, C, *weights, tangent.T, y_d.T)
    return jnp.transpose(F, (2, 0, 1)), f.T


@lru_cache
def _gains(pattern: Pattern, steps: int) -> Callable:
    """Kernels: operands -> F (p, n, T), f (p, T).

    The operands are A, B, C, q, b, stage, R, tangent (m, S), y_d (m, S).
    """
    n, p = len(pattern.A), len(pattern.B[0])

    def whole(*operands):
        A, B, C, constant, change, stage, R, tangent, y_d = operands
        preview, batch = stage.core[0], Batch.of(operands)
        part = constant_part(pattern, preview, [A, B, C, constant, stage, R])
        K, D, E, O, q, b, stage = (  # noqa: E741
            operand.fixed() for operand in (*part, constant, change, stage)
        )
        tangent, y_d = tangent.timed(), y_d.timed()
        lanes = steps * batch.members

        def run(kernel: Callable, data: list[Operand], rows: list[int]):
            axes = tuple(operand.axes for operand in data)
            kernel = partial(kernel, pattern, preview, steps, batch._replace(axes=axes))
            results = [(count, lanes) for count in rows]
            return launch(kernel, programs_of(steps, batch.members), data, results)

        found = run(solutions_kernel, [D, E, b, tangent], [p * preview])
        z = Operand(found[0], batch.together)
        F, f = run(gains_kernel, [K, D, E, O, z, q, b, stage, tangent, y_d], [p * n, p])
        return [F.reshape(p, n, steps, *batch.sizes), f.reshape(p, steps, *batch.sizes)]

    return batch_last(lambda *operands: in_pieces(whole, operands, p * n * steps))


def programs_of(steps: int, members: int) -> int:
    """Programs of `LANES` lanes that all steps of all members take."""
    wide = _wide(members)
    return -(-members // wide) * -(-steps // (LANES // wide))


def _wide(members: int) -> int:
    """Members of a program."""
    return min(MEMBERS, 1 << (members - 1).bit_length())


def lanes_of(program, steps: int, members: int) -> Lanes:
    """Lanes of one program: a few members side by side, then their next steps.

    Those beyond the last member or step do its work again.
    """
    wide = _wide(members)
    beside = -(-members // wide)
    place = jnp.arange(LANES, dtype=jnp.int32)
    member = jnp.minimum(program % beside * wide + place % wide, members - 1)
    step = jnp.minimum(program // beside * (LANES // wide) + place // wide, steps - 1)
    return Lanes(step * members + member, step, member)


def solutions_kernel(pattern: Pattern, preview: int, steps: int, batch: Batch, *refs):
    """Solutions z of the lanes' systems, for every input."""
    *data, z = refs
    of, samples, axes = owners(pattern), range(preview), range(len(pattern.C))
    inputs = range(len(pattern.B[0]))
    lanes = lanes_of(pl.program_id(0), steps, batch.members)
    D, E, change, tangent = batch.rows(data, lanes.member)
    b, one = change.fixed(0), jnp.full(lanes.number.shape, 1.0, z.dtype)
    r = [[tangent.sample(a, lanes.step + j + 1) for a in axes] for j in samples]
    less = [[-b * component for component in row] for row in r]

    def entry(i: int, j: int):
        along = ((less[i][a] * r[j][a], D.fixed((a * preview + i) * preview + j)) for a in axes)
        return dot(along, one if i == j else 0.0)

    pushes = [[E.fixed(u * preview + j) * r[j][of.inputs[u]] for j in samples] for u in inputs]
    for u, solution in enumerate(solved(entry, pushes)):
        for j, number in enumerate(solution):
            z[u * preview + j, lanes.number] = number


def gains_kernel(pattern: Pattern, preview: int, steps: int, batch: Batch, *refs):
    """Gains F and f of the lanes' steps, from the solutions of their systems."""
    *data, F, f = refs
    n, p, m = len(pattern.A), len(pattern.B[0]), len(pattern.C)
    of, samples, inputs, axes = owners(pattern), range(preview), range(p), range(m)
    lanes = lanes_of(pl.program_id(0), steps, batch.members)
    K, D, E, O, z, constant, change, stage, *path = batch.rows(data, lanes.member)  # noqa: E741
    tangent, y_d = path
    q, b = constant.fixed(0), change.fixed(0)
    nothing = jnp.full(lanes.number.shape, 0.0, F.dtype)

    def wanted(j):
        root = jnp.sqrt(stage.fixed(j))
        return [root * y_d.sample(a, lanes.step + j + 1) for a in axes]

    d = [wanted(j) for j in samples]

    def gather(j, sums):
        """Sums with the terms of sample j."""
        gains, forces = list(sums[: p * n]), list(sums[p * n :])
        r = [tangent.sample(a, lanes.step + j + 1) for a in axes]
        here = wanted(j)

        def missed(a: int):
            rows = (D.fixed((a * preview + j) * preview + i) for i in samples)
            return q * dot(zip(rows, (row[a] for row in d), strict=True)) - here[a]

        w = dot((r[a], missed(a)) for a in axes)
        steer = [b * z.sample(u * preview + j, lanes.step) for u in inputs]
        turned = [[-steer[u] * r[a] for a in axes] for u in inputs]
        seen = [O.fixed(i * preview + j) for i in range(n)]
        for u, i in product(inputs, range(n)):
            gains[u * n + i] = dot([(turned[u][of.states[i]], seen[i])], gains[u * n + i])
        for u in inputs:
            follow = q * E.fixed(u * preview + j), here[of.inputs[u]]
            forces[u] = dot([follow, (steer[u], w)], forces[u])
        return vectors([*gains, *forces], nothing)

    def alone(u: int, i: int):
        return K.fixed(u * n + i) if of.inputs[u] == of.states[i] else 0.0

    start = [*(alone(u, i) for u, i in product(inputs, range(n))), *[0.0] * p]
    sums = jax.lax.fori_loop(0, preview, gather, vectors(start, nothing))
    for row in range(p * n):
        F[row, lanes.number] = sums[row]
    for u in inputs:
        f[u, lanes.number] = sums[p * n + u]


def solved(entry: Callable, right: list[list]) -> list[list]:
    """Solutions of S z = e for several e, S symmetric positive definite.

    `entry(i, j)`, i >= j, gives S. It is eliminated row by row, S = L diag(v) L'. Rows are kept
    with the other sign, for products that are taken off.
    """
    size = len(right[0])
    lower, inverse = [], []
    for i in range(size):
        scaled, row = [], []
        for j in range(i):
            scaled.append(dot(zip(scaled, lower[j], strict=False), entry(i, j)))
            row.append(-scaled[j] * inverse[j])
        pivot = dot(zip(scaled, row, strict=True), entry(i, i))
        lower.append(row)
        inverse.append(1 / pivot)
    return [_substituted(lower, inverse, e) for e in right]


def _substituted(lower: list[list], inverse: list, right: list) -> list:
    """Solution for one right-hand side."""
    size, found = len(right), []
    for i in range(size):
        found.append(dot(zip(lower[i], found, strict=True), right[i]))
    found = [value * scale for value, scale in zip(found, inverse, strict=True)]
    for i in reversed(range(size)):
        found[i] = dot(((lower[k][i], found[k]) for k in range(i + 1, size)), found[i])
    return found
