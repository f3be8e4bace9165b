"""The part of a contouring window that is the same at every step, on a GPU.

Under the constant output weight q I the axes of a decoupled plant do not know of each other, and
every window of a run is one problem. Per axis, backward over the controls l = N_p - 1..0, with
H = H_{l+1} and one lane per member:

    G_l = (B' H B + R)^-1,   K_l = G_l B' H A
Then, with a lane per member and sample, what output j makes of a push at control l; it is scaled
with the root of its entry of the stage profile s:

    Z_jl = sqrt(s_j) C A_{j-1} .. A_{l+1} B,   A_i = A - B K_i
`rank_one_lanes` needs of it

    K = K_0,   O_j = sqrt(s_j) C A_{j-1} .. A_0,   D_ij = sum_l Z_il G_l Z_jl',   E_j = G_0 Z_j0'
"""

from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax.experimental import pallas as pl

from jcontour.kernels.arithmetic import dot
from jcontour.kernels.gpu.lanes import WARP, Batch, Lanes, Operand, Rows, launch, vectors
from jcontour.kernels.written_stage import Sizes, choice, cost_in_front, gain, shape_of, weigh
from jcontour.linear.plant import Axis, Pattern, decoupled_axes


class Constant(NamedTuple):
    """Constant part, each number for the one axis that it belongs to.

    Attributes:
        K: gain of every input for every state (p, n).
        D: by output and two samples (m, N_p, N_p).
        E: by input and sample (p, N_p).
        O: by state and sample (n, N_p).
    """

    K: Operand
    D: Operand
    E: Operand
    O: Operand  # noqa: E741


class OwnModel(NamedTuple):
    """Numbers of one axis: M = [A B] and C by local labels, and its part of R."""

    M: dict
    C: dict
    R: list[list]


