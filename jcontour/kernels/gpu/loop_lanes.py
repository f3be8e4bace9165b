"""The closed loop of a linear plant under a gain schedule on a GPU.

There is one lane per member of the batch, with the state in registers.

    x(k+1) = A x + B u,  u = f - F x,  y = C x
Its derivative goes backward in time with the costate l(k) of x(k):

    v = ubar + B' l(k+1),   l(k) = C' ybar + A' l(k+1) - F' v
    Fbar = -v x',   fbar = v,   x0bar = l(0)
"""

from collections.abc import Sequence
from functools import partial
from itertools import product
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax.experimental import pallas as pl
from jaxtyping import Array

from jcontour.kernels.arithmetic import dot
from jcontour.kernels.gpu.lanes import Batch, Lanes, Operand, Rows, launch, vectors
from jcontour.linear.plant import Pattern

MEMBERS = 32  # lanes of a program: one warp, so that few members still reach many processors


class Model(NamedTuple):
    """Non-zero numbers of A, B and C."""

    A: dict
    B: dict
    C: dict


def read(pattern: Pattern, operands: Sequence[Rows]) -> Model:
    """Model of the lanes."""
    return Model(*(_non_zeros(*pair) for pair in zip(pattern, operands, strict=True)))


def _non_zeros(where: tuple[tuple[bool, ...], ...], rows: Rows) -> dict:
    columns = len(where[0])
    places = [(i, k) for i, k in product(range(len(where)), range(columns)) if where[i][k]]
    return {(i, k): rows.fixed(i * columns + k) for i, k in places}


def times(M: dict, x, rows: int):
    """Product M x."""
    return [dot((value, x[k]) for (i, k), value in M.items() if i == row) for row in range(rows)]


def transposed(M: dict) -> dict:
    """Transpose of M."""
    return {(k, i): value for (i, k), value in M.items()}


def forward_kernel(pattern: Pattern, steps: int, batch: Batch, *refs):
    """Outputs and controls of the lanes' runs; their states where there is a place for them."""
    operands, (y, u, *x) = refs[: len(batch.axes)], refs[len(batch.axes) :]
    n, p, m = len(pattern.A), len(pattern.B[0]), len(pattern.C)
    lanes = Lanes.of(pl.program_id(0), 1, batch.members, MEMBERS)
    A, B, C, F, f, start = batch.rows(operands, lanes.member)
    model = read(pattern, (A, B, C))

    def step(k, state):
        here = k * batch.members + lanes.member

        def control_of(i: int):
            pairs = ((-F.sample(i * n + j, k), state[j]) for j in range(n))
            return dot(pairs, f.sample(i, k))

        control = [control_of(i) for i in range(p)]
        signals = times(model.C, state, m), control, state
        for ref, values in zip((y, u, *x), signals, strict=False):
            for row, value in enumerate(values):
                ref[row, here] = value
        drift, push = times(model.A, state, n), times(model.B, control, n)
        return vectors((a + b for a, b in zip(drift, push, strict=True)), state[0])

    nothing = jnp.full((MEMBERS,), 0.0, y.dtype)
    jax.lax.fori_loop(0, steps, step, tuple(nothing + start.fixed(i) for i in range(n)))


def backward_kernel(pattern: Pattern, steps: int, batch: Batch, *refs):
    """Cotangents of the plan and of the first state."""
    *operands, F_bar, f_bar, start_bar = refs
    n, p, m = len(pattern.A), len(pattern.B[0]), len(pattern.C)
    lanes = Lanes.of(pl.program_id(0), 1, batch.members, MEMBERS)
    A, B, C, F, x, y_bar, u_bar = batch.rows(operands, lanes.member)
    model = Model(*map(transposed, read(pattern, (A, B, C))))

    def step(count, costate):
        k = steps - 1 - count
        here = k * batch.members + lanes.member
        v = [u_bar.sample(i, k) + push for i, push in enumerate(times(model.B, costate, p))]
        for i, j in product(range(p), range(n)):
            F_bar[i * n + j, here] = -v[i] * x.sample(j, k)
        for i in range(p):
            f_bar[i, here] = v[i]
        seen = times(model.C, [y_bar.sample(a, k) for a in range(m)], n)
        carried = times(model.A, costate, n)

        def costate_of(j: int):
            pairs = ((-F.sample(i * n + j, k), v[i]) for i in range(p))
            return dot(pairs, seen[j] + carried[j])

        return vectors((costate_of(j) for j in range(n)), costate[0])

    nothing = jnp.full((MEMBERS,), 0.0, x.ref.dtype)
    costate = jax.lax.fori_loop(0, steps, step, (nothing,) * n)
    for i in range(n):
        start_bar[i, lanes.member] = costate[i]


def runs(pattern: Pattern, operands: Sequence[Operand], with_states: bool) -> list[Array]:
    """Signals y (m, T), u (p, T) and, where they are wanted, x (n, T).

    The operands are A, B, C, F (p, n, T), f (p, T), x(0).
    """
    A, B, C, F, f, start = operands
    batch, steps = Batch.of(operands), f.core[-1]
    n, p, m = len(pattern.A), len(pattern.B[0]), len(pattern.C)
    results = [(rows, steps * batch.members) for rows in ((m, p, n) if with_states else (m, p))]
    rows = [A.fixed(), B.fixed(), C.fixed(), F.timed(), f.timed(), start.fixed()]
    run, programs = partial(forward_kernel, pattern, steps, batch), -(-batch.members // MEMBERS)
    found = launch(run, programs, rows, results, MEMBERS)
    return [array.reshape(-1, steps, *batch.sizes) for array in found]


def cotangents(pattern: Pattern, operands: Sequence[Operand]) -> list[Array]:
    """Cotangents Fbar, fbar, x0bar from the operands A, B, C, F, x, ybar, ubar."""
    A, B, C, F, x, y_bar, u_bar = operands
    batch, steps = Batch.of(operands), x.core[-1]
    n, p = len(pattern.A), len(pattern.B[0])
    results = [(p * n, steps * batch.members), (p, steps * batch.members), (n, batch.members)]
    rows = [A.fixed(), B.fixed(), C.fixed(), *(operand.timed() for operand in (F, x, y_bar, u_bar))]
    run, programs = partial(backward_kernel, pattern, steps, batch), -(-batch.members // MEMBERS)
    F_bar, f_bar, start_bar = launch(run, programs, rows, results, MEMBERS)
    return [
        F_bar.reshape(p, n, steps, *batch.sizes),
        f_bar.reshape(p, steps, *batch.sizes),
        start_bar.reshape(n, *batch.sizes),
    ]
