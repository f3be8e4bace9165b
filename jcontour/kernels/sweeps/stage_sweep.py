"""The Riccati sweep of many windows on the CPU, eight of them at a time.

Every lane is a window of S stages, behind which a cost to go remains:

    H = H_end;   for s = S - 1 .. 0:   K_s, G_s = the best control before H,
                                       H = the cost in front of it + scale_s C' Q_s C
(`kernels.written_stage`, where the equations are). The windows of a run's steps slide over its
samples; those of blocks have samples of their own.
"""

import hashlib
from functools import lru_cache, partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jcontour.devices import suits_native
from jcontour.kernels.dispatch import MOST_MULTIPLICATIONS, multiplications
from jcontour.kernels.packing import packing
from jcontour.kernels.written_stage import (
    Sizes,
    choice,
    cost_in_front,
    gain,
    remembered,
    shape_of,
    weigh,
)
from jcontour.linear.plant import Pattern
from jcontour.native.calls import straight_call
from jcontour.native.numbers import WIDTH
from jcontour.native.straight_line import counted_down, memory, whole


def suits_stages(pattern: Pattern, *arrays) -> bool:
    """Whether the sweep takes a plant and numbers of these types; compiling takes a second else."""
    return suits_native(*arrays) and multiplications(pattern) <= MOST_MULTIPLICATIONS


class Swept(NamedTuple):
    """What a sweep finds of all windows, T of them.

    Attributes:
        K: gains [F, -f] of the first stages; the states are in the order of `kernels.packing`.
        G: of the first stage.
        product: of A - B F of the stages behind the first ones, the last one on the left. With it
            on either side an error of the cost to go at the end arrives in front of them.
    """

    K: Float[Array, "kept p n+1 T"]
    G: Float[Array, "p p T"]
    product: Float[Array, "n n T"] | Float[Array, "0 0 T"]


def stage_sweep(
    pattern: Pattern,
    A,
    B,
    C,
    R,
    cost: Float[Array, "q *samples"],
    scale: Float[Array, " between"],
    H: Float[Array, "T n n"],
    g: Float[Array, "T n"],
    kept: int,
    remembering: bool = False,
) -> Swept:
    """Gains of the first stages of all windows.

    Args:
        pattern: non-zeros of the model.
        A: (n, n).
        B: (n, p).
        C: (m, n).
        R: control weight (p, p).
        cost: entries of [Q, -Q y_d] as `packed_stage.cost_entries` orders them, of the samples
            between the stages: (q, S - 1, T), or (q, S - 2 + T) in a row where every window begins
            one sample later than the one before.
        scale: of these costs.
        H: cost to go at the ends.
        g: likewise.
        kept: stages whose K is wanted, from the first on.
        remembering: whether the product is wanted; it is empty else.
    """
    (n, p), windows = B.shape, g.shape[0]
    idle = max(WIDTH - windows, 0)
    cost = jnp.pad(cost, [*[(0, 0)] * (cost.ndim - 1), (0, idle)])
    entries = np.array(shape_of(pattern).entries).T
    ends = jnp.concatenate([H, g[:, :, None]], axis=2)[:, entries[0], entries[1]].T
    ends = jnp.pad(ends, [(0, 0), (0, idle)])
    shapes = [
        jax.ShapeDtypeStruct((*sizes, windows + idle), ends.dtype)
        for sizes in ((kept, p, n + 1), (p, p), (n, n) if remembering else (0, 0))
    ]
    program = _program(pattern, cost.ndim == 2, remembering)
    found = program(shapes, A, B, C, R, cost, scale, ends)
    return Swept(*(numbers[..., :windows] for numbers in found))


@lru_cache
def _program(pattern: Pattern, *form: bool):
    name = hashlib.sha256(repr((pattern, *form)).encode()).hexdigest()[:16]
    return straight_call(f"jcontour_stage_sweep_{name}", partial(_write, pattern, *form))