def constant_part(pattern: Pattern, preview: int, operands: Sequence[Operand]) -> Constant:
    """Constant part from the operands A, B, C, q, stage (N_p,), R."""
    A, B, C, constant, stage, R = (operand.fixed() for operand in operands)
    n, p = len(pattern.A), len(pattern.B[0])
    batch = Batch.of(operands)
    run, programs = partial(gains_kernel, pattern, preview, batch), -(-batch.members // WARP)
    rows = [(preview * p * size, batch.members) for size in (n, p)]
    found = launch(run, programs, [A, B, C, constant, stage, R], rows, WARP)
    gains = [Operand(rows.reshape(-1, *batch.sizes), batch.together) for rows in found]
    model = [A, B, C, stage, *(operand.fixed() for operand in gains)]
    axes = *(operand.axes for operand in operands[:3]), operands[4].axes, *[batch.together] * 2
    run = partial(answers_kernel, pattern, preview, batch._replace(axes=axes))
    lanes = preview * batch.members
    shapes = [(preview * p, lanes), (preview * p, lanes), (n, lanes)]
    pushed, answered, seen = launch(run, -(-lanes // WARP), model, shapes, WARP)
    pushed, answered = (
        rows.reshape(preview, p, preview, *batch.sizes) for rows in (pushed, answered)
    )
    D = [
        jnp.sum(pushed[:, axis.inputs, :, None] * answered[:, axis.inputs, None], axis=(0, 1))
        for axis in decoupled_axes(pattern)
    ]
    parts = (
        gains[0].array[: p * n],
        jnp.stack(D),
        answered[0],
        seen.reshape(n, preview, *batch.sizes),
    )
    return Constant(*(Operand(array, batch.together) for array in parts))


def gains_kernel(pattern: Pattern, preview: int, batch: Batch, *refs):
    """Gains K_l and G_l of the lanes' members, axis by axis."""
    *data, K_rows, G_rows = refs
    lanes = Lanes.of(pl.program_id(0), 1, batch.members, WARP)
    A, B, C, constant, stage, R = batch.rows(data, lanes.member)
    n, p = len(pattern.A), len(pattern.B[0])
    nothing = jnp.full(lanes.member.shape, 0.0, constant.ref.dtype)
    q = constant.fixed(0)

    def of_axis(axis: Axis):
        model, own = _own_model(pattern, axis, A, B, C, R), own_pattern(pattern, axis)
        shape, size = shape_of(own), len(axis.states)
        sizes = Sizes(size, len(axis.inputs), 1, 1, preview, ended=False)
        known = {(i, size): 0.0 for i in range(size)}  # there is no g; zeros cost nothing
        entries = shape.entries[:-size]

        def back(count, numbers):
            control = preview - 1 - count
            H = dict(zip(entries, numbers, strict=True)) | known
            H = weigh(shape, sizes, model.C, H, [stage.fixed(control) * q, 0.0])
            chosen = choice(shape, sizes, model.M, model.R, H)
            K = gain(shape, sizes, model.M, chosen.L)
            for k, u in enumerate(axis.inputs):
                for i, state in enumerate(axis.states):
                    K_rows[(control * p + u) * n + state, lanes.member] = K[k][i]
                for other, v in enumerate(axis.inputs):
                    G_rows[(control * p + u) * p + v, lanes.member] = chosen.G[k][other]
            before = cost_in_front(shape, sizes, model.M, H, chosen)
            return vectors((before[entry] for entry in entries), nothing)

        jax.lax.fori_loop(0, preview, back, vectors([0.0] * len(entries), nothing))

    for axis in decoupled_axes(pattern):
        of_axis(axis)


def answers_kernel(pattern: Pattern, preview: int, batch: Batch, *refs):
    """Answers of the lanes' samples to every push and to the state: Z, G Z and O."""
    *data, pushed, answered, seen = refs
    n, p = len(pattern.A), len(pattern.B[0])
    lanes = Lanes.of(pl.program_id(0), preview, batch.members, WARP)
    A, B, C, stage, K, G = batch.rows(data, lanes.member)
    nothing = jnp.full(lanes.member.shape, 0.0, stage.ref.dtype)
    root = jnp.sqrt(stage.fixed(lanes.step))

    def of_axis(axis: Axis):
        model, shape = _own_model(pattern, axis, A, B, C), shape_of(own_pattern(pattern, axis))
        states, inputs = range(len(axis.states)), range(len(axis.inputs))
        begun = vectors((root * model.C.get((0, i), 0.0) for i in states), nothing)

        def back(count, row):
            control = preview - 1 - count
            row = [jnp.where(control == lanes.step, b, c) for b, c in zip(begun, row, strict=True)]

            def through(column: int):
                return dot((row[i], model.M[i, column]) for i in shape.rows[column])

            push = [through(len(states) + 1 + k) for k in inputs]
            for k, u in enumerate(axis.inputs):
                pairs = ((G.fixed((control * p + u) * p + axis.inputs[v]), push[v]) for v in inputs)
                pushed[control * p + u, lanes.number] = push[k] + nothing
                answered[control * p + u, lanes.number] = dot(pairs) + nothing

            def in_front(i: int):
                places = ((control * p + u) * n + axis.states[i] for u in axis.inputs)
                pairs = ((-push[k], K.fixed(place)) for k, place in enumerate(places))
                return dot(pairs, through(i))

            return vectors((in_front(i) for i in states), nothing)

        row = jax.lax.fori_loop(0, preview, back, vectors([0.0] * len(states), nothing))
        for i, state in enumerate(axis.states):
            seen[state, lanes.number] = row[i]

    for axis in decoupled_axes(pattern):
        of_axis(axis)


def own_pattern(pattern: Pattern, axis: Axis) -> Pattern:
    """Pattern of one axis by itself."""

    def part(matrix, rows, columns):
        return tuple(tuple(matrix[i][k] for k in columns) for i in rows)

    return Pattern(
        part(pattern.A, axis.states, axis.states),
        part(pattern.B, axis.states, axis.inputs),
        part(pattern.C, axis.outputs, axis.states),
    )


def _own_model(
    pattern: Pattern, axis: Axis, A: Rows, B: Rows, C: Rows, R: Rows | None = None
) -> OwnModel:
    n, p, own = len(pattern.A), len(pattern.B[0]), shape_of(own_pattern(pattern, axis))
    states, inputs = axis.states, axis.inputs
    M = {}
    for k, column in enumerate(states):
        M |= {(i, k): A.fixed(states[i] * n + column) for i in own.rows[k]}
    for k, column in enumerate(inputs, len(states) + 1):
        M |= {(i, k): B.fixed(states[i] * p + column) for i in own.rows[k]}
    seen = {(0, i): C.fixed(axis.outputs[0] * n + states[i]) for _, i in own.C}
    weight = [[R.fixed(u * p + v) for v in inputs] for u in inputs] if R is not None else []
    return OwnModel(M, seen, weight)
