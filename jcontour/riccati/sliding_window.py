"""Receding-horizon sweep whose cost does not grow with N_p, for a uniform stage profile.

A span of samples, from the state x at its first to the state and the costate l behind its last, is
a linear map,

    x_end = A z - C l_end,      l = J z + A_x' l_end,      z = (x, 1),
whose C and J_x are symmetric and not negative. A cost to go l_end = H z_end behind it becomes the
one in front,

    J z + A_x' l_end,      l_end = H_x (I + C H_x)^-1 (A z - C h) + h,      H = (H_x, h),
and two spans in a row are one: the associative elements of the Riccati recursion (Sarkka &
Garcia-Fernandez, "Temporal parallelization of dynamic programming and linear quadratic control",
2023) with the affine part inside the matrices.

The samples that a step looks over are the end of one block, some whole blocks, and the beginning of
another. Beginnings grow by one sample at a time, all blocks at once; then ends do, and every step
closes its window by a solution with p + 1 right-hand sides. The blocks of the beginnings are
shifted against those of the ends, so that what lies between is the same for all steps of a block.
Time is on the last axis of every array, as in `window_sweep`; what is the same at all times has one
entry there.
"""

import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jcontour._devices import on_gpu
from jcontour._tracing import is_concrete

# [samples] below, the plain sweep is faster (on a CPU: N_p = 55 forward and 150 backward)
SHORTEST_WINDOW = {"cpu": 80, "gpu": 150}
# blocks side by side on a CPU: their matrices stay in a core's second-level cache
LONGEST_ROW = 100
FEW = 3  # inputs or outputs: loops over them are written out
Cost = Float[Array, "n n+1 t"]  # H_x and h


class Span(NamedTuple):
    """A span of samples as a linear map; see the module's docstring."""

    A: Float[Array, "n n+1 t"]
    C: Float[Array, "n n t"]
    J: Cost


class Model(NamedTuple):
    """Matrices A, B, C, and the inverse W of the control weight."""

    A: Float[Array, "n n"]
    B: Float[Array, "n p"]
    C: Float[Array, "m n"]
    W: Float[Array, "p p 1"]


def suits_spans(stage) -> bool:
    """Whether spans suit a stage profile: long enough, and known to be uniform.

    A profile that falls geometrically would need R to fall with it: spans are alike up to a scale
    of J against C only as long as that scale is the same at every sample, and the ratio of Q to R
    is not.
    """
    return (
        len(stage) >= SHORTEST_WINDOW["gpu" if on_gpu() else "cpu"]
        and is_concrete(stage)
        and bool(np.all(np.asarray(stage) == np.asarray(stage)[0]))
    )