def _write(pattern: Pattern, sliding: bool, remembering: bool, builder, arguments, results) -> None:
    """Write the program: for every eight windows, stages from the last to the first."""
    shape, order = shape_of(pattern), packing(pattern).order
    n, p, m = len(pattern.A), len(pattern.B[0]), len(pattern.C)
    sizes = Sizes(n, p, m, 0, 0, ended=True)
    A, B, C, R, cost, scale, ends = (arguments(k) for k in range(7))
    K_rows, G_rows, X_rows = (results(k) for k in range(3))
    windows, kept = G_rows.extent(2), K_rows.extent(0)
    last, samples = scale.extent(0), cost.extent(1)
    stride = whole(1)
    if not sliding:
        samples, stride = builder.mul(samples, windows), windows
    room, squares = memory(builder, len(shape.entries)), list(np.ndindex(n, n))
    product = memory(builder, len(squares))

    def times(number, other):
        return builder.mul(whole(number) if isinstance(number, int) else number, other)

    def model():
        M = {(i, k): A.everywhere(i * n + k) for k in range(n) for i in shape.rows[k]}
        M |= {
            (i, n + 1 + u): B.everywhere(i * p + u) for u in range(p) for i in shape.rows[n + 1 + u]
        }
        output = {(a, i): C.everywhere(a * n + i) for a, i in shape.C}
        return M, output, [[R.everywhere(u * p + v) for v in range(p)] for u in range(p)]

    def eight(group):
        beyond = builder.sub(windows, whole(WIDTH))
        first = times(WIDTH, group)
        first = builder.select(builder.icmp_signed("<", first, beyond), first, beyond)
        for row in range(len(shape.entries)):
            room.write(WIDTH * row, ends.lanes(builder.add(times(row, windows), first)))
        if remembering:
            for row, (i, k) in enumerate(squares):
                product.write(WIDTH * row, float(i == k))

        def stage(s):
            M, output, weight = model()
            H = {entry: room.lanes(WIDTH * row) for row, entry in enumerate(shape.entries)}
            chosen = choice(shape, sizes, M, weight, H)
            with builder.if_then(builder.icmp_signed("<", s, kept)):
                keep(s, gain(shape, sizes, M, chosen.L))
            if remembering:
                with builder.if_then(builder.icmp_signed(">=", s, kept)):
                    X = {at: product.lanes(WIDTH * row) for row, at in enumerate(squares)}
                    X = remembered(shape, sizes, M, chosen.L, X)
                    for row, at in enumerate(squares):
                        product.write(WIDTH * row, X[at])
            first_stage = builder.icmp_signed("==", s, whole(0))
            with builder.if_else(first_stage) as (at_first, at_others):
                with at_first:
                    for u, v in np.ndindex(p, p):
                        place = builder.add(times(u * p + v, windows), first)
                        G_rows.write(place, chosen.G[u][v])
                with at_others:
                    before = builder.sub(s, whole(1))
                    H = cost_in_front(shape, sizes, M, H, chosen)
                    H = weigh(shape, sizes, output, H, weighted(before))
                    for row, entry in enumerate(shape.entries):
                        room.write(WIDTH * row, H[entry])

        def keep(s, K):
            for u, i in np.ndindex(p, n + 1):
                row = builder.add(times(p * (n + 1), s), whole(u * (n + 1) + i))
                number = K[u][order[i] if i < n else n]
                K_rows.write(builder.add(times(row, windows), first), number)

        def weighted(s):
            factor = scale.everywhere(s)
            place = builder.add(times(s, stride), first)
            rows = (builder.add(times(row, samples), place) for row in range(len(shape.seen)))
            return [factor * cost.lanes(row) for row in rows]

        counted_down(builder, builder.add(last, whole(1)), stage)
        if remembering:
            for row in range(len(squares)):
                place = builder.add(times(row, windows), first)
                X_rows.write(place, product.lanes(WIDTH * row))

    groups = builder.sdiv(builder.add(windows, whole(WIDTH - 1)), whole(WIDTH))
    counted_down(builder, groups, eight)