def block_length(window: int, steps: int) -> int:
    """Samples of a block: many small ones for a GPU; on a CPU no more than its cache holds."""
    side_by_side = 1 if on_gpu() else -(-steps // LONGEST_ROW)
    return min(window, max(2 * math.isqrt(window), side_by_side))


def sliding_plan(
    A, B, C, Q, y_d, R, end: Float[Array, "T n n+1"] | None, steps: int, length: int
) -> tuple[Float[Array, "T p n"], Float[Array, "T p"]]:
    """Gains F, f of `riccati.receding_horizon_plan` for a stage profile of ones.

    Args:
        A: (n, n).
        B: (n, p).
        C: (m, n).
        Q: output weights (S, m, m) of all samples that a window weighs: S = T + W - 1. The first
            is the first sample that step 0 looks at.
        y_d: desired outputs (S, m) of the same samples [m].
        R: control weight (p, p).
        end: cost to go behind the window of every step; None for no cost.
        steps: number of steps T.
        length: size of a block, at most W.
    """
    model = Model(A, B, C, jnp.linalg.inv(R)[..., None])
    whole, rest = divmod(Q.shape[0] - steps + 1, length)
    blocks = -(-steps // length)
    Q = (Q + Q.swapaxes(1, 2)) / 2

    def samples(first: int, count: int):
        return _in_blocks(Q, first, count, length), _in_blocks(y_d, first, count, length)

    ends = None if end is None else _in_blocks(end, 0, blocks, length)
    first = samples(length + rest, blocks + whole - 1)
    beginnings, costs = _grown_behind(model, first, ends, whole)
    between = in_a_row(beginnings, whole - 1, blocks)
    between = between._replace(A=_transposed(between.A))
    if rest:
        between = _grown_in_front(model, between, samples(length, blocks), rest)
    plan = _closed_windows(model, between, samples(0, blocks), costs)
    F, f = (jnp.moveaxis(values, -1, 0).reshape(-1, *values.shape[1:-1])[:steps] for values in plan)
    return F, f


def _grown_behind(
    model: Model, samples, ends, whole: int
) -> tuple[Span, Float[Array, "length n n+1 t"]]:
    """Whole blocks as spans, and the cost to go in front of every beginning of a block."""

    def begin(span: Span, place):
        sample, end = place
        seen = Span(*(part[..., whole - 1 :] for part in span))
        cost = seen.J if end is None else cost_in_front(seen, end)
        return append(model, *sample, span), cost

    return jax.lax.scan(begin, nothing(model.A, samples[0].shape[-1]), (samples, ends))


def _grown_in_front(model: Model, span: Span, samples, count: int) -> Span:
    """Spans with the first `count` samples of every block in front."""

    def grow(span: Span, sample):
        return prepend(model, *sample, span), None

    first = jax.tree.map(lambda values: values[:count], samples)
    return jax.lax.scan(grow, span, first, reverse=True)[0]


def _closed_windows(model: Model, span: Span, samples, costs: Float[Array, "length n n+1 t"]):
    """First controls of all windows: every end of a block in front of its span."""

    def close(span: Span, place):
        sample, cost = place
        span = prepend(model, *sample, span)
        return span, first_control(model, span, cost)

    return jax.lax.scan(close, span, (samples, costs), reverse=True)[1]


def _in_blocks(values, first: int, count: int, length: int):
    """Samples by place in the block (in front) and block (behind); zeros beyond the end."""
    values = values[first : first + count * length]
    missing = count * length - values.shape[0]
    values = jnp.pad(values, ((0, missing), *[(0, 0)] * (values.ndim - 1)))
    return jnp.moveaxis(values.reshape(count, length, *values.shape[1:]), 0, -1)


def nothing(A: Float[Array, "n n"], count: int) -> Span:
    """Span of no samples, `count` times."""
    n = A.shape[0]
    none = jnp.zeros((n, n + 1, count), A.dtype)
    return Span(none + jnp.eye(n, n + 1, dtype=A.dtype)[..., None], none[:, :n], none)


def append(model: Model, Q: Float[Array, "m m t"], y_d: Float[Array, "m t"], span: Span) -> Span:
    """Span with one more sample behind: its output is weighted, then its control acts."""
    n = model.A.shape[0]
    error = _fixed(model.C, span.A)
    error = jnp.concatenate([error[:, :n], error[:, n:] - y_d[:, None]], axis=1)
    seen = _fixed(model.C, span.C)
    force = answer(Q, _fixed(model.C, _transposed(seen)), jnp.concatenate([error, seen], axis=1))
    drift = _fixed(model.A, span.A - _inner(seen, force[:, : n + 1]))
    kept = _congruent(model.A, span.C - _inner(seen, force[:, n + 1 :]))
    C = kept + _congruent(model.B, model.W)
    return Span(drift, C, span.J + _inner(error[:, :n], force[:, : n + 1]))


def prepend(model: Model, Q: Float[Array, "m m t"], y_d: Float[Array, "m t"], span: Span) -> Span:
    """Span with one more sample in front; its A is kept transposed."""
    n = model.A.shape[0]
    pushed, felt = _fixed(model.B.T, span.A[:n]), _fixed(model.B.T, span.J)
    curved = _fixed(model.B.T, _transposed(felt[:, :n]))
    control = answer(model.W, curved, jnp.concatenate([felt, pushed], axis=1))
    A = span.A - _inner(control[:, : n + 1], pushed)
    J = span.J - _inner(felt[:, :n], control[:, : n + 1])
    error = [_inner(Q, model.C[..., None]), -_inner(Q, y_d[:, None])]
    weighted = _fixed(model.C.T, jnp.concatenate(error, axis=1))
    moved = [_congruent(model.A.T, J[:, :n]), _fixed(model.A.T, J[:, n:])]
    return Span(
        jnp.concatenate([_fixed(model.A.T, A[:n]), A[n:]]),
        span.C + _inner(pushed, control[:, n + 1 :]),
        jnp.concatenate(moved, axis=1) + weighted,
    )


def first_control(
    model: Model, span: Span, cost: Cost
) -> tuple[Float[Array, "p n t"], Float[Array, "p t"]]:
    """Gains F, f of u = f - F x one sample before a span, with a cost to go behind it.

    The A of the span is transposed.
    """
    n, p = model.B.shape
    pushed, felt = _fixed(model.B.T, span.A[:n]), _fixed(model.B.T, span.J)
    start = jnp.concatenate(
        [_transposed(pushed), span.A[n, :, None] - _inner(span.C, cost[:, n:])], axis=1
    )
    behind = answer(cost[:, :n], span.C, start)
    steered = felt[:, :n] + _inner(behind[:, :p], _transposed(span.A[:n]))
    drifted = felt[:, n:] + _inner(_transposed(pushed), behind[:, p:] + cost[:, n:])
    moved = _transposed(_fixed(model.A.T, _transposed(steered)))
    curved = _fixed(model.B.T, _transposed(steered))
    control = answer(model.W, curved, jnp.concatenate([moved, drifted], axis=1))
    return control[:, :n], -control[:, n]


def cost_in_front(span: Span, cost: Cost) -> Cost:
    """Cost to go in front of a span, from the cost to go behind it."""
    behind = answer(cost[:, : span.C.shape[0]], span.C, _start(span, cost))
    return _felt_in_front(span, behind, cost)


def joined(first: Span, second: Span) -> Span:
    """Two spans in a row."""
    n = first.C.shape[0]
    start = jnp.concatenate([_start(first, second.J), first.C], axis=1)
    behind = answer(second.J[:, :n], first.C, start)
    through = _inner(_transposed(second.A[:, :n]), start - _inner(first.C, behind))
    A = jnp.concatenate([through[:, :n], through[:, n : n + 1] + second.A[:, n:]], axis=1)
    C = second.C + _inner(_transposed(through[:, n + 1 :]), _transposed(second.A[:, :n]))
    return Span(A, C, _felt_in_front(first, behind[:, : n + 1], second.J))


def _start(span: Span, cost: Cost):
    n = span.C.shape[0]
    return jnp.concatenate([span.A[:, :n], span.A[:, n:] - _inner(span.C, cost[:, n:])], axis=1)


def _felt_in_front(span: Span, behind, cost: Cost) -> Cost:
    n = span.C.shape[0]
    behind = jnp.concatenate([behind[:, :n], behind[:, n:] + cost[:, n:]], axis=1)
    return span.J + _inner(span.A[:, :n], behind)


def in_a_row(spans: Span, count: int, windows: int) -> Span:
    """For the first `windows` places on the time axis, the `count` spans from there on joined."""

    def one_more(behind, first):
        def at_windows(part):
            return jax.lax.dynamic_slice_in_dim(part, first, windows, axis=-1)

        return joined(jax.tree.map(at_windows, spans), behind), None

    none = nothing(jnp.zeros_like(spans.C[..., 0]), windows)
    return jax.lax.scan(one_more, none, jnp.arange(count), reverse=True)[0]


@jax.custom_jvp
def answer(
    H: Float[Array, "n n #t"], C: Float[Array, "n n #t"], V: Float[Array, "n c #t"]
) -> Float[Array, "n c #t"]:
    """H (I + C H)^-1 V for symmetric H and C that are not negative.

    No difference of large numbers is taken. With H = L L' it is L (I + L' C L)^-1 L' V, and
    I + L' C L is eliminated without pivots.
    """
    return _answer(_elimination(H, C), V)


@answer.defjvp
def _answer_jvp(primals, tangents):
    (H, C, V), (dH, dC, dV) = primals, tangents
    factors = _elimination(H, C)
    X = _answer(factors, V)
    moved = _inner(dH, V - _inner(C, X))
    return X, moved + _answer(factors, dV - _inner(C, moved) - _inner(dC, X))


def _answer(factors, V):
    L, columns = factors

    def eliminate(V, place):
        k, column = place
        return V - column[:, None] * V[k][None], None

    rows = jnp.arange(V.shape[0]), columns
    V, _ = jax.lax.scan(eliminate, _inner(L, V), rows, unroll=len(V) <= FEW)
    return _inner(_transposed(L), V)


def _elimination(H, C):
    """Factor L with H = L L', and the columns of the elimination of I + L' C L.

    Column k holds how much of row k is taken from every row.
    """
    L, identity = _factor(H), jnp.eye(H.shape[0], dtype=H.dtype)

    def eliminate(M, k):
        row = M[k]
        column = (M[:, k] - identity[k][:, None]) / row[k][None]
        return M - column[:, None] * row[None], column

    M = _inner(L, _inner(C, L)) + identity[..., None]
    _, columns = jax.lax.scan(eliminate, M, jnp.arange(len(H)), unroll=len(H) <= FEW)
    return L, columns


def _factor(H):
    """Lower triangular L with L L' = H; where H is zero to rounding, L is zero."""
    places = jnp.arange(H.shape[0])
    least = H.shape[0] * jnp.finfo(H.dtype).eps * jnp.diagonal(H).T

    def eliminate(H, k):
        row = H[k]
        pivot = jnp.where(row[k] > least[k], row[k], jnp.inf)
        column = jnp.where(places[:, None] < k, 0.0, H[:, k]) / pivot[None]
        scale = jnp.sqrt(jnp.maximum(row[k], 0.0))
        return H - column[:, None] * row[None], column * scale[None]

    return _transposed(jax.lax.scan(eliminate, H, places, unroll=len(H) <= FEW)[1])


def _fixed(M, X):
    """Product M X with a matrix that is the same at all times."""
    return jnp.tensordot(M, X, 1)


def _congruent(M, X):
    """Product M X M' with a matrix that is the same at all times, X symmetric."""
    X = _fixed(M, _transposed(_fixed(M, X)))
    return (X + _transposed(X)) / 2


def _inner(X, Y):
    """Product X' Y at every time."""
    return jnp.einsum("kit,kjt->ijt", X, Y)


def _transposed(X):
    return X.swapaxes(0, 1)
